"""What a worker does:  a chunk of cells -> a result each.  Everything that comes and goes is text and numbers.

A result depends on its cell alone, not on what the worker has done before: compiled problems and the base specs' gains
are kept between cells, and are the same bits whoever makes them.
"""

from __future__ import annotations

import base64
import json
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from fopi_tune.core.controller import FoPi
from fopi_tune.errors import FopiError
from fopi_tune.pipeline.discretize import discretize
from fopi_tune.pipeline.prove import prove
from fopi_tune.pipeline.tune import tune
from fopi_tune.pipeline.validate import validate, validate_block
from fopi_tune.proof import Verdict
from fopi_tune.results.design import Design, loop_name
from fopi_tune.results.stamp import numeric_versions
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec
from fopi_tune.study.model import Cell, Kind, Stage
from fopi_tune.study.overrides import Files, spec_from_text
from fopi_tune.study.registry import entries, render_figure

if TYPE_CHECKING:
    from fopi_tune.design import Neighbour
    from fopi_tune.montecarlo.montecarlo import Block

#: base specs whose gains, and designs that a worker keeps
_BASES = 64
_DESIGNS = 16
#: statuses after which a cell goes on to its next stage and ends well
SUCCESS_STATUSES = ("solved", "met")
#: one cell at a time in a process: CasADi and the kept problems are not for threads
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True)
class CellResult:
    """The end of a cell.

    Args:
        key: of the cell.
        document: JSON of its stages, its rows, or its figure; of a failed cell, as far as it came.
        reason: why it failed; empty otherwise.
        seconds: it took; belongs to no table.
    """

    key: str
    document: str
    reason: str
    seconds: float

    @property
    def failed(self) -> bool:
        """Whether there is no answer."""
        return bool(self.reason)


def run_chunk(cells: Sequence[tuple[str, Cell]], versions: Mapping[str, str]) -> list[CellResult]:
    """Run some cells, one after the other.

    Args:
        cells: with their keys.
        versions: those that the keys stand for.

    Returns:
        A result each; what a cell raises is its reason.
    """
    here = numeric_versions()
    if here != dict(versions):
        differing = ", ".join(f"{k} {here.get(k)} instead of {v}" for k, v in versions.items() if here.get(k) != v)
        return [
            CellResult(key, "{}", f"this worker has {differing}; install the same versions and use --retry-failed", 0.0)
            for key, _ in cells
        ]
    with _ONE_AT_A_TIME:
        return [run_cell(key, cell) for key, cell in cells]


class NoBlockError(FopiError):
    """A cell that has no draws: no gains, no filter, other versions; running it says why."""


def run_block(cell: Cell, versions: Mapping[str, str], first: int, end: int) -> Block:
    """What a cell's stage `validate` counts of the draws first to end - 1.

    Raises:
        NoBlockError: there are none.
    """
    with _ONE_AT_A_TIME:
        gains = _gains(cell) if numeric_versions() == dict(versions) else None
        if gains is None:
            raise NoBlockError(cell.label)
        return validate_block(_checked(cell), gains, first, end)


def combine_blocks(key: str, cell: Cell, blocks: Sequence[Block]) -> CellResult:
    """`run_cell` of a cell whose draws were counted before; never raises."""
    with _ONE_AT_A_TIME:
        return run_cell(key, cell, blocks)


def run_cell(key: str, cell: Cell, blocks: Sequence[Block] = ()) -> CellResult:
    """Run one cell; never raises.  `blocks` are all its draws, where they were counted before."""
    start = time.perf_counter()
    document: dict[str, Any] = {}
    try:
        reason = _spec(cell, document, blocks) if cell.kind is Kind.SPEC else _RUN[cell.kind](cell, document)
        text = json.dumps(document, allow_nan=False)
    except Exception as error:
        expected = isinstance(error, FopiError)
        reason = str(error) if expected else f"internal error, {type(error).__name__}: {error}"
        text = _as_far_as_it_came(document)
    return CellResult(key, text, reason, time.perf_counter() - start)


def _as_far_as_it_came(document: dict[str, Any]) -> str:
    try:
        return json.dumps(document, allow_nan=False)
    except (TypeError, ValueError):  # this may be what went wrong
        return "{}"


def _spec(cell: Cell, document: dict[str, Any], blocks: Sequence[Block]) -> str:
    """Run a spec's stages; returns why there is no answer."""
    checked = _checked(cell)
    if Stage.TUNE in cell.stages:
        together = _together(cell)
        design = _designed(cell.text, cell.files, cell.base, together)
        document[Stage.TUNE] = design.to_dict()
        document["outcome"] = design.status.value
        if together and design.certificate is not None:
            document[Stage.PROVE] = _proved(design)
        if design.status is not Status.SOLVED:
            document["reason"] = design.message
            return design.message if design.status is Status.FAILED else ""
    gains = _gains(cell)
    assert gains is not None, "gains that are not tuned are fixed"
    if Stage.PROVE in cell.stages and Stage.PROVE not in document:
        document[Stage.PROVE] = prove(checked, gains).to_dict()
    contradictions = _sampled(cell, checked, gains, blocks, document)
    _conclude(cell, document)
    return contradictions


def _checked(cell: Cell) -> DesignSpec:
    """The spec that the gains are checked against."""
    return spec_from_text(cell.check or cell.text, cell.name, cell.files)


def _together(cell: Cell) -> bool:
    """Whether the proof is the design's own, which goes on searching where it is refuted."""
    return Stage.PROVE in cell.stages and not cell.check


def _gains(cell: Cell) -> FoPi | None:
    """Those of a cell: tuned or fixed; None where the design is not solved."""
    if Stage.TUNE not in cell.stages:
        return _fixed(spec_from_text(cell.text, cell.name, cell.files))
    design = _designed(cell.text, cell.files, cell.base, _together(cell))
    return design.gains if design.status is Status.SOLVED else None


def _sampled(cell: Cell, spec: DesignSpec, gains: FoPi, blocks: Sequence[Block], document: dict[str, Any]) -> str:
    """The stages about the loop on samples; returns what sampling shows although a proof excludes it."""
    if Stage.VALIDATE in cell.stages:
        validated = validate(spec, gains, blocks=blocks)
        if Stage.DISCRETIZE in cell.stages:
            document[Stage.DISCRETIZE] = validated.digital.to_dict()
        document[Stage.VALIDATE] = validated.to_dict()
        return "; ".join(validated.contradictions)
    if Stage.DISCRETIZE in cell.stages:
        document[Stage.DISCRETIZE] = discretize(spec, gains).to_dict()
    return ""


def _conclude(cell: Cell, document: dict[str, Any]) -> None:
    """The outcome is that of the first stage that did not end well; of the last one when all did."""
    for stage in cell.stages:
        document["outcome"] = document[stage]["status"]
        if document["outcome"] not in SUCCESS_STATUSES:
            document["reason"] = f"{stage}: {document['outcome']}"
            return


def _claim(cell: Cell, document: dict[str, Any]) -> str:
    document["rows"] = [asdict(row) for row in entries(cell.text, "CLAIMS")[cell.name]()]
    document["outcome"] = "computed"
    return ""


def _figure(cell: Cell, document: dict[str, Any]) -> str:
    files = render_figure(cell.text, cell.name)
    document["files"] = {name: content for name, content in files.items() if isinstance(content, str)}
    document["base64"] = {
        name: base64.b64encode(content).decode() for name, content in files.items() if isinstance(content, bytes)
    }
    document["outcome"] = "computed"
    return ""


_RUN: Mapping[Kind, Callable[[Cell, dict[str, Any]], str]] = {
    Kind.CLAIM: _claim,
    Kind.FIGURE: _figure,
}


def _fixed(spec: DesignSpec) -> FoPi | None:
    box = spec.controller
    if all(gain.is_fixed for gain in (box.kp, box.ki, box.alpha)):
        return FoPi(box.kp.min, box.ki.min, box.alpha.min)
    return None


def _proved(design: Design) -> dict[str, Any]:
    """What a check of the design's gains says, shaped as `fopi prove` shapes it."""
    assert design.certificate is not None
    verdict = design.certificate.verdict
    status = {Verdict.PROVED: "met", Verdict.REFUTED: "violated"}.get(verdict, "undecided")
    document = design.to_dict()
    kept = ("schema", "gains", "objective", "requirements", "name", "loop", "stability", "nominal", "proof")
    return {"status": status, **{key: document[key] for key in kept}}


@lru_cache(_DESIGNS)
def _designed(text: str, files: Files, base: str, proof: bool) -> Design:
    """The design of a spec; cells that differ in what it is checked against share it."""
    return tune(spec_from_text(text, files=files), proof=proof, start=_base(base) if base else None)


@lru_cache(_BASES)
def _base(text: str) -> Neighbour | None:
    """A base spec with its gains, where it has a solution that is searched in continuous time."""
    from fopi_tune.design import neighbour

    spec = spec_from_text(text)
    box = spec.controller
    if loop_name(spec) == "sampled" or all(gain.is_fixed for gain in (box.kp, box.ki, box.alpha)):
        return None
    design = tune(spec, proof=False)
    return neighbour(spec, design.gains) if design.status is Status.SOLVED and design.gains is not None else None

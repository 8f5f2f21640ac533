"""The worker's part of a study:  a chunk of cells -> a result each, both as text and numbers.

A result depends on its cell alone, not on what the worker has done before.  Compiled problems and the base specs' gains
are cached between cells; every worker computes them with the same bits.
"""

from __future__ import annotations

import base64
import json
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from fopi_tune.core.controller import FoPi
from fopi_tune.errors import FopiError, SpecError
from fopi_tune.pipeline.discretize import discretize
from fopi_tune.pipeline.prove import prove
from fopi_tune.pipeline.simulate import simulate
from fopi_tune.pipeline.tune import tune
from fopi_tune.pipeline.validate import validate, validate_block
from fopi_tune.proof import Verdict
from fopi_tune.results.design import Design
from fopi_tune.results.stamp import numeric_versions
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec
from fopi_tune.study.model import SUCCESS_STATUSES, Cell, Kind, Stage
from fopi_tune.study.overrides import Files, spec_from_text
from fopi_tune.study.registry import entries, render_figure
from fopi_tune.study.system_stages import run_system

if TYPE_CHECKING:
    from fopi_tune.design import Neighbour
    from fopi_tune.montecarlo.montecarlo import Block

#: sizes of a worker's caches: gains of base specs, and designs
_MAX_BASES = 64
_MAX_DESIGNS = 16
#: one cell at a time in a process: CasADi and the cached problems are not thread-safe
_CELL_LOCK = threading.Lock()


@dataclass(frozen=True)
class CellResult:
    """The result of a cell.

    Args:
        key: of the cell.
        document: JSON of its stages, its rows, or its figure; of a failed cell, the part before the failure.
        reason: why it failed; empty otherwise.
        seconds: computing time; not part of the table.
        processor_s: processor time of it, of all threads; not kept.
    """

    key: str
    document: str
    reason: str
    seconds: float
    processor_s: float = field(default=0.0, compare=False)

    @property
    def failed(self) -> bool:
        """Whether there is no answer."""
        return bool(self.reason)


def run_chunk(cells: Sequence[tuple[str, Cell]], versions: Mapping[str, str]) -> list[CellResult]:
    """Run some cells, one after the other.

    Args:
        cells: with their keys.
        versions: of the packages, as they are part of the keys.

    Returns:
        A result each; an exception becomes the result's reason.
    """
    here = numeric_versions()
    if here != dict(versions):
        differing = ", ".join(f"{k} {here.get(k)} instead of {v}" for k, v in versions.items() if here.get(k) != v)
        return [
            CellResult(key, "{}", f"this worker has {differing}; install the same versions and use --retry-failed", 0.0)
            for key, _ in cells
        ]
    with _CELL_LOCK:
        return [run_cell(key, cell) for key, cell in cells]


class NoBlockError(FopiError):
    """A cell whose draws cannot be counted (no gains, no filter, other versions); `run_cell` gives the reason."""


def run_block(cell: Cell, versions: Mapping[str, str], first: int, end: int) -> Block:
    """The counts of a cell's stage `validate` over the draws first to end - 1.

    Raises:
        NoBlockError: the draws cannot be counted.
    """
    with _CELL_LOCK:
        gains = _gains_of_cell(cell) if numeric_versions() == dict(versions) else None
        if gains is None:
            raise NoBlockError(cell.label)
        return validate_block(_spec_of_check(cell), gains, first, end)


def combine_blocks(key: str, cell: Cell, blocks: Sequence[Block]) -> CellResult:
    """Run a cell whose draws were counted in blocks before; never raises."""
    with _CELL_LOCK:
        return run_cell(key, cell, blocks)


def run_cell(key: str, cell: Cell, blocks: Sequence[Block] = ()) -> CellResult:
    """Run one cell; never raises.  `blocks` hold the counts of all its draws where they were counted before."""
    start, processor_start = time.perf_counter(), time.process_time()
    document: dict[str, Any] = {}
    try:
        reason = (
            _run_spec(cell, document, blocks) if cell.kind is Kind.SPEC else _RUN_BY_KIND[cell.kind](cell, document)
        )
        text = json.dumps(document, allow_nan=False)
    except Exception as error:
        expected = isinstance(error, FopiError)
        reason = str(error) if expected else f"internal error, {type(error).__name__}: {error}"
        text = _partial_document(document)
    return CellResult(key, text, reason, time.perf_counter() - start, time.process_time() - processor_start)


def _partial_document(document: dict[str, Any]) -> str:
    try:
        return json.dumps(document, allow_nan=False)
    except (TypeError, ValueError):  # this may be the failure itself
        return "{}"


def _run_spec(cell: Cell, document: dict[str, Any], blocks: Sequence[Block]) -> str:
    """Run a spec's stages; returns the reason of a failure, or an empty text."""
    checked = _spec_of_check(cell)
    if Stage.TUNE in cell.stages:
        proof_in_design = _proof_in_design(cell)
        design = _cached_design(cell.text, cell.name, cell.files, cell.base, proof_in_design)
        document[Stage.TUNE] = design.to_dict()
        document["outcome"] = design.status.value
        if proof_in_design and design.certificate is not None:
            document[Stage.PROVE] = _proof_document(design)
        if design.status is not Status.SOLVED:
            document["reason"] = design.message
            return design.message if design.status is Status.FAILED else ""
    gains = _gains_of_cell(cell)
    assert gains is not None, "gains that are not tuned are fixed"
    if Stage.PROVE in cell.stages and Stage.PROVE not in document:
        document[Stage.PROVE] = prove(checked, gains).to_dict()
    contradictions = _run_sampled_stages(cell, checked, gains, blocks, document)
    _set_outcome(cell, document)
    return contradictions


def _spec_of_check(cell: Cell) -> DesignSpec:
    """The spec that the gains are checked against."""
    return _spec(cell.check or cell.text, cell.name, cell.files)


def _proof_in_design(cell: Cell) -> bool:
    """Whether the design proves its own gains, and searches on when the proof fails."""
    return Stage.PROVE in cell.stages and not cell.check


def _gains_of_cell(cell: Cell) -> FoPi | None:
    """The gains of a cell, tuned or fixed; None where the design is not solved."""
    if Stage.TUNE not in cell.stages:
        return _spec(cell.text, cell.name, cell.files).controller.fixed
    design = _cached_design(cell.text, cell.name, cell.files, cell.base, _proof_in_design(cell))
    return design.gains if design.status is Status.SOLVED else None


def _run_sampled_stages(
    cell: Cell, spec: DesignSpec, gains: FoPi, blocks: Sequence[Block], document: dict[str, Any]
) -> str:
    """Run the stages about the sampled loop; returns draws that contradict a proof, in words."""
    if Stage.SIMULATE in cell.stages:
        document[Stage.SIMULATE] = simulate(spec, gains).to_dict()
    if Stage.VALIDATE in cell.stages:
        validated = validate(spec, gains, blocks=blocks)
        if Stage.DISCRETIZE in cell.stages:
            document[Stage.DISCRETIZE] = validated.digital.to_dict()
        document[Stage.VALIDATE] = validated.to_dict()
        return "; ".join(validated.contradictions)
    if Stage.DISCRETIZE in cell.stages:
        document[Stage.DISCRETIZE] = discretize(spec, gains).to_dict()
    return ""


def _set_outcome(cell: Cell, document: dict[str, Any]) -> None:
    """Set the outcome: the status of the first stage that was not successful, else that of the last stage."""
    for stage in cell.stages:
        document["outcome"] = document[stage]["status"]
        if document["outcome"] not in SUCCESS_STATUSES:
            document["reason"] = f"{stage}: {document['outcome']}"
            return


def _run_system(cell: Cell, document: dict[str, Any]) -> str:
    if run_system(cell, document):
        _set_outcome(cell, document)
    return ""


def _run_claim(cell: Cell, document: dict[str, Any]) -> str:
    document["rows"] = [asdict(row) for row in entries(cell.text, "CLAIMS")[cell.name]()]
    document["outcome"] = "computed"
    return ""


def _run_figure(cell: Cell, document: dict[str, Any]) -> str:
    files = render_figure(cell.text, cell.name)
    document["files"] = {name: content for name, content in files.items() if isinstance(content, str)}
    document["base64"] = {
        name: base64.b64encode(content).decode() for name, content in files.items() if isinstance(content, bytes)
    }
    document["outcome"] = "computed"
    return ""


_RUN_BY_KIND: Mapping[Kind, Callable[[Cell, dict[str, Any]], str]] = {
    Kind.SYSTEM: _run_system,
    Kind.CLAIM: _run_claim,
    Kind.FIGURE: _run_figure,
}


def _proof_document(design: Design) -> dict[str, Any]:
    """The proof of the design's gains, in the form of `fopi prove`."""
    assert design.certificate is not None
    verdict = design.certificate.verdict
    status = {Verdict.PROVED: "met", Verdict.REFUTED: "violated"}.get(verdict, "undecided")
    document = design.to_dict()
    kept = ("schema", "gains", "objective", "requirements", "name", "loop", "stability", "nominal", "proof")
    return {"status": status, **{key: document[key] for key in kept}}


@lru_cache(_MAX_DESIGNS)
def _spec(text: str, name: str, files: Files) -> DesignSpec:
    """The spec of a cell, read once for all of its stages."""
    return spec_from_text(text, name, files)


@lru_cache(_MAX_DESIGNS)
def _cached_design(text: str, name: str, files: Files, base: str, proof: bool) -> Design:
    """The design of a spec; cells that differ only in the spec of the check share it."""
    start = _base_neighbour(base, files) if base else None
    return tune(_spec(text, name, files), proof=proof, start=start, bracket=False)


@lru_cache(_MAX_BASES)
def _base_neighbour(text: str, files: Files) -> Neighbour | None:
    """A base spec with its gains, where it has a solution that is searched."""
    from fopi_tune.design import neighbour

    try:
        spec = spec_from_text(text, files=files)
    except SpecError:
        # the cell has other data than its base: it starts without
        return None
    if spec.controller.fixed is not None:
        return None
    design = tune(spec, proof=False, bracket=False)
    return neighbour(spec, design.gains) if design.status is Status.SOLVED and design.gains is not None else None

"""The JSON that is printed of certificates that were tested again, and of studies."""

from typing import Any, Literal, NotRequired, TypedDict

from fopi_tune.optimum.results import OptimumStatus
from fopi_tune.proof.switched.certificate import SystemVerdict
from fopi_tune.proof.verdict import Verdict
from fopi_tune.results.schema.parts import Gains

Sound = Literal["sound", "refused"]


class RecheckDocument(TypedDict):
    """What is said of a certificate of gains.

    Args:
        schema: version of this JSON; it may only grow.
        status: whether it shows what it says.
        verdict: that it shows; null where it is refused.
        name: of the spec.
        spec_sha256: of the spec's bytes.
        gains: of the controller.
        tolerance: by which a requirement may be missed, neper or radian; of a delay margin relative.
        boxes: that were tested.
        problems: what is wrong.
        notes: what to know besides.
    """

    schema: Literal[1]
    status: Sound
    verdict: Verdict | None
    name: str
    spec_sha256: str
    gains: Gains
    tolerance: float
    boxes: int
    problems: list[str]
    notes: list[str]


class OptimumRecheckDocument(TypedDict):
    """What is said of the file of an optimum.

    Args:
        schema: version of this JSON; it may only grow.
        status: whether it shows what it says.
        verdict: that it shows; null where it is refused.
        boxes: that were tested.
        problems: what is wrong.
        notes: what to know besides.
    """

    schema: Literal[1]
    status: Sound
    verdict: OptimumStatus | None
    boxes: int
    problems: list[str]
    notes: list[str]


class SystemRecheckDocument(TypedDict):
    """What is said of a system's certificate.

    Args:
        schema: version of this JSON; it may only grow.
        status: whether it shows what it says.
        verdict: that it shows; null where it is refused.
        name: of the system.
        problems: what is wrong.
        notes: what to know besides.
    """

    schema: Literal[1]
    status: Sound
    verdict: SystemVerdict | None
    name: str
    problems: list[str]
    notes: list[str]


class CellCounts(TypedDict):
    """How many cells of a study there are.

    Args:
        total: all.
        done: those with a result.
        failed: those without an answer.
        left: those that were not run.
    """

    total: int
    done: int
    failed: int
    left: NotRequired[int]


class BestCell(TypedDict):
    """The best cell of a study.

    Args:
        cell: its number, from 1; null where none meets the conditions.
        value: of the column, in its unit.
        message: of how many it is the best, or why none is.
    """

    cell: int | None
    value: float | None
    message: str


class StudyDocument(TypedDict):
    """The table of a study.

    Args:
        schema: version of this JSON; it may only grow.
        name: of the study.
        cells: how many.
        undecided: cells that end so.
        best: of a study that asks for one.
        rows: a cell each; columns are those of table.csv.
    """

    schema: Literal[1]
    name: str
    cells: CellCounts
    undecided: int
    best: NotRequired[BestCell]
    rows: list[dict[str, Any]]


class ListedCell(TypedDict):
    """A cell of a study that was not run.

    Args:
        cell: its number, from 1.
        spec: name of the spec; of a study of claims there is another key.
        system: name of the system.
        claim: name of the claims.
        figure: name of the figure.
        overrides: path to value.
    """

    cell: int
    spec: NotRequired[str]
    system: NotRequired[str]
    claim: NotRequired[str]
    figure: NotRequired[str]
    overrides: dict[str, Any]


class StudyCellsDocument(TypedDict):
    """The cells of a study.

    Args:
        schema: version of this JSON; it may only grow.
        name: of the study.
        cells: in their order.
    """

    schema: Literal[1]
    name: str
    cells: list[ListedCell]


class FailedCell(TypedDict):
    """A cell without an answer.

    Args:
        cell: its number, from 1.
        label: what it is about.
        reason: why.
    """

    cell: int
    label: str
    reason: str


class DamagedCell(TypedDict):
    """A cell whose result was damaged on the disk: it counts as not run, and is run again.

    Args:
        cell: its number, from 1.
        label: what it is about.
    """

    cell: int
    label: str


class StudyStatusDocument(TypedDict):
    """How far a study is.

    Args:
        schema: version of this JSON; it may only grow.
        name: of the study.
        cells: how many.
        cell_seconds: that all cells took, s.
        failures: cells without an answer.
        damaged: cells whose results were damaged.
    """

    schema: Literal[1]
    name: str
    cells: CellCounts
    cell_seconds: float
    failures: list[FailedCell]
    damaged: list[DamagedCell]


class StudyProgressEvent(TypedDict):
    """A line on stderr while cells run.

    Args:
        event: its kind.
        total: cells.
        done: those with a result.
        failed: those without an answer.
        left: those that were not run.
        elapsed_s: since the start, s.
        cells_per_s: of this run, per s; null before a cell ended.
        left_s: s; null before a cell ended.
        workers: processes; null before a cell ended.
        cell_processor_s: measured processor time of a cell, s.
    """

    event: Literal["progress"]
    total: int
    done: int
    failed: int
    left: int
    elapsed_s: float
    cells_per_s: float | None
    left_s: float | None
    workers: int | None
    cell_processor_s: float | None


class BestDocument(TypedDict):
    """The best cell in full.

    Args:
        schema: version of this JSON; it may only grow.
        name: of the study.
        minimize: the column.
        maximize: the column.
        where: conditions, as the study writes them.
        cell: its number, from 1; null where none meets the conditions.
        value: of the column, in its unit.
        message: of how many it is the best, or why none is.
        overrides: path to value.
        spec: of the cell, as YAML writes it.
        check: changes of it that are checked; null without any.
        results: of the stages by their names, each as the single command's JSON.
    """

    schema: Literal[1]
    name: str
    minimize: NotRequired[str]
    maximize: NotRequired[str]
    where: list[dict[str, Any]]
    cell: int | None
    value: float | None
    message: str
    overrides: NotRequired[dict[str, Any]]
    spec: NotRequired[dict[str, Any]]
    check: NotRequired[Any]
    results: NotRequired[dict[str, Any]]

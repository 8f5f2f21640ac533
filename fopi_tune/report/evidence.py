"""Monte Carlo evidence:  the document of `fopi validate` -> rows of a table, and histograms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fopi_tune.core.text_tables.words import counted
from fopi_tune.report.figures.picture import BLACK, BLUE, ORANGE, WIDE, Picture, label_axes
from fopi_tune.report.requirement_rows import place_phrase
from fopi_tune.report.text.formatting import drawn_phrase, members_phrase, number
from fopi_tune.report.text.percentages import interval_phrase, share_phrase

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIGNS = {"at_least": ">=", "at_most": "<="}
#: histograms in a figure; the table has the rest
_MOST_HISTOGRAMS = 8


@dataclass(frozen=True)
class EvidenceRow:
    """How often one requirement or limit was met, in words."""

    what: str
    share: str
    interval: str
    median: str
    worst: str


def evidence_rows(evidence: Mapping[str, Any]) -> tuple[EvidenceRow, ...]:
    """Everything at once (of documents that count it), stability, then every requirement and limit."""
    joint = evidence.get("joint_yield")
    counted = [] if joint is None else [("all at once", joint)]
    counted += [] if joint is None else [(f"all at once, {each['name']}", each) for each in joint["scenarios"]]
    first = [EvidenceRow(what, *_share_and_interval(each), "", "") for what, each in counted]
    stable = EvidenceRow("stable loop", *_share_and_interval(evidence["stable"]), "", "")
    return (*first, stable, *(_row(judged) for judged in _tested(evidence)))


def system_evidence_rows(evidence: Mapping[str, Any]) -> tuple[EvidenceRow, ...]:
    """The same of a system: everything at once, then of each scenario how many stay finite and keep limits."""
    joint = evidence["joint_yield"]
    rows = [EvidenceRow("all at once", *_share_and_interval(joint), "", "")]
    for each in evidence["scenarios"]:
        counted = (("the output stays finite", "finite"), ("without chattering", "without_chattering"))
        rows += (
            EvidenceRow(f"{said}, {each['name']}", *_share_and_interval(each[key]), "", "") for said, key in counted
        )
        rows += (_row(judged) for judged in each["limits"])
    return tuple(rows)


def sampling_phrase(evidence: Mapping[str, Any]) -> str:
    """How many plants were drawn, how, and how many of them lie outside the family, where nothing is proved."""
    drawn = evidence["drawn"]
    total = (evidence.get("stable") or evidence["joint_yield"])["total"]
    how = f"rows of {drawn['samples_file']['name']}" if drawn["samples_file"] else str(drawn["design"])
    words = f"{evidence['status']}: {counted(total, 'plant')}, {how}, seed {drawn['seed']}"
    if drawn.get("plants"):
        words += ", " + members_phrase([(str(each["name"]), float(each["weight"])) for each in drawn["plants"]])
    outside = drawn["outside_the_family"]
    return f"{words}, {outside} of them outside the family, where nothing is proved" if outside else words


def histograms(evidence: Mapping[str, Any], name: str) -> Picture | None:
    """Histograms of the values, each bar with its exact binomial interval; None without counts."""
    told = [judged for judged in _tested(evidence) if judged.get("histogram")][:_MOST_HISTOGRAMS]
    if not told:
        return None
    from fopi_tune.montecarlo.statistics import fraction  # loads SciPy's special functions

    confidence = float(evidence["drawn"]["confidence"])

    def draw(figure: Figure) -> None:
        every = figure.subplots(len(told), 1, squeeze=False)[:, 0]
        for axes, judged in zip(every, told, strict=True):
            edges, counts = np.array(judged["histogram"]["edges"]), judged["histogram"]["counts"]
            shares = [fraction(count, judged["fraction"]["total"], confidence) for count in counts]
            heights = np.array([100.0 * each.met / each.total for each in shares])
            low = np.array([100.0 * each.low for each in shares])
            high = np.array([100.0 * each.high for each in shares])
            middle = 0.5 * (edges[1:] + edges[:-1])
            axes.bar(middle, heights, np.diff(edges), color=BLUE, alpha=0.5, edgecolor=BLUE, linewidth=0.5)
            axes.errorbar(middle, heights, (heights - low, high - heights), fmt="none", ecolor=BLACK, elinewidth=0.7)
            limit = _limit(judged)
            if edges[0] - np.ptp(edges) <= limit <= edges[-1] + np.ptp(edges):
                axes.axvline(limit, color=ORANGE, linestyle="--")
            label_axes(axes, "share, %", _phrase(judged))

    words = "; ".join(f"{_phrase(j)}: met by {' in '.join(_share_and_interval(j['fraction']))}" for j in told)
    said = (
        f"Histograms of the values that {counted(evidence['stable']['total'], 'drawn plant')} reach, each share with "
        f"its {100.0 * confidence:g} % interval; dashed: the limit, where it is near. Shares: {words}."
    )
    return Picture(f"{name}: plants drawn at random", said, draw, (WIDE, 1.0 + 1.8 * len(told)))


def _tested(evidence: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    return [*evidence["requirements"], *evidence["limits"]]


def _row(judged: Mapping[str, Any]) -> EvidenceRow:
    middle = [each["value"] for each in judged["quantiles"] if each["probability"] == 0.5]
    met, total = judged["fraction"]["met"], judged["fraction"]["total"]
    # of what is infinite the worst is met only if all are, and the median (a value that is reached) if most are
    median = _value(middle[0], judged, 2 * met > total) if middle else ""
    worst = judged["worst"][0] if judged["worst"] else None
    told = ""
    if worst is not None:
        told = f"{_value(worst['value'], judged, met == total)} {place_phrase(worst)} (plant {worst['index']})"
    return EvidenceRow(_phrase(judged), *_share_and_interval(judged["fraction"]), median, told)


def _side(judged: Mapping[str, Any]) -> str:
    return str(judged.get("side", judged["relation"]))


def _limit(judged: Mapping[str, Any]) -> float:
    """The limit of the side that was tested."""
    return float(judged["limits"][-1 if _side(judged) == "at_most" else 0])


def _phrase(judged: Mapping[str, Any]) -> str:
    scenario = f", {judged['scenario']}" if judged.get("scenario") else ""
    return f"{judged['name']} {_SIGNS.get(_side(judged), _side(judged))} {number(_limit(judged))}{scenario}"


def _share_and_interval(said: Mapping[str, Any]) -> tuple[str, str]:
    return share_phrase(said["met"], said["total"]), interval_phrase(said["low"], said["high"])


def _value(value: float | None, judged: Mapping[str, Any], met: bool) -> str:
    return drawn_phrase(judged["name"], _side(judged) == "at_most", met) if value is None else number(value)

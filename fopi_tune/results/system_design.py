"""Gains that were designed for a system of two modes: the result of `fopi tune SYSTEM`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from fopi_tune.core.controller import FoPi, numbers_of
from fopi_tune.montecarlo.statistics import Fraction
from fopi_tune.proof.verification.results import Verification
from fopi_tune.results.documents import finite
from fopi_tune.results.requirement_reports import RequirementReport, requirement_reports
from fopi_tune.results.saved.files import json_file
from fopi_tune.results.saved.names import SYSTEM_DESIGN
from fopi_tune.results.stamp import Stamp
from fopi_tune.results.status import Relaxation, Status
from fopi_tune.results.views.shown import Shown
from fopi_tune.spec.model import Limit, SystemSpec

_SCHEMA = 1


@dataclass(frozen=True)
class DrawnRequirement:
    """A requirement on scenarios of a system, over pairs of plants that were drawn.

    Args:
        requirement: what the system says.
        scenario: name of the one in which it is worst.
        achieved: the worst value of the pairs that were drawn, in the measure's unit.
        plant: the pair, by the numbers' names.
        drawn: how many pairs meet it, with the interval.
    """

    requirement: Limit
    scenario: str
    achieved: float
    plant: Mapping[str, float]
    drawn: Fraction

    @property
    def is_met(self) -> bool:
        """Whether every pair that was drawn meets it."""
        return self.drawn.met == self.drawn.total

    def to_dict(self) -> dict[str, Any]:
        """As in the result's JSON."""
        return {
            "name": self.requirement.measure,
            "relation": self.requirement.relation.value,
            "limit": self.requirement.limit,
            "scenario": self.requirement.scenario,
            "verdict": "checked" if self.is_met else "violated",
            "achieved": finite(self.achieved),
            "met": self.is_met,
            "worst": {"scenario": self.scenario, "plant": dict(self.plant)},
            "drawn": {name: getattr(self.drawn, name) for name in ("met", "total", "low", "high", "confidence")},
        }


@dataclass(frozen=True, repr=False)
class DesignedSystem(Shown):
    """Gains of a system's modes, designed for what its scenarios measure.

    Args:
        spec: the system.
        status: `solved` where every pair of plants that was simulated meets everything: checked, not proved.
        gains: of each mode; None where no gains give stable loops.
        objective: of the worst pair that was simulated, in the measure's unit; None without gains.
        requirements: on scenarios; none without gains.
        loops: the tuned modes' own loops, verified in floating point.
        clash: requirements on scenarios that were not found to hold together, and by how much each would have to be
            relaxed; none where solved, or where no gains meet the modes' own requirements.
        message: why, in words; empty when solved.
        notes: what to know besides.
        evaluations: gains that were simulated.
        stamp: provenance.
    """

    spec: SystemSpec
    status: Status
    gains: Mapping[str, FoPi] | None
    objective: float | None
    requirements: tuple[DrawnRequirement, ...]
    loops: Mapping[str, Verification]
    clash: tuple[Relaxation, ...]
    message: str
    notes: tuple[str, ...]
    evaluations: int
    stamp: Stamp

    @property
    def objective_name(self) -> str:
        """The objective in words."""
        aim = self.spec.objective
        return "" if aim is None else f"minimize {aim.quantity} in scenario {aim.scenario}, the worst pair's"

    @property
    def loop_reports(self) -> dict[str, tuple[RequirementReport, ...]]:
        """The requirements of each tuned mode's own loop."""
        return {name: requirement_reports(found, None) for name, found in self.loops.items()}

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON."""
        gains = None if self.gains is None else {name: numbers_of(found) for name, found in self.gains.items()}
        return {
            "schema": _SCHEMA,
            "status": self.status.value,
            "name": self.spec.name,
            "gains": gains,
            "tuned": list(self.spec.tuned),
            "objective": finite(self.objective),
            "objective_quantity": self.objective_name,
            "requirements": [each.to_dict() for each in self.requirements],
            "loops": {name: [each.to_dict() for each in reports] for name, reports in self.loop_reports.items()},
            "clash": [asdict(each) for each in self.clash],
            "message": self.message,
            "notes": list(self.notes),
            "stamp": asdict(self.stamp),
        }

    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """As `Shown.data_files`."""
        yield from json_file(SYSTEM_DESIGN, self.to_dict())

"""Tradeoff, the result of a sweep of one limit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from fopi_tune.core.controller import ORDER_NAME, WEIGHT_NAME, FoPi, numbers_of
from fopi_tune.core.terms.controller_spec import ControllerSpec
from fopi_tune.core.text_tables.words import counted
from fopi_tune.prices.limit import MovableLimit
from fopi_tune.results.documents import finite
from fopi_tune.results.saved.files import json_file
from fopi_tune.results.saved.names import TRADEOFF
from fopi_tune.results.stamp import Stamp
from fopi_tune.results.views.shown import Saved
from fopi_tune.spec.model import DesignSpec, Limit, Requirement, Scope

#: version of the result's JSON; it may only grow
TRADEOFF_SCHEMA = 1
COLUMNS = ("limit", "status", "objective", "kp", "ki", "alpha", "largest_score", "binds")


def columns_of(controller: ControllerSpec) -> tuple[str, ...]:
    """The columns of the CSV file: `COLUMNS`, and last those of kd, mu and the setpoint's weight that are designed."""
    more = [name for name in ("kd", ORDER_NAME, WEIGHT_NAME) if name in controller.ranges]
    return (*COLUMNS, *more)


class PointStatus(StrEnum):
    """The outcome at one limit."""

    MET = "met"
    #: no start led to gains that meet all requirements, or a looser limit is infeasible
    INFEASIBLE = "infeasible"
    #: the solver's gains did not pass the check
    REFUSED = "refused"


@dataclass(frozen=True)
class TradeoffPoint:
    """One limit and the best gains with it.

    Args:
        limit: public unit.
        status: `met` only after `fopi_tune.proof.verification.verify` found every requirement met.
        objective: computed by the check, public unit; None unless met.
        gains: of a refused point the refused ones; None when infeasible.
        largest_score: of all requirements, dimensionless; None without gains.
        binds: whether the limit is active; if not, a limit nearby gives the same gains.
    """

    limit: float
    status: PointStatus
    objective: float | None
    gains: FoPi | None
    largest_score: float | None
    binds: bool

    def row(self) -> tuple[str, ...]:
        """A row of the CSV file; empty where there is no number."""
        gains = (self.gains.kp, self.gains.ki, self.gains.alpha) if self.gains else (None, None, None)
        numbers = ["" if v is None else repr(v) for v in (self.objective, *gains, self.largest_score)]
        known = {} if self.gains is None else numbers_of(self.gains)
        more = [repr(known[name]) for name in ("kd", ORDER_NAME, WEIGHT_NAME) if name in known]
        return (repr(self.limit), self.status.value, *numbers, str(self.binds).lower(), *more)

    def to_dict(self) -> dict[str, Any]:
        """As in the result's JSON."""
        return {
            "limit": self.limit,
            "status": self.status.value,
            "objective": finite(self.objective),
            "gains": numbers_of(self.gains) if self.gains else None,
            "largest_score": finite(self.largest_score),
            "binds": self.binds,
        }


@dataclass(frozen=True)
class FeasibleEnd:
    """The end of the feasible limits in one direction.

    Args:
        way: 1 above, -1 below.
        feasible: the farthest limit that was found to be met, public unit.
        infeasible: the nearest that is met from no start, public unit; None where all limits that were tried are met.
    """

    way: int
    feasible: float
    infeasible: float | None

    def to_dict(self) -> dict[str, Any]:
        """As in the result's JSON."""
        side = "above" if self.way > 0 else "below"
        return {"side": side, "last_feasible": self.feasible, "first_infeasible": self.infeasible}


def _about(requirement: Requirement | Limit) -> dict[str, Any]:
    """For which plants and frequencies, or in which scenario, a requirement holds."""
    if isinstance(requirement, Limit):
        return {"on": Scope.FAMILY.value, "scenario": requirement.scenario}
    low, high = finite(requirement.from_rad_s) or None, finite(requirement.to_rad_s)
    return {"on": requirement.scope.value, "from_rad_s": low, "to_rad_s": high}


@dataclass(frozen=True, repr=False)
class Tradeoff(Saved):
    """The objective against one limit, all else unchanged.

    Args:
        knob: the limit that is moved.
        spec: the user's.
        own: the point at the user's limit.
        points: the sweep, by rising limit.
        ends: where the limit becomes infeasible; of the directions in which that was searched for.
        objective_quantity: the objective in words.
        stamp: versions and digests.
    """

    knob: MovableLimit
    spec: DesignSpec
    own: TradeoffPoint
    points: tuple[TradeoffPoint, ...]
    ends: tuple[FeasibleEnd, ...]
    objective_quantity: str
    stamp: Stamp

    def __repr__(self) -> str:
        return (
            f"<Tradeoff of {self.spec.name}: {self.status}, {len(self.met)} of {counted(len(self.points), 'limit')} of "
            f"{self.knob.quantity_name} are met; {self.objective_quantity}>"
        )

    @property
    def status(self) -> str:
        """`solved`, or `failed` when the check refused a point."""
        return "failed" if any(p.status is PointStatus.REFUSED for p in self.points) else "solved"

    @property
    def met(self) -> tuple[TradeoffPoint, ...]:
        """The feasible points, which make the curve."""
        return tuple(p for p in self.points if p.status is PointStatus.MET)

    def rows(self) -> Iterator[tuple[str, ...]]:
        """One row a point, with the columns `columns_of` the spec's controller."""
        width = len(columns_of(self.spec.controller))
        for row in (point.row() for point in self.points):
            yield (*row, *[""] * (width - len(row)))

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON."""
        requirement = self.knob.requirement
        return {
            "schema": TRADEOFF_SCHEMA,
            "status": self.status,
            "name": self.spec.name,
            "requirement": {
                "number": self.knob.number,
                "end": self.knob.end or None,
                "name": self.knob.quantity_name,
                "relation": requirement.relation.value,
                **_about(requirement),
            },
            "objective_quantity": self.objective_quantity,
            "own": self.own.to_dict(),
            "points": [point.to_dict() for point in self.points],
            "ends": [end.to_dict() for end in self.ends],
            "stamp": asdict(self.stamp),
        }

    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """As `Shown.data_files`."""
        yield from json_file(f"{TRADEOFF}.json", self.to_dict())
        lines = [",".join(columns_of(self.spec.controller)), *(",".join(row) for row in self.rows())]
        yield f"{TRADEOFF}.csv", "\n".join(lines) + "\n"

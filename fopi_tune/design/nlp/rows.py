"""The slots of the compiled problem and their rows.

point      a constraint on a frequency function at a fixed (plant, frequency)
limit      the same as omega -> 0 or inf, in closed form
peak       the same at the plant's own peak: a variable v with  d value / d v = 0
crossing   a plant with its own variable v:  ln|L(v)| = 0,  and every quantity evaluated at gain crossovers
level      ln|L(v)| = -limit and arg L(v) >= -180 deg: a gain margin at a plant, also where the margin is infinite
phase      arg L(v) = -180 deg: an upper limit or equality of a gain margin
member     a member of the objective's maximum without a frequency of its own
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import casadi as ca

from fopi_tune.design.constraints import Bound, Constraint
from fopi_tune.design.nlp.symbols import SymbolicLoop
from fopi_tune.design.probes import BELOW_ONE
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind

KP, KI, ALPHA, WORST, DEPTH, FIRST_RELAXATION = range(6)


class SlotKind(Enum):
    """The kinds of slots; see the module's docstring."""

    POINT = "point"
    LIMIT = "limit"
    PEAK = "peak"
    CROSSING = "crossing"
    LEVEL = "level"
    PHASE = "phase"
    MEMBER = "member"


@dataclass(frozen=True)
class Block:
    """A group of equal slots.

    Args:
        kind: of all of them.
        constraints: indices of their constraints; empty for the objective.
        capacity: how many there are.
        rows: names of a slot's rows, by which bounds are set: "equation", "constraint <k>", "objective".
    """

    kind: SlotKind
    constraints: tuple[int, ...]
    capacity: int
    rows: tuple[str, ...]

    @property
    def has_frequency(self) -> bool:
        """Whether each slot has a variable v of its own."""
        return self.kind in (SlotKind.PEAK, SlotKind.CROSSING, SlotKind.LEVEL, SlotKind.PHASE)


#: moving peaks at a time, of each constraint and of the objective
PEAKS = 3
#: of what is asked; what is smaller at an end of the axis is not told apart
_FLOOR = 1e-3
#: parameters before the slots': limits of all constraints, then these weights
WEIGHTS = ("worst", "ki", "depth", "relaxation", "ki_scale")


def wanted_blocks(constraints: tuple[Constraint, ...], objective: ObjectiveKind, capacity: int) -> list[Block]:
    """The groups of slots that the constraints and the objective need."""
    crossing = tuple(
        k
        for k, constraint in enumerate(constraints)
        if constraint.where in (EvaluatedAt.GAIN_CROSSOVERS, EvaluatedAt.HIGHEST_GAIN_CROSSOVER)
    )
    blocks = []
    spread = objective is ObjectiveKind.PHASE_MARGIN_SPREAD
    if crossing or spread or objective is ObjectiveKind.CROSSOVER_SPREAD:
        rows = ("equation", *(f"constraint {k}" for k in crossing), *(("spread up", "spread down") if spread else ()))
        blocks.append(Block(SlotKind.CROSSING, crossing, capacity + 2, rows))
    for k, constraint in enumerate(constraints):
        if constraint.where is EvaluatedAt.BAND:
            blocks.append(Block(SlotKind.POINT, (k,), capacity, (f"constraint {k}",)))
            if constraint.from_rad_s < constraint.to_rad_s:
                blocks.append(Block(SlotKind.PEAK, (k,), PEAKS, ("equation", f"constraint {k}")))
        elif constraint.where is EvaluatedAt.PHASE_CROSSOVERS and constraint.bound is Bound.LOWER:
            blocks.append(Block(SlotKind.LEVEL, (k,), capacity, ("equation", f"constraint {k}")))
        if constraint.where is EvaluatedAt.PHASE_CROSSOVERS:
            blocks.append(Block(SlotKind.PHASE, (k,), capacity, ("equation", f"constraint {k}")))
        if constraint.ends:
            blocks.append(Block(SlotKind.LIMIT, (k,), capacity, (f"constraint {k}",)))
    if objective in (ObjectiveKind.SENSITIVITY_PEAK, ObjectiveKind.CONTROL_SENSITIVITY_PEAK):
        blocks.append(Block(SlotKind.POINT, (), 2 * capacity, ("objective",)))
        blocks.append(Block(SlotKind.LIMIT, (), capacity, ("objective",)))
        blocks.append(Block(SlotKind.PEAK, (), PEAKS, ("equation", "objective")))
    elif objective is ObjectiveKind.CROSSOVER_SPREAD:
        blocks.append(Block(SlotKind.MEMBER, (), capacity, ("spread up", "spread down")))
    elif objective is ObjectiveKind.IAE_DISTURBANCE:
        blocks.append(Block(SlotKind.MEMBER, (), capacity, ("objective",)))
    return blocks


class Symbols:
    """The growing lists of symbols while a problem is built."""

    def __init__(self, constraints: tuple[Constraint, ...]) -> None:
        self.head = ca.SX.sym("z", FIRST_RELAXATION + 2 * len(constraints))
        self.variables: list[Any] = [self.head]
        self.limits = ca.SX.sym("limit", len(constraints))
        self.weights = ca.SX.sym("weight", len(WEIGHTS))
        self.parameters: list[Any] = [self.limits, self.weights]
        self.rows: list[Any] = []

    def relaxation(self, k: int) -> tuple[Any, Any]:
        """The elastic variables of constraint k, upwards and downwards."""
        return self.head[FIRST_RELAXATION + 2 * k], self.head[FIRST_RELAXATION + 2 * k + 1]


def slot_rows(
    block: Block,
    at: SymbolicLoop,
    v: Any,
    symbols: Symbols,
    constraints: tuple[Constraint, ...],
    objective: ObjectiveKind,
    nominal: dict[str, Any],
) -> list[Any]:
    """The rows of one slot; bounds are [0, 0] for an equation and [0, inf) else."""
    worst = symbols.head[WORST]
    spread = {"spread up": 1.0, "spread down": -1.0}
    rows: list[Any] = []
    for name in block.rows:
        if name == "equation" and block.kind is SlotKind.PEAK:
            value = (
                constraints[block.constraints[0]].quantity.natural(at)
                if block.constraints
                else _peak_value(objective, at)
            )
            rows.append(ca.gradient(value, v))
        elif name == "equation":
            rows.append(_equation(block, at, symbols, constraints))
        elif name == "objective":
            rows.append(worst - _peak_value(objective, at))
        elif name in spread and block.kind is SlotKind.CROSSING:
            rows.append(worst + spread[name] * (at.phase_margin_rad - nominal["margin"]))
        elif name in spread:
            rows.append(worst + spread[name] * at.log_gain)
        else:
            rows.append(_side_row(int(name.split()[1]), block, at, symbols, constraints))
    return rows


def limit_row(
    block: Block,
    limit_loop: Callable[..., SymbolicLoop],
    kp: Any,
    end: Any,
    symbols: Symbols,
    constraints: tuple[Constraint, ...],
    objective: ObjectiveKind,
) -> Any:
    """The row of a slot at an end of the frequency axis."""
    constant, formula = end[3], end[4]
    if not block.constraints:
        at = limit_loop(kp, end, _FLOOR, _FLOOR)
        return symbols.head[WORST] - formula * _peak_value(objective, at) - constant
    k = block.constraints[0]
    constraint, (up, down) = constraints[k], symbols.relaxation(k)
    # exact far below what is asked; where the smallest slack is the objective, as far as that can be
    floor = 1e-8 if objective is ObjectiveKind.DEPTH else _FLOOR
    asked = ca.exp(symbols.limits[k])
    if constraint.where is EvaluatedAt.GAIN_CROSSOVERS:
        # |L| < 1 as omega -> inf, without which there is no delay margin
        return -limit_loop(kp, end, floor, floor).log_gain - 2.0 * BELOW_ONE + up
    if constraint.where is EvaluatedAt.PHASE_CROSSOVERS:
        asked = 1.0 / asked
    at = limit_loop(kp, end, floor * asked, floor * asked)
    value = formula * constraint.quantity.natural(at) + constant
    return _distance_row(symbols, constraint, k, value, up, down)


def _peak_value(objective: ObjectiveKind, at: SymbolicLoop) -> Any:
    """ln of the response whose largest value is the objective; of others ln|S|, whose slots are never in play."""
    if objective is ObjectiveKind.CONTROL_SENSITIVITY_PEAK:
        return at.log_controller - at.log_return_difference
    return -at.log_return_difference


def _equation(block: Block, at: SymbolicLoop, symbols: Symbols, constraints: tuple[Constraint, ...]) -> Any:
    if block.kind is SlotKind.CROSSING:
        return at.log_gain
    if block.kind is SlotKind.PHASE:
        return at.phase_rad + ca.pi
    k = block.constraints[0]
    up, _ = symbols.relaxation(k)
    # |L| = 1/(the required gain margin, increased by the depth)
    return at.log_gain + symbols.limits[k] + _depth(symbols, constraints[k]) - up


def _side_row(k: int, block: Block, at: SymbolicLoop, symbols: Symbols, constraints: tuple[Constraint, ...]) -> Any:
    constraint = constraints[k]
    up, down = symbols.relaxation(k)
    if block.kind is SlotKind.LEVEL:
        return at.phase_rad + ca.pi
    return _distance_row(symbols, constraint, k, constraint.quantity.natural(at), up, down)


def _distance_row(symbols: Symbols, constraint: Constraint, k: int, value: Any, up: Any, down: Any) -> Any:
    """How far inside its limit a value is."""
    distance = (symbols.limits[k] - value) * constraint.scale
    if constraint.bound is Bound.EQUAL:
        return distance + up - down
    return constraint.bound.value * distance - _depth(symbols, constraint) + up


def _depth(symbols: Symbols, constraint: Constraint) -> Any:
    return symbols.head[DEPTH] if constraint.in_depth else 0.0

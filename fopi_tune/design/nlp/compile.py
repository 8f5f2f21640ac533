"""DesignSpec -> one CasADi NLP with slots, built once and solved many times.

Variables  z = (kp', ki', alpha, worst, depth, relaxation_1 .. relaxation_2n, v_1 .. v_m).  A slot is one plant and one
frequency at which a constraint or the objective is evaluated.  Its plant, frequency, branch of the phase and side of -1
are parameters, so that exchange changes numbers only:

    point      a constraint on a frequency function at a fixed (plant, frequency)
    peak       the same at the plant's own peak: a variable v with  d value / d v = 0
    crossing   a plant with its own variable v:  ln|L(v)| = 0,  and every quantity evaluated at gain crossovers
    level      ln|L(v)| = -limit and arg L(v) >= -180 deg: a gain margin at a plant, also where the margin is infinite
    phase      arg L(v) = -180 deg: an upper limit or equality of a gain margin
    member     a member of the objective's maximum without a frequency of its own

An unused slot has infinite bounds and a fixed v.  Every inequality reads  slack - depth + relaxation >= 0  in natural
units: `depth` is the smallest slack when that is the objective, `relaxation` the elastic variable of an elastic solve.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

import casadi as ca
import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.plant import PlantFamily
from fopi_tune.design.constraints import Bound, Constraint, Scale
from fopi_tune.design.nlp.symbols import SymbolicLoop, loop_function
from fopi_tune.design.reasons import low_frequency_control_gain
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind

KP, KI, ALPHA, WORST, DEPTH, FIRST_RELAXATION = range(6)


class SlotKind(Enum):
    """The kinds of slots; see the module's docstring."""

    POINT = "point"
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


@dataclass(frozen=True)
class Problem:
    """The compiled NLP and its index of variables, parameters and rows."""

    family: PlantFamily
    scale: Scale
    constraints: tuple[Constraint, ...]
    objective: ObjectiveKind
    horizon_s: float
    control_floor: float
    needs_crossover: bool
    blocks: tuple[Block, ...]
    solver: ca.Function
    #: (z, parameters, multipliers of the rows) -> d cost / d limits
    prices: ca.Function
    n_variables: int
    n_parameters: int
    n_rows: int
    first_frequency: dict[int, int] = field(repr=False)
    first_parameter: dict[int, int] = field(repr=False)
    first_row: dict[int, int] = field(repr=False)


#: moving peaks at a time, of each constraint and of the objective
PEAKS = 3
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
    if objective in (ObjectiveKind.SENSITIVITY_PEAK, ObjectiveKind.CONTROL_SENSITIVITY_PEAK):
        blocks.append(Block(SlotKind.POINT, (), 2 * capacity, ("objective",)))
        blocks.append(Block(SlotKind.PEAK, (), PEAKS, ("equation", "objective")))
    elif objective is ObjectiveKind.CROSSOVER_SPREAD:
        blocks.append(Block(SlotKind.MEMBER, (), capacity, ("spread up", "spread down")))
    elif objective is ObjectiveKind.IAE_DISTURBANCE:
        blocks.append(Block(SlotKind.MEMBER, (), capacity, ("objective",)))
    return blocks


class _Symbols:
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


#: cache of compiled problems by what they depend on, least recently used first; about ten megabytes each
_kept: OrderedDict[tuple[object, ...], Problem] = OrderedDict()
_MOST_KEPT = 4


def compiled_problem(
    family: PlantFamily,
    scale: Scale,
    constraints: tuple[Constraint, ...],
    objective: ObjectiveKind,
    horizon_s: float,
    capacity: int,
) -> Problem:
    """`compile_problem` with a cache, for specs that are designed repeatedly in one process.

    Limits, ranges of parameters and the frequency grid are not part of the compiled problem.  A solve leaves no state
    in it, so that results do not depend on earlier solves.
    """
    numbers = tuple((name, value.min if value.is_exact else None) for name, value in family.parameters.items())
    # a delay margin's scale is its limit's, and compiled in
    kinds = tuple((s.quantity, s.bound, s.scale, s.from_rad_s < s.to_rad_s, s.in_depth) for s in constraints)
    key = (family.model, numbers, scale.omega_rad_s, scale.gain, kinds, objective, horizon_s, capacity)
    problem = _kept.pop(key, None)
    if problem is None:
        problem = compile_problem(family, scale, constraints, objective, horizon_s, capacity)
    _kept[key] = problem
    while len(_kept) > _MOST_KEPT:
        _kept.popitem(last=False)
    floor, unstable = _of_corners(family)
    return replace(
        problem, family=family, scale=scale, constraints=constraints, control_floor=floor, needs_crossover=unstable
    )  # fmt: skip


def _of_corners(family: PlantFamily) -> tuple[float, bool]:
    """The low-frequency control gain, and whether the plant at some corner of the box is unstable in open loop."""
    corners = Plants.members(family, family.corners())
    return low_frequency_control_gain(corners), bool(corners.unstable_poles.any())


def compile_problem(
    family: PlantFamily,
    scale: Scale,
    constraints: tuple[Constraint, ...],
    objective: ObjectiveKind,
    horizon_s: float,
    capacity: int,
) -> Problem:
    """Build the NLP.

    Args:
        capacity: number of slots a block.

    Returns:
        The problem; its solver is IPOPT with MUMPS.
    """
    symbols = _Symbols(constraints)
    loop = loop_function(family, scale)
    blocks = tuple(wanted_blocks(constraints, objective, capacity))
    first_frequency: dict[int, int] = {}
    first_parameter: dict[int, int] = {}
    first_row: dict[int, int] = {}
    p = len(family.uncertain_names)
    n_var, n_par, n_row = FIRST_RELAXATION + 2 * len(constraints), len(constraints) + len(WEIGHTS), 0
    # ki's own bounds are not bounds of ki' unless alpha is fixed: a row of their own, in units of ki_scale.
    kp, ki, alpha = symbols.head[KP], symbols.head[KI], symbols.head[ALPHA]
    ki_user = ki * scale.omega_rad_s**alpha / scale.gain
    symbols.rows.append(ki_user / symbols.weights[WEIGHTS.index("ki_scale")])
    n_row += 1
    nominal: dict[str, Any] = {}
    for b, block in enumerate(blocks):
        first_frequency[b], first_parameter[b], first_row[b] = n_var, n_par, n_row
        for slot in range(block.capacity):
            theta, v = ca.SX.sym(f"theta{b}_{slot}", p), ca.SX.sym(f"v{b}_{slot}")
            near, side = ca.SX.sym(f"near{b}_{slot}"), ca.SX.sym(f"side{b}_{slot}")
            symbols.parameters += [theta, near, side]
            n_par += p + 2
            if block.has_frequency:
                symbols.variables.append(v)
                n_var += 1
            else:
                symbols.parameters.append(v)
                n_par += 1
            at = SymbolicLoop(*loop(ca.vertcat(kp, ki, alpha), theta, v, near, side))
            if block.kind is SlotKind.CROSSING and slot == 0:
                nominal = {"v": v, "margin": at.phase_margin_rad}
            if block.kind is SlotKind.MEMBER and objective is ObjectiveKind.CROSSOVER_SPREAD:
                at = SymbolicLoop(*loop(ca.vertcat(kp, ki, alpha), theta, nominal["v"], near, side))
            rows = _slot_rows(block, at, v, symbols, constraints, objective, nominal)
            if objective is ObjectiveKind.IAE_DISTURBANCE and block.kind is SlotKind.MEMBER:
                error = log_discounted_error(family, theta, kp / scale.gain, ki_user, alpha, horizon_s)
                rows = [symbols.head[WORST] - error]
            symbols.rows += rows
            n_row += len(rows)
    w = {name: symbols.weights[i] for i, name in enumerate(WEIGHTS)}
    relaxations = ca.sum(symbols.head[FIRST_RELAXATION:])
    cost = (
        w["worst"] * symbols.head[WORST]
        - w["ki"] * ki_user / w["ki_scale"]
        - w["depth"] * symbols.head[DEPTH]
        + w["relaxation"] * relaxations
    )
    cost_and_rows = cost + ca.dot(lam := ca.SX.sym("lam", n_row), ca.vertcat(*symbols.rows))
    prices = ca.Function(
        "prices",
        [ca.vertcat(*symbols.variables), ca.vertcat(*symbols.parameters), lam],
        [ca.gradient(cost_and_rows, symbols.limits)],
    )
    nlp = {
        "x": ca.vertcat(*symbols.variables),
        "p": ca.vertcat(*symbols.parameters),
        "f": cost,
        "g": ca.vertcat(*symbols.rows),
    }
    floor, unstable = _of_corners(family)
    return Problem(
        family, scale, constraints, objective, horizon_s, floor, unstable, blocks,
        ca.nlpsol("design", "ipopt", nlp, IPOPT_OPTIONS), prices,
        n_var, n_par, n_row, first_frequency, first_parameter, first_row,
    )  # fmt: skip


IPOPT_OPTIONS: dict[str, Any] = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "print_time": 0,
    "error_on_fail": False,
    "show_eval_warnings": False,
    "calc_lam_p": False,
    "ipopt.tol": 1e-9,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.acceptable_tol": 1e-7,
    "ipopt.acceptable_constr_viol_tol": 1e-8,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 100,
    "ipopt.max_wall_time": 10.0,
}


def _slot_rows(
    block: Block,
    at: SymbolicLoop,
    v: Any,
    symbols: _Symbols,
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


def _peak_value(objective: ObjectiveKind, at: SymbolicLoop) -> Any:
    """ln of the response whose largest value is the objective; of others ln|S|, whose slots are never in play."""
    if objective is ObjectiveKind.CONTROL_SENSITIVITY_PEAK:
        return at.log_controller - at.log_return_difference
    return -at.log_return_difference


def _equation(block: Block, at: SymbolicLoop, symbols: _Symbols, constraints: tuple[Constraint, ...]) -> Any:
    if block.kind is SlotKind.CROSSING:
        return at.log_gain
    if block.kind is SlotKind.PHASE:
        return at.phase_rad + ca.pi
    k = block.constraints[0]
    up, _ = symbols.relaxation(k)
    # |L| = 1/(the required gain margin, increased by the depth)
    return at.log_gain + symbols.limits[k] + _depth(symbols, constraints[k]) - up


def _side_row(k: int, block: Block, at: SymbolicLoop, symbols: _Symbols, constraints: tuple[Constraint, ...]) -> Any:
    constraint = constraints[k]
    up, down = symbols.relaxation(k)
    if block.kind is SlotKind.LEVEL:
        return at.phase_rad + ca.pi
    distance = (symbols.limits[k] - constraint.quantity.natural(at)) * constraint.scale
    if constraint.bound is Bound.EQUAL:
        return distance + up - down
    return constraint.bound.value * distance - _depth(symbols, constraint) + up


def _depth(symbols: _Symbols, constraint: Constraint) -> Any:
    return symbols.head[DEPTH] if constraint.in_depth else 0.0


def log_discounted_error(family: PlantFamily, theta: Any, kp: Any, ki: Any, alpha: Any, horizon_s: float) -> Any:
    """ln of T |P(s)/(1 + C(s) P(s))| at s = 1/T, as in `fopi_tune.quantities.objectives`."""
    s = 1.0 / horizon_s
    values = {name: theta[i] for i, name in enumerate(family.uncertain_names)}
    numerator, denominator, dead_time = family.assemble(values)
    evaluate: Callable[[list[Any]], Any] = lambda c: sum(a * s ** (len(c) - 1 - i) for i, a in enumerate(c))  # noqa: E731
    plant = evaluate(numerator) / evaluate(denominator) * ca.exp(-s * dead_time)
    controller = kp + ki * horizon_s**alpha
    return ca.log(horizon_s) + 0.5 * ca.log(plant**2) - 0.5 * ca.log((1 + controller * plant) ** 2)


def pack_parameters(limits: Array, weights: dict[str, float]) -> Array:
    """Limits and weights, the parameters before the slots'."""
    return np.concatenate([limits, [weights[name] for name in WEIGHTS]])

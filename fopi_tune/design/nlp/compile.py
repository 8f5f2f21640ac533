"""DesignSpec -> one CasADi NLP with slots, built once and solved many times.

Variables  z = (kp', ki', alpha, worst, depth, relaxation_1 .. relaxation_2n, v_1 .. v_m).  A slot is one plant and one
frequency at which a constraint or the objective is evaluated.  Its plant, frequency, branch of the phase and side of -1
are parameters, so that exchange changes numbers only; `fopi_tune.design.nlp.rows` has the kinds of slots.

An unused slot has infinite bounds and a fixed v.  Every inequality reads  slack - depth + relaxation >= 0  in natural
units: `depth` is the smallest slack when that is the objective, `relaxation` the elastic variable of an elastic solve.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.plant import PlantFamily
from fopi_tune.design.constraints import Constraint, Scale
from fopi_tune.design.nlp import ends
from fopi_tune.design.nlp.rows import (
    ALPHA,
    DEPTH,
    FIRST_RELAXATION,
    KI,
    KP,
    WEIGHTS,
    WORST,
    Block,
    SlotKind,
    Symbols,
    limit_row,
    slot_rows,
    wanted_blocks,
)
from fopi_tune.design.nlp.symbols import SymbolicLoop, loop_function
from fopi_tune.design.reasons import low_frequency_control_gain
from fopi_tune.quantities.objectives import ObjectiveKind


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
    kinds = tuple((s.quantity, s.bound, s.scale, s.from_rad_s < s.to_rad_s, s.in_depth, s.ends) for s in constraints)
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
    symbols = Symbols(constraints)
    loop, limit_loop = loop_function(family, scale), ends.limit_loop(scale)
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
            if block.kind is SlotKind.LIMIT:
                end = ca.SX.sym(f"end{b}_{slot}", ends.WIDTH)
                symbols.parameters.append(end)
                symbols.rows.append(limit_row(block, limit_loop, kp, end, symbols, constraints, objective))
                n_par, n_row = n_par + ends.WIDTH, n_row + 1
                continue
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
            rows = slot_rows(block, at, v, symbols, constraints, objective, nominal)
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

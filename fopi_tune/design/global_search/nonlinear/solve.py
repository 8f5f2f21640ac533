"""One solve of the program:  worst plants and frequencies as slots, within a region around gains."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.design.global_search.compiled import DEPTH, KI
from fopi_tune.design.global_search.nonlinear.controllers import Kind
from fopi_tune.design.global_search.nonlinear.program import ERRORS, INDEX, raising_interrupts, solver_of
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.slots import Slot, idle_slot
from fopi_tune.design.global_search.structures import LARGEST_GAIN

_FREQUENCY_REACH = 1.5
#: multipliers, of a cost whose unit is its own or a neper
_NO_MULTIPLIER, _A_MULTIPLIER = 1e-6, 1e-4


@dataclass(frozen=True)
class Solved:
    """What Ipopt returned: scaled gains, the value of t, multipliers of limits (d cost/d limit), one a row.

    `blocking` are row and v of slots that hold the gains although their limits do not: a peak, or a crossing, that
    would vanish if the gains moved on.  `is_infeasible`: Ipopt found that the slots contradict each other.
    """

    ok: bool
    x: Array
    t: float
    on_boundary: bool
    prices: Array
    blocking: tuple[tuple[int, float], ...] = ()
    is_infeasible: bool = False


def solve(
    problem: Problem, code: int, slots: list[Slot], errors: Array, x: Array, t: float, radius: float, size: int,
    real_rows: int,
) -> Solved:  # fmt: skip
    """One solve of the program with these slots, within a region around x."""
    box, structure = problem.box, problem.structure
    units, count = structure.units(x), len(x)
    z = x / units
    idle = idle_slot(problem.fine_table.members[0], problem.spec.is_measured)
    padded = slots + [idle] * (size - len(slots))
    low, high = np.full(count + 1 + size, -np.inf), np.full(count + 1 + size, np.inf)
    low[0], high[0] = box.kp_low / units[0], box.kp_high / units[0]
    if box.ki_low == 0.0:
        low[1] = 0.0
    if box.ki_high == 0.0 or x[1] == 0.0:
        # with ki = 0 the limits omega -> 0 are others: a start there stays
        high[1] = 0.0
    if x[1] == 0.0:
        low[1] = 0.0
    third = (box.kd_low, box.kd_high) if 2 in structure.gains else (box.alpha_low, box.alpha_high)
    if structure.has_orders:
        third = _derivative_and_orders(problem, x, low, high)
    low[2], high[2] = third[0] / units[2], third[1] / units[2]
    reach = radius * structure.reach(z)
    low[:count], high[:count] = np.maximum(low[:count], z - reach), np.minimum(high[:count], z + reach)
    high[:count] = np.maximum(high[:count], low[:count])
    if code == KI:
        low[count] = high[count] = t = 0.0
    v = np.array([slot.v for slot in padded])
    low[count + 1 :], high[count + 1 :] = v - _FREQUENCY_REACH, v + _FREQUENCY_REACH
    log_ki = -box.log_gain
    scale_ki = max(abs(float(x[1])) * math.exp(log_ki + structure.order(x) * box.log_omega), 1e-12)
    kd = problem.spec.controller.kd
    scale_kd = max(abs(float(x[2])) * math.exp(log_ki - float(x[4]) * box.log_omega), 1e-12) if count > 3 else 1.0
    gains_low = [box.ki_low / scale_ki, kd.min / scale_kd][: 1 + structure.has_orders]
    gains_high = [box.ki_high / scale_ki, kd.max / scale_kd][: 1 + structure.has_orders]
    first = len(gains_low)
    rows_low = np.concatenate([gains_low, np.zeros(size + ERRORS), np.zeros(size)])
    rows_high = np.concatenate([gains_high, np.full(size + ERRORS, np.inf), np.zeros(size)])
    rows_high[first : first + size][[slot.is_equal for slot in padded]] = 0.0
    if problem.spec.controller.has_derivative:
        # rows that are off are 0 whatever the gains are: at a limit of 0 there is no interior point, which costs many
        # steps; with kp + ki s^-alpha specs are known that are solved with it alone
        rows_low[first + size : first + size + ERRORS][errors[:, 2] == 0.0] = -1.0
    weight_t = -1.0 if code == DEPTH else 1.0
    whole = [1.0, 0.0] if code == KI else [0.0, weight_t]
    whole += [log_ki - math.log(scale_ki), box.log_omega, *units[:3].tolist()]
    whole += [log_ki - math.log(scale_kd), -box.log_omega] if structure.has_orders else []
    kind, numbers = Kind.of(problem.scaled.sampling, structure.has_orders)
    kind = kind._replace(peaks=_asks(slots, "peak"), slopes=_asks(slots, "slope"))
    kind = kind._replace(measured=problem.spec.is_measured)
    kind = kind._replace(filtered=problem.scale.measurement_filter is not None and _asks(slots, "log_c"))
    kind = kind._replace(terms=problem.scaled.terms)
    parameters = np.concatenate([np.ravel([slot.p for slot in padded]), errors.ravel(), whole, numbers])
    start = np.clip(np.concatenate([z, [t], v]), low, high)
    solver = solver_of(size, kind)
    with raising_interrupts():
        result = solver(x0=start, p=parameters, lbx=low, ubx=high, lbg=rows_low, ubg=rows_high)
    found = np.array(result["x"]).ravel()
    stats = solver.stats()
    ok = bool(stats["success"]) and bool(np.all(np.isfinite(found)))
    gains = found[:count] * units if ok else x
    lam = np.array(result["lam_g"]).ravel()
    unit_of_cost = scale_ki if code == KI else 1.0
    prices = _prices(padded, lam[first:], size, real_rows) * unit_of_cost
    boundary = bool(np.any(np.abs(found[:count] - z) > 0.999 * reach))
    return Solved(
        ok, gains, float(found[count]), boundary, prices, _blocking(padded, lam[first:], found[count + 1 :]),
        stats["return_status"] == "Infeasible_Problem_Detected",
    )  # fmt: skip


def _asks(slots: list[Slot], name: str) -> bool:
    """Whether a slot has a weight other than 0 under this name."""
    return any(slot.p[INDEX[name]] != 0.0 for slot in slots)


def _blocking(slots: list[Slot], lam: Array, v: Array) -> tuple[tuple[int, float], ...]:
    """Row and v of slots whose equations have a multiplier and whose rows have none."""
    rows, equations = np.abs(lam[: len(slots)]), np.abs(lam[len(slots) + ERRORS :])
    held = (rows < _NO_MULTIPLIER) & (equations > _A_MULTIPLIER)
    free = [slot.row >= 0 and not slot.is_equal and not slot.by_level for slot in slots]
    return tuple((slots[k].row, float(v[k])) for k in np.flatnonzero(held & free))


def _derivative_and_orders(problem: Problem, x: Array, low: Array, high: Array) -> tuple[float, float]:
    """Write the ranges of the orders, and give that of kd' as far as it does not depend on mu.

    An order without its term stays, as it changes nothing.
    """
    controller, kd = problem.spec.controller, problem.spec.controller.kd
    for k, (term, side) in enumerate(((1, controller.alpha), (2, controller.mu)), 3):
        assert side is not None
        low[k], high[k] = (side.min, side.max) if x[term] != 0.0 else (x[k], x[k])
    return 0.0 if kd.min >= 0.0 else -LARGEST_GAIN, 0.0 if kd.max <= 0.0 else LARGEST_GAIN


def _prices(slots: list[Slot], lam: Array, size: int, real_rows: int) -> Array:
    """d cost/d limit of each requirement's row, from the multipliers of rows and of equations that hold a limit."""
    prices = np.zeros(real_rows)
    for k, slot in enumerate(slots):
        if 0 <= slot.row < real_rows:
            if slot.by_level:
                prices[slot.row] += lam[size + ERRORS + k]
            else:
                prices[slot.row] += lam[k] * slot.p[INDEX["sign"]]
    return prices

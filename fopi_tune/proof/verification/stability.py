"""Closed-loop stability of a family:  a count of poles at every sampled member, and |S| bounded between them.

Poles move continuously over the box.  A pole on the imaginary axis would mean a member with |S| = inf.
"""

from __future__ import annotations

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.core.loops import Loops
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import unstable_closed_loop_poles
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError, UnstableLoopError
from fopi_tune.proof.verification.results import Stability
from fopi_tune.proof.verification.sample import Sample, evaluate, with_work
from fopi_tune.proof.verification.worst_case import find_worst_case, loops_ahead, place_of
from fopi_tune.quantities.base import NEPER_PER_DB

#: a loop with a larger |S| counts as one through -1
_LARGEST_SENSITIVITY = 1e6
#: turns of a loop's phase below its highest gain crossover: each has a ripple of every response and a crossing of -180
#: deg, which are searched for every sampled member (about 5 s at this number)
MOST_TURNS = 1_000


def check_stability(sample: Sample) -> Stability:
    """Whether every member of the family is stable, and where the loop comes closest to -1.

    Raises:
        UnstableLoopError: a member is unstable, and its phase turns more than `MOST_TURNS` times below its gain
            crossover.
        DomainError: the same of one that is stable.
    """
    counts, turns = (found[: len(sample.x)] for found in evaluate(loops_ahead(sample)[0], _poles_and_turns))
    _refuse_too_many_turns(sample, turns, counts)
    if (counts > 0.5).any():
        row = sample.nominal if counts[sample.nominal] > 0.5 else int(np.argmax(counts))
        return _unstable(sample, sample.x[row], float(counts[row]))
    worst = find_worst_case(sample, sensitivity_peak, ceiling=float(np.log(_LARGEST_SENSITIVITY)))
    counts = _counts(sample, worst.candidates)
    if (counts > 0.5).any():
        row = int(np.argmax(counts))
        return _unstable(sample, worst.candidates[row], float(counts[row]))
    if worst.value > np.log(_LARGEST_SENSITIVITY):
        return _unstable(sample, worst.x, np.inf)
    peak_db, worst_loop = worst.value / NEPER_PER_DB, sample.nominal_loop
    reason = f"no member has a closed-loop pole {_unstable_side(worst_loop)}; |S| stays below {peak_db + 0.005:.2f} dB"
    return Stability(True, peak_db, worst.place(sample), 0, reason)


def sensitivity_peak(loops: Loops) -> tuple[Array, Array, Array]:
    """ln of the largest |S| over all frequencies, where, and the work; shapes (m,)."""
    found = extremes(loops, Response.SENSITIVITY, 0.0, np.inf)
    return with_work(found.value, found.omega_rad_s, found.cells)


def _counts(sample: Sample, x: Array) -> Array:
    return evaluate(sample.loops_at(x), _poles_and_turns)[0]


def _poles_and_turns(loops: Loops) -> tuple[Array, Array]:
    """Unstable closed-loop poles, and the largest number of turns of arg L at a gain crossover; shapes (m,)."""
    crossings = gain_crossovers(loops)
    turns = np.zeros(len(loops))
    np.maximum.at(turns, crossings.row, np.abs(crossings.phase_rad) / (2.0 * np.pi))
    return unstable_closed_loop_poles(loops), turns


def _refuse_too_many_turns(sample: Sample, turns: Array, counts: Array) -> None:
    row = int(np.argmax(turns))
    if turns[row] <= MOST_TURNS:
        return
    place = place_of(sample, sample.x[row], np.nan)
    plant = ", ".join(f"{name} = {value:.6g}" for name, value in place.plant.items())
    said = f"the loop's phase turns {turns[row]:,.0f} times below its gain crossover{f' with {plant}' if plant else ''}"
    end = (
        f"at most {MOST_TURNS:,} turns, with as many crossings, can be searched: "
        "take smaller gains or a shorter dead time"
    )
    if counts[row] < 0.5:
        raise DomainError(f"{said}; {end}")
    poles = f"{counts[row]:,.0f} closed-loop poles {_unstable_side(sample.nominal_loop)}"
    infinite = "infinitely many unstable poles, or some on the axis"
    raise UnstableLoopError(f"{said}, which leaves {poles if np.isfinite(counts[row]) else infinite}; {end}")


def _unstable(sample: Sample, x: Array, count: float) -> Stability:
    loop = sample.loops_at(x[None, :])
    peak, omega, _ = sensitivity_peak(loop)
    poles = round(count) if np.isfinite(count) else None
    place = place_of(sample, x, float(omega[0]))
    return Stability(False, float(peak[0]) / NEPER_PER_DB, place, poles, _reason(loop, count, float(omega[0])))


def _unstable_side(loop: Loops) -> str:
    return "outside the unit circle" if isinstance(loop, SampledLoops) else "in the right half-plane"


def _reason(loop: Loops, count: float, omega: float) -> str:
    if loop.integral_is_cancelled[0]:
        return "the plant's zero at s = 0 cancels the controller's integral"
    end_gain, _ = loop.log.end()
    if loop.log.slope_end()[0] >= -1e-12 and loop.plants.dead_time_s[0] > 0 and end_gain[0] >= 0:
        return "the direct path around the dead time has |L| >= 1 at high frequencies: infinitely many unstable poles"
    if np.isfinite(count):
        return f"{counted(round(count), 'closed-loop pole')} {_unstable_side(loop)}"
    return f"near omega = {omega:.6g} rad/s the loop cannot be told from one through -1, on the verge of instability"

"""Sections of the commented spec of a plant that was given as a transfer function; the requirements suit its phase.

The controller's sign is that with which  s D(s) + (kp s + ki) N(s)  has a last coefficient of the first one's sign.
Upper limit of the crossover: the highest frequency at which the plant leaves a PI, or if there is none a PID, enough
phase; at most a few times the fastest of its zeros, poles and 1/dead time.  With |S| limited to 6 dB a stable plant
always has gains: small ones.

An unstable plant needs a crossover above its poles, here twice the fastest one, and no controller gets |S| below

    max over its zeros z with Re z > 0 of  prod |z + conj(p)|/|z - p|   over its unstable poles p ,                  (1)

nor |T| below e^(p dead time). Limits of |S| and of the margins leave 4 dB above the larger one.

Source: (1) is the Poisson interpolation bound, Skogestad and Postlethwaite, Multivariable Feedback Control, 2nd ed.,
section 5.3, theorem 5.2 and 5.4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_HALF_EVEN
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.spec.templates.fitted import comment, one_two_five, rounded
from fopi_tune.spec.templates.sections import TemplateSections, digital_section, scenarios_section
from fopi_tune.spec.transfer_functions import WrittenPlant

#: the plant's phase, in degrees, at the highest crossover of a PI (65 are left for margin and integral) and of a PID
_PHASE_PI, _PHASE_PID = -115.0, -170.0
#: degrees of its phase that a plant which leaves even a PID little may lose at the highest crossover
_LESS = 15.0
#: the highest crossover over the fastest rate of the plant
_FASTER = 3.0
#: rad of phase that a sample may cost at the highest crossover, twice
_PHASE_OF_A_SAMPLE = 0.08
#: the highest crossover over the fastest unstable pole, at least
_ABOVE_POLE = 2.0
#: dB by which limits of |S| leave room above what no controller can do
_ABOVE_FLOOR_DB = 4.0
#: times a pole's rate; with a longer dead time no controller will do
_LONGEST = 5.0
#: of one part of the scenario
_MOST_SAMPLES = 10_000


def sections_for_written(plant: WrittenPlant, about: Sequence[str]) -> TemplateSections:
    """Sections for a plant whose numbers are known.

    Args:
        plant: proper, its common factors left out.
        about: the origin of the numbers, lines of text.
    """
    facts = _facts(plant)
    crossover, derivative = _crossover(facts)
    step = one_two_five(_PHASE_OF_A_SAMPLE / crossover)
    power = math.floor(math.log10(crossover))
    side = "min: 0.0" if facts.sign > 0 else "max: 0.0"
    model, text, last_name = _plant_text(plant)
    # a zero at 0 takes the integral away: no gain crossover is certain
    limit = f"{{at_most: {crossover!r}}}"
    speed = "" if facts.zeros_at_0 else f"  {f'- crossover_rad_s: {limit}':<41} # no faster than the plant allows\n"
    return TemplateSections(
        model=model,
        description="Robust control of a plant given by its transfer function.",
        plant=comment(about) + text,
        controller=_controller(side, derivative, (0.1 if facts.unstable else 0.2) / crossover, step),
        requirements=_requirements(speed, facts),
        objective="objective: {minimize: iae_disturbance}   # a load on the plant is taken away as well as possible",
        digital=digital_section(repr(step), f"[{10.0 ** (power - 3):.1e}, {10.0 ** (power + 4):.1e}]"),
        scenarios=_scenario(plant, facts, crossover, step),
        uncertain_name=last_name,
    )


@dataclass(frozen=True)
class _Facts:
    """What the requirements are chosen by.

    Args:
        sign: of the controller's gains.
        poles_at_0: integrators.
        zeros_at_0: zeros of the numerator there.
        unstable: poles with a real part above 0.
        omega: frequencies, rad/s, shape (n,).
        phase: of `sign` times the plant, degrees, continuous from that of a PI's plant on, shape (n,).
        fastest: the largest rate, rad/s; 1 of a plant without any.
        slowest: the smallest, rad/s.
        fastest_unstable: the largest rate of a pole with a real part above 0, rad/s; 0 without one.
        least_peak: below which no controller gets the largest |S| and |T|; (1).
    """

    sign: int
    poles_at_0: int
    zeros_at_0: int
    unstable: int
    omega: Array
    phase: Array
    fastest: float
    slowest: float
    fastest_unstable: float
    least_peak: float

    @property
    def is_hard(self) -> bool:
        """Whether small gains do not do."""
        return self.unstable > 0 or self.poles_at_0 > 1


def _facts(plant: WrittenPlant) -> _Facts:
    top, bottom, delay = plant.numerator, plant.denominator, float(plant.dead_time_s)
    zeros, poles = (_roots_off_0(each) for each in (top, bottom))
    ends = [len(each) - len(_without_last_zeros(each)) for each in (top, bottom)]
    sign = 1 if _without_last_zeros(top)[-1] * bottom[0] > 0 else -1
    rates = [*np.abs(zeros).tolist(), *np.abs(poles).tolist(), *([1.0 / delay] if delay > 0.0 else [])]
    middle = rates or [_unit_gain(plant, ends[1])]
    omega = np.geomspace(1e-3 * min(middle), 1e3 * max(middle), 2000)
    # (1 - j omega/z) for zeros, (j omega - p) for poles: N's last coefficient and D's first one are > 0 then
    angle = np.zeros_like(omega)
    for zero in zeros:
        angle = angle + np.angle(1.0 - 1j * omega / zero)
    for pole in poles:
        angle = angle - np.angle(1j * omega - pole)
    angle = np.unwrap(angle) + 0.5 * math.pi * (ends[0] - ends[1]) - omega * delay
    right = poles[poles.real > 0.0]
    beside = zeros[zeros.real > 0.0]
    peaks = [float(np.prod(np.abs((z + right.conj()) / (z - right)))) for z in beside]
    peaks += [math.exp(min(float(p.real) * delay, _LONGEST)) for p in right]
    fastest = float(np.abs(right).max(initial=0.0))
    return _Facts(
        sign, ends[1], ends[0], len(right), omega, np.degrees(angle), max(middle), min(middle), fastest,
        max([1.0, *peaks]),
    )  # fmt: skip


def _roots_off_0(coefficients: tuple[Fraction, ...]) -> NDArray[np.complex128]:
    return np.roots([float(value) for value in _without_last_zeros(coefficients)]).astype(complex)


def _without_last_zeros(coefficients: tuple[Fraction, ...]) -> tuple[Fraction, ...]:
    last = max(k for k, value in enumerate(coefficients) if value)
    return coefficients[: last + 1]


def _unit_gain(plant: WrittenPlant, integrators: int) -> float:
    """Where k/s^n has the gain 1, rad/s."""
    size = abs(float(plant.numerator[0] / plant.denominator[0]))
    return size ** (1.0 / integrators) if integrators else 1.0


def _crossover(facts: _Facts) -> tuple[float, bool]:
    """The upper limit of the crossover, rad/s, and whether it takes a derivative."""
    reached = facts.omega <= _FASTER * facts.fastest
    best = float(facts.phase[reached].max())
    least, derivative = (_PHASE_PI, False) if best >= _PHASE_PI else (min(_PHASE_PID, best - _LESS), True)
    enough = np.flatnonzero((facts.phase >= least) & reached)
    highest = max(float(facts.omega[enough[-1]]), _ABOVE_POLE * facts.fastest_unstable)
    return rounded(highest, 2, ROUND_CEILING), derivative


def _requirements(speed: str, facts: _Facts) -> str:
    """The section, with the entry of the crossover's limit that is given."""
    phase, gain, peak = (40, 5, 8) if facts.is_hard else (50, 6, 6)
    floor = 20.0 * math.log10(facts.least_peak)
    about = ""
    if floor + _ABOVE_FLOOR_DB > peak:
        peak = math.ceil(floor + _ABOVE_FLOOR_DB)
        # |S| <= M alone gives a phase margin of 2 asin(1/(2M)) and a gain margin of M/(M - 1)
        largest = 10.0 ** (peak / 20.0)
        phase = math.floor(math.degrees(2.0 * math.asin(0.5 / largest)))
        gain = math.floor(200.0 * math.log10(largest / (largest - 1.0))) / 10.0
        about = f"; with any controller it exceeds {math.floor(10.0 * floor) / 10.0:g} dB"
    return f"""\
requirements:
{speed}  - phase_margin_deg: {{at_least: {phase}}}        # damping of the loop
  - gain_margin_db: {{at_least: {gain}}}           # the gain may be so much larger
  - sensitivity_db: {{at_most: {peak}}}            # distance from -1{about}
"""


def _scenario(plant: WrittenPlant, facts: _Facts, crossover: float, step: float) -> str:
    """A step to 1, and in its middle a load that asks for a fifth of the control that holds it.

    Of a plant that has no gain at rest the gain at the highest crossover counts.  Each part lasts some times as long as
    the slowest of the loop's own and the plant's motions, but no more samples than are quickly simulated.
    """
    ends = float(plant.numerator[-1]), float(plant.denominator[-1])
    gain = ends[0] / ends[1] if all(ends) else abs(_response(plant, crossover))
    longest = max(40.0 / crossover, 8.0 / facts.slowest)
    part = rounded(min(longest, _MOST_SAMPLES * step), 2, ROUND_CEILING)
    return scenarios_section(repr(2 * part), "1.0", (repr(part), repr(rounded(-0.2 / gain, 2, ROUND_HALF_EVEN))))


def _response(plant: WrittenPlant, omega: float) -> complex:
    top, bottom = (np.polyval([float(c) for c in side], 1j * omega) for side in (plant.numerator, plant.denominator))
    return complex(top / bottom)


def _controller(side: str, derivative: bool, filter_time: float, step: float) -> str:
    gains = f"controller:\n  {f'kp: {{{side}}}':<27} # of the plant's sign\n  ki: {{{side}}}\n"
    if not derivative:
        return gains + "  alpha: {min: 0.7, max: 1.3}\n"
    # a derivative on samples takes a filter of half a sample at least
    filtered = one_two_five(max(filter_time, step))
    return (
        gains.replace(
            "controller:\n", "controller:\n  structure: pid              # integral alone leaves too little phase\n"
        )
        + f"  kd: {{{side}}}\n  derivative_filter_time_constant_s: {filtered!r}\n"
    )


def _plant_text(plant: WrittenPlant) -> tuple[str, str, str]:
    """The model, its section, and the name of one of its numbers."""
    top, bottom, last = plant.numerator, plant.denominator, f"  dead_time_s: {_number(plant.dead_time_s)}\n"
    known = "  # {min: ..., max: ...} where it is not exactly known\n"
    if len(top) == 1 and len(bottom) == 2 and bottom[0] == 1:
        numbers = f"  gain: {_number(top[0])}{known}  pole_rad_s: {_number(bottom[1])}\n"
        return (
            "pole",
            f"plant:\n  model: pole                 # gain e^(-dead_time_s s) / (s + pole_rad_s)\n{numbers}{last}",
            "gain",
        )
    if len(top) == 1 and len(bottom) == 2 and bottom[0] > 0 and bottom[1] == 1:
        numbers = f"  static_gain: {_number(top[0])}{known}  time_constant_s: {_number(bottom[0])}\n"
        about = "# static_gain e^(-dead_time_s s) / (time_constant_s s + 1)"
        return "lag", f"plant:\n  model: lag                  {about}\n{numbers}{last}", "static_gain"
    lists = "".join(
        f"  {name}: [{', '.join(_number(value) for value in side)}]\n"
        for name, side in (("numerator", top), ("denominator", bottom))
    )
    about = "# numerator(s) / denominator(s) e^(-dead_time_s s), in descending powers of s;\n"
    more = "                              # {min: ..., max: ...} stands for a coefficient that is not exactly known\n"
    return "transfer_function", f"plant:\n  model: transfer_function    {about}{more}{lists}{last}", '"numerator[0]"'


def _number(value: Fraction) -> str:
    """The nearest floating-point number, which is the decimal that was written where it was one."""
    found = float(value)
    return repr(int(found)) if found.is_integer() and abs(found) < 1e6 else repr(found)

"""Sections of the commented spec of plants that were fitted to recordings; the requirements suit their times."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Context

from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.spec.templates.sections import TemplateSections, digital_section, scenarios_section

#: columns of a comment
_WIDTH = 116
_DESCRIPTIONS = {
    "lag": "Robust fractional PI for a lag whose numbers come from recordings.",
    "pole": "Robust fractional PI for an integrator whose numbers come from recordings.",
    "transfer_function": "Robust fractional PI for a second-order plant whose numbers come from recordings.",
}


def sections_for_fitted(plant: PlantFamily, about: Sequence[str]) -> TemplateSections:
    """Sections for a fitted family: lags, second-order transfer functions, or integrators.

    Crossover: the lower limit wc, in rad/s, is 0.84 over the longest time constant; for a second order also at most a
    share of the damping of its resonance.  It is lower where dead time and the spread of the plants' speeds would cost
    more than 0.4 rad of phase (0.2 rad for an integrator, which has less of it).  The upper limit is three times the
    crossover of the fastest plant under a controller that gives the slowest one wc; it keeps the search near these
    speeds.

    Sensitivity: far below wc a loop with alpha = 1 has about |S(jw)| = w/wc.  With a smaller alpha it has (w/wc)^alpha,
    and the step response approaches its final value as slowly as t^-alpha.  So |S| is limited to -20 dB up to wc/12 and
    to -40 dB up to wc/100, which a loop with a small alpha can hardly meet.  For an integrator it is -60 dB, which a
    loop without integral action cannot meet.

    Sample time: about 1/50 of time constant plus dead time, or 1/12 of 1 / (geometric mean of the crossover limits)
    where that is longer, because a dead time of many samples makes the sampled loop hard to prove.

    Scenario: a step to 1, and in its middle a load that asks for a fifth of the control that holds it, or of an
    integrator, which needs none, of wc over its gain.  Each lasts 15/wc, some 18 times the longest time constant.

    Args:
        plant: of model `lag`, `transfer_function` with a denominator of second degree, or `pole` at 0.
        about: the origin of the numbers, lines of text.
    """
    numbers = plant.parameters
    gain, dead = next(iter(numbers.values())), numbers["dead_time_s"]
    slowest, fastest, scale = _speeds(plant.model, numbers)
    middle, low = rounded(slowest / 12, 2, ROUND_FLOOR), rounded(slowest / 100, 2, ROUND_FLOOR)
    band = [10.0 ** math.floor(math.log10(1e-3 / scale)), 10.0 ** math.ceil(math.log10(1e3 / scale))]
    sample_time_s = one_two_five(max(scale / 50, 0.08 / math.sqrt(slowest * fastest)))
    side = "min: 0.0" if gain.nominal > 0 else "max: 0.0"
    slow_db, slow_why = _SLOW.get(plant.model, _SLOW["lag"])
    wide = [name for name, number in numbers.items() if "{" in _yaml_number(number)]
    return TemplateSections(
        model=plant.model,
        description=_DESCRIPTIONS[plant.model],
        plant=comment(about) + _plant_text(plant.model, numbers, dead),
        controller=f"""\
controller:
  {f"kp: {{{side}}}":<27} # of the plant's sign
  ki: {{{side}}}
  alpha: {{min: 0.7, max: 1.3}}
""",
        requirements=f"""\
requirements:
  {f"- crossover_rad_s: {{between: [{slowest!r}, {fastest!r}]}}":<41} # speed of every loop
  - phase_margin_deg: {{at_least: {_PHASE_MARGIN_DEG[plant.model]}}}        # its damping
  - gain_margin_db: {{at_least: 6}}           # the gain may be twice as large
  - sensitivity_db: {{at_most: -20}}          # a load on the plant and the way to a new reference die out in time:
    {f"to_rad_s: {middle!r}":<39} # what changes this slowly is reduced to a tenth,
  {f"- sensitivity_db: {{at_most: {slow_db}}}":<41} # and slower still {slow_why}
    to_rad_s: {low!r}
  - sensitivity_db: {{at_most: 6}}            # distance from -1: no disturbance is made more than twice as large
""",
        objective="""\
# objective: {minimize: iae_disturbance}     # without it, room is left on all sides""",
        digital=digital_section(repr(sample_time_s), f"[{band[0]:.1e}, {band[1]:.1e}]"),
        scenarios=_scenario(slowest, gain.nominal / (slowest if plant.model == "pole" else 1.0)),
        uncertain_name=f'"{wide[0]}"' if wide and "[" in wide[0] else wide[0] if wide else "dead_time_s",
    )


def _scenario(crossover: float, gain: float) -> str:
    """A step and a load for a crossover, rad/s, and a plant's gain at rest, or of an integrator at the crossover."""
    part = rounded(15 / crossover, 2, ROUND_CEILING)
    return scenarios_section(repr(2 * part), "1.0", (repr(part), repr(rounded(-0.2 / gain, 2, ROUND_HALF_EVEN))))


#: limit of |S| far below the crossover, in dB, and what it is for.  An integrator has 40 dB there without integral
#: action, which alone takes the error of a constant load away; 60 dB ask for it
_SLOW = {
    "lag": (-40, "to a hundredth, without which the last per cents creep"),
    "pole": (-60, "to a thousandth, which takes integral action"),
}
_PHASE_MARGIN_DEG = {"lag": 60, "pole": 50, "transfer_function": 60}


def comment(about: Sequence[str]) -> str:
    """Lines of a comment, broken where they are long."""
    # control characters, as in a file's name, are escaped: nothing leaves the comment
    lines = ("".join(c if c.isprintable() else repr(c)[1:-1] for c in line) for line in about)
    wrapped = (part for line in lines for part in textwrap.wrap(line, _WIDTH, subsequent_indent="  "))
    return "".join(f"# {part}\n" for part in wrapped)


def _plant_text(model: str, numbers: Mapping[str, Uncertain], dead: Uncertain) -> str:
    last = f"  dead_time_s: {_yaml_number(dead)}\n"
    if model == "lag":
        return f"""\
plant:
  model: lag                  # static_gain e^(-dead_time_s s) / (time_constant_s s + 1)
  static_gain: {_yaml_number(numbers["static_gain"])}
  time_constant_s: {_yaml_number(numbers["time_constant_s"])}
{last}"""
    if model == "pole":
        return f"""\
plant:
  model: pole                 # gain e^(-dead_time_s s) / (s + pole_rad_s)
  gain: {_yaml_number(numbers["gain"])}
  pole_rad_s: 0.0             # an integrator
{last}"""
    square, linear = (_yaml_number(numbers[f"denominator[{k}]"]) for k in (0, 1))
    return f"""\
plant:
  model: transfer_function    # numerator(s) / denominator(s) e^(-dead_time_s s), in descending powers of s
  numerator: [{_yaml_number(numbers["numerator[0]"])}]
  denominator: [{square}, {linear}, 1.0]
{last}"""


def _speeds(model: str, numbers: Mapping[str, Uncertain]) -> tuple[float, float, float]:
    """The lower and the upper limit of the crossover, rad/s, and the plants' time scale, s."""
    gain, dead = next(iter(numbers.values())), numbers["dead_time_s"]
    gains = sorted((abs(gain.min), abs(gain.max)))
    spread = gains[1] / gains[0]
    if model == "pole":
        # the dead time is all that limits the speed; one of 0 says nothing of it
        crossover = 0.2 / (dead.max * spread) if dead.max > 0 else 0.2
        scale = 1.0 / crossover
    else:
        # of a second order the sum of its time constants
        time = numbers["time_constant_s" if model == "lag" else "denominator[1]"]
        # ratio of the fastest plant's speed to the slowest one's under the same controller; dead time reduces it
        spread *= (time.max + dead.nominal) / (time.min + dead.nominal)
        crossover = 0.84 / time.max
        scale = time.nominal + dead.nominal
        if dead.max > 0:
            crossover = min(crossover, 0.4 / (dead.max * spread))
        if model == "transfer_function":
            # zeta w0 = a1 / (2 a2): a resonance must stay below the loop's gain margin
            square = numbers["denominator[0]"]
            crossover = min(crossover, 0.25 * time.min / (square.max * spread))
            scale = max(scale, math.sqrt(square.nominal) + dead.nominal)
    return rounded(crossover, 2, ROUND_FLOOR), rounded(3 * spread * crossover, 2, ROUND_CEILING), scale


def _yaml_number(number: Uncertain) -> str:
    """Six significant digits, the ends rounded outwards; one number where that leaves no range."""
    nominal = rounded(number.nominal, 6, ROUND_HALF_EVEN)
    low, high = rounded(number.min, 6, ROUND_HALF_EVEN), rounded(number.max, 6, ROUND_HALF_EVEN)
    if low == nominal == high:
        return repr(nominal)
    low, high = rounded(number.min, 6, ROUND_FLOOR), rounded(number.max, 6, ROUND_CEILING)
    return f"{{nominal: {nominal!r}, min: {low!r}, max: {high!r}}}"


def rounded(value: float, digits: int, how: str) -> float:
    """A number to so many significant digits; `how` is a rounding of `decimal`."""
    return float(Context(prec=digits, rounding=how).create_decimal(repr(value)))


def one_two_five(longest: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is at most this."""
    power = math.floor(math.log10(longest))
    steps = [float(f"{digit}e{power}") for digit in (1, 2, 5)]
    return max([step for step in steps if step <= longest], default=steps[0])

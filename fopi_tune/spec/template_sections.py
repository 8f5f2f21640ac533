"""Sections of the commented spec that depend on the plant: an example for each model, or a fitted lag."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Context

from fopi_tune.core.plant import Uncertain


@dataclass(frozen=True)
class TemplateSections:
    """The plant-dependent sections of a spec, as YAML with comments and without the last line break.

    Args:
        model: the word after `model:`.
        description: one sentence.
        plant: the section, as are `controller`, `requirements`, `objective` (which may be a comment) and `digital`.
        uncertain_name: one of its uncertain numbers, for the examples of distributions; quoted where YAML needs it.
    """

    model: str
    description: str
    plant: str
    controller: str
    requirements: str
    objective: str
    digital: str
    uncertain_name: str

    def texts(self) -> dict[str, str]:
        """The texts by their names, without the model."""
        return {name: text.rstrip() for name, text in vars(self).items() if name != "model"}


def _digital_section(sample_time_s: str, band_rad_s: str, design: str) -> str:
    about = "the requirements are about the loop on samples; or continuous"
    if design == "continuous":
        about = "the requirements are about the loop without samples; or sampled"
    return f"""\
digital:
  {f"sample_time_s: {sample_time_s}":<27} # short against 1 / crossover_rad_s
  method: oustaloup           # or modified_oustaloup, fit
  poles: 7                    # of the approximation of s^(1-alpha)
  {f"band_rad_s: {band_rad_s}":<27} # where it holds
  rule: tustin                # or matched
  delay_samples: 0            # computing delay
  {f"design: {design}":<27} # {about}
"""


_GAINS = """\
controller:
  kp: {min: 0.0, max: 10.0}
  ki: {min: 0.0, max: 10.0}
  alpha: {min: 0.3, max: 1.5}
"""

_LAG = TemplateSections(
    model="lag",
    description="Robust fractional PI for a first-order lag whose time constant is uncertain.",
    plant="""\
plant:
  model: lag                  # static_gain e^(-dead_time_s s) / (time_constant_s s + 1)
  static_gain: 1.0            # output unit per control unit
  time_constant_s: {nominal: 2.25, min: 1.6, max: 3.1}
  dead_time_s: 0.0            # 0 when left out
""",
    controller=_GAINS,
    requirements="""\
requirements:
  - crossover_rad_s: {equals: 0.3}          # speed of the nominal loop
    on: nominal
  - phase_margin_deg: {equals: 90}          # its damping
    on: nominal
  - phase_margin_deg: {at_least: 80}        # and that of every other plant
  - gain_margin_db: {at_least: 12.04}       # the gain may be 4 times as large
  - sensitivity_db: {at_most: -20}          # slow disturbances are reduced to a tenth
    to_rad_s: 0.02
  - sensitivity_db: {at_most: -40}          # and slower ones to a hundredth, without which the last per cents creep
    to_rad_s: 0.0025
""",
    objective="objective: {minimize: phase_margin_spread_deg}",
    digital=_digital_section("0.2", "[1.0e-3, 1.0e3]", "sampled"),
    uncertain_name="time_constant_s",
)

_POLE = TemplateSections(
    model="pole",
    description="Robust fractional PI for a first-order plant whose gain is uncertain, given by its pole.",
    plant="""\
plant:
  model: pole                 # gain e^(-dead_time_s s) / (s + pole_rad_s)
  gain: {nominal: 4.39, min: 3.9, max: 4.9}   # output unit per second and control unit
  pole_rad_s: 0.1746          # 1 / time constant; 0 is an integrator, below 0 is unstable
  dead_time_s: 0.0            # 0 when left out
""",
    controller=_GAINS,
    requirements="""\
requirements:
  - crossover_rad_s: {equals: 0.46}         # speed of the nominal loop
    on: nominal
  - phase_margin_deg: {at_least: 75}        # damping of every plant
  - gain_margin_db: {at_least: 12.04}       # the gain may be 4 times as large
  - sensitivity_db: {at_most: -20}          # slow disturbances are reduced to a tenth
    to_rad_s: 0.03
  - sensitivity_db: {at_most: -40}          # and slower ones to a hundredth, without which the last per cents creep
    to_rad_s: 0.003
""",
    objective="objective: {maximize: ki}",
    digital=_digital_section("0.1", "[1.0e-3, 1.0e3]", "sampled"),
    uncertain_name="gain",
)

_TRANSFER_FUNCTION = TemplateSections(
    model="transfer_function",
    description="Robust fractional PI for a second-order plant whose damping is uncertain.",
    plant="""\
plant:
  model: transfer_function    # numerator(s) / denominator(s) e^(-dead_time_s s), in descending powers of s
  numerator: [1.0]
  denominator: [1.0, {nominal: 1.2, min: 0.9, max: 1.5}, 1.0]   # s^2 + (0.9 ... 1.5) s + 1
  dead_time_s: 0.05           # 0 when left out
""",
    # with a larger alpha the search for the gains deepest inside trades a slow final approach for phase margin
    controller=_GAINS.replace("{min: 0.3, max: 1.5}", "{min: 0.7, max: 1.05}"),
    requirements="""\
requirements:
  - crossover_rad_s: {at_least: 0.3}        # speed of every loop
  - phase_margin_deg: {at_least: 55}        # its damping
  - gain_margin_db: {at_least: 6}           # the gain may be twice as large
  - sensitivity_db: {at_most: -20}          # slow disturbances are reduced to a tenth
    to_rad_s: 0.04
  - sensitivity_db: {at_most: -40}          # and slower ones to a hundredth, without which the last per cents creep
    to_rad_s: 0.004
  - sensitivity_db: {at_most: 5}            # distance from -1: no disturbance is made much larger
""",
    objective="""\
# objective: {minimize: iae_disturbance}     # without it there is room left, which the loop on samples needs""",
    digital=_digital_section("0.05", "[1.0e-3, 1.0e3]", "continuous"),
    uncertain_name='"denominator[1]"',
)

#: model -> sections that `fopi init --plant MODEL` writes
SECTIONS_BY_MODEL = {start.model: start for start in (_LAG, _POLE, _TRANSFER_FUNCTION)}


def sections_for_fitted_lag(
    static_gain: Uncertain, time_constant_s: Uncertain, dead_time_s: Uncertain, about: Sequence[str]
) -> TemplateSections:
    """Sections for a fitted family of lags; the requirements suit its time constants and dead times.

    Crossover: the lower limit wc, in rad/s, is 0.84 over the longest time constant.  It is lower where dead time and
    the spread of the plants' speeds would cost more than 0.4 rad of phase.  The upper limit is three times the
    crossover of the fastest plant under a controller that gives the slowest one wc; it keeps the search near these
    speeds.

    Sensitivity: far below wc a loop with alpha = 1 has about |S(jw)| = w/wc.  With a smaller alpha it has (w/wc)^alpha,
    and the step response approaches its final value as slowly as t^-alpha.  So |S| is limited to -20 dB up to wc/12 and
    to -40 dB up to wc/100, which a loop with a small alpha can hardly meet.

    Sample time: about 1/50 of time constant plus dead time, or 1/12 of 1 / (geometric mean of the crossover limits)
    where that is longer, because a dead time of many samples makes the sampled loop hard to prove.

    Args:
        static_gain: output unit per input unit; its range does not hold 0.
        time_constant_s: s, > 0.
        dead_time_s: s, >= 0.
        about: the origin of the numbers, as lines of a comment.
    """
    slowest, fastest = _crossover_limits(static_gain, time_constant_s, dead_time_s)
    middle, low = _rounded(slowest / 12, 2, ROUND_FLOOR), _rounded(slowest / 100, 2, ROUND_FLOOR)
    scale = time_constant_s.nominal + dead_time_s.nominal
    band = [10.0 ** math.floor(math.log10(1e-3 / scale)), 10.0 ** math.ceil(math.log10(1e3 / scale))]
    sample_time_s = _sample_time(max(scale / 50, 0.08 / math.sqrt(slowest * fastest)))
    side = "min: 0.0" if static_gain.nominal > 0 else "max: 0.0"
    uncertain = {"static_gain": static_gain, "time_constant_s": time_constant_s, "dead_time_s": dead_time_s}
    wide = [name for name, number in uncertain.items() if "{" in _yaml_number(number)]
    comments = "".join(f"# {line}\n" for line in about)
    return TemplateSections(
        model="lag",
        description="Robust fractional PI for a lag whose numbers come from recorded step responses.",
        plant=f"""\
{comments}plant:
  model: lag                  # static_gain e^(-dead_time_s s) / (time_constant_s s + 1)
  static_gain: {_yaml_number(static_gain)}
  time_constant_s: {_yaml_number(time_constant_s)}
  dead_time_s: {_yaml_number(dead_time_s)}
""",
        controller=f"""\
controller:
  {f"kp: {{{side}}}":<27} # of the static gain's sign
  ki: {{{side}}}
  alpha: {{min: 0.7, max: 1.3}}
""",
        requirements=f"""\
requirements:
  {f"- crossover_rad_s: {{between: [{slowest!r}, {fastest!r}]}}":<41} # speed of every loop
  - phase_margin_deg: {{at_least: 60}}        # its damping
  - gain_margin_db: {{at_least: 6}}           # the gain may be twice as large
  - sensitivity_db: {{at_most: -20}}          # a load on the plant and the way to a new reference die out in time:
    {f"to_rad_s: {middle!r}":<39} # what changes this slowly is reduced to a tenth,
  - sensitivity_db: {{at_most: -40}}          # and slower still to a hundredth, without which the last per cents creep
    to_rad_s: {low!r}
  - sensitivity_db: {{at_most: 6}}            # distance from -1: no disturbance is made more than twice as large
""",
        objective="""\
# objective: {minimize: iae_disturbance}     # without it there is room left, which the loop on samples needs""",
        digital=_digital_section(repr(sample_time_s), f"[{band[0]:.1e}, {band[1]:.1e}]", "continuous"),
        uncertain_name=wide[0] if wide else "time_constant_s",
    )


def _crossover_limits(
    static_gain: Uncertain, time_constant_s: Uncertain, dead_time_s: Uncertain
) -> tuple[float, float]:
    """The lower and the upper limit of the crossover, rad/s."""
    gains = sorted((abs(static_gain.min), abs(static_gain.max)))
    # ratio of the fastest plant's speed to the slowest one's under the same controller; dead time reduces it
    dead = dead_time_s.nominal
    spread = gains[1] / gains[0] * (time_constant_s.max + dead) / (time_constant_s.min + dead)
    crossover = 0.84 / time_constant_s.max
    if dead_time_s.max > 0:
        crossover = min(crossover, 0.4 / (dead_time_s.max * spread))
    return _rounded(crossover, 2, ROUND_FLOOR), _rounded(3 * spread * crossover, 2, ROUND_CEILING)


def _yaml_number(number: Uncertain) -> str:
    """Six significant digits, the ends rounded outwards; one number where that leaves no range."""
    nominal = _rounded(number.nominal, 6, ROUND_HALF_EVEN)
    low, high = _rounded(number.min, 6, ROUND_HALF_EVEN), _rounded(number.max, 6, ROUND_HALF_EVEN)
    if low == nominal == high:
        return repr(nominal)
    low, high = _rounded(number.min, 6, ROUND_FLOOR), _rounded(number.max, 6, ROUND_CEILING)
    return f"{{nominal: {nominal!r}, min: {low!r}, max: {high!r}}}"


def _rounded(value: float, digits: int, how: str) -> float:
    return float(Context(prec=digits, rounding=how).create_decimal(repr(value)))


def _sample_time(longest: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is at most this."""
    power = math.floor(math.log10(longest))
    steps = [float(f"{digit}e{power}") for digit in (1, 2, 5)]
    return max([step for step in steps if step <= longest], default=steps[0])

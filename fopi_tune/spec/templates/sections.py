"""Sections of the commented spec that depend on the plant:  an example for each model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class TemplateSections:
    """The plant-dependent sections of a spec, as YAML with comments and without the last line break.

    Args:
        model: the word after `model:`.
        description: one sentence.
        plant: the section, as are `controller`, `requirements`, `objective` (which may be a comment), `digital` and
            `scenarios` (with `limits`, which may be a comment).
        uncertain_name: one of its uncertain numbers, for the examples of distributions; quoted where YAML needs it.
    """

    model: str
    description: str
    plant: str
    controller: str
    requirements: str
    objective: str
    digital: str
    scenarios: str
    uncertain_name: str

    def texts(self) -> dict[str, str]:
        """The texts by their names, without the model."""
        return {name: text.rstrip() for name, text in vars(self).items() if name != "model"}


def digital_section(sample_time_s: str, band_rad_s: str, output_limits: str | None = None) -> str:
    """The section `digital` of a design of the loop on samples.

    Args:
        sample_time_s: s.
        band_rad_s: where the approximation holds, rad/s.
        output_limits: of the control, in its unit; None where they are not known, and then a comment.
    """
    limits = "# output_limits: [-1.0, 1.0]" if output_limits is None else f"output_limits: {output_limits}"
    return f"""\
digital:
  {f"sample_time_s: {sample_time_s}":<27} # short against 1 / crossover_rad_s
  method: oustaloup           # or modified_oustaloup, fit
  poles: 7                    # of the approximation of s^(1-alpha)
  {f"band_rad_s: {band_rad_s}":<27} # where it holds
  rule: tustin                # or matched
  delay_samples: 0            # computing delay
  design: sampled             # the requirements are about the loop on samples; or continuous
  {limits:<27} # of the control; also in the exported C code
  # measurement_unit: km/h
"""


def scenarios_section(duration_s: str, reference: str, load: tuple[str, str], limits: Sequence[str] = ()) -> str:
    """The sections `scenarios` and `limits`: a step of the reference, then a load.

    Args:
        duration_s: s.
        reference: setpoint from 0 s on, output unit.
        load: from when on, s, and how much, control unit.
        limits: entries of `limits`, with comments; an example in a comment where there are none.
    """
    judged = "".join(f"  - {entry}\n" for entry in limits)
    return f"""\
scenarios:
  - name: step_and_load
    duration_s: {duration_s}
    {f"reference: [{{at_s: 0, value: {reference}}}]":<45} # a new setpoint, in the output's unit
    {f"load: [{{at_s: {load[0]}, value: {load[1]}}}]":<45} # then a disturbance at the plant's input, control's unit
    # noise_std: 0.01           # of the measurement; also quantum, rate_per_s (of the control), initial_output
{"limits:" if judged else "# limits:"}
{judged or "#   - overshoot: {at_most: 0.2}"}"""


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
    digital=digital_section("0.2", "[1.0e-3, 1.0e3]", "[-2.0, 2.0]"),
    scenarios=scenarios_section(
        "120",
        "1.0",
        ("60", "-0.2"),
        ("overshoot: {at_most: 0.1}                # beyond the setpoint", "final_error: {at_most: 0.02}"),
    ),
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
    digital=digital_section("0.1", "[1.0e-3, 1.0e3]", "[-1.0, 1.0]"),
    scenarios=scenarios_section(
        "120",
        "10.0",
        ("60", "-0.1"),
        ("overshoot: {at_most: 1.0}                # beyond the setpoint", "final_error: {at_most: 0.2}"),
    ),
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
# objective: {minimize: iae_disturbance}     # without it, room is left on all sides""",
    digital=digital_section("0.05", "[1.0e-3, 1.0e3]", "[-2.0, 2.0]"),
    scenarios=scenarios_section(
        "80",
        "1.0",
        ("40", "-0.2"),
        ("overshoot: {at_most: 0.2}                # beyond the setpoint", "final_error: {at_most: 0.02}"),
    ),
    uncertain_name='"denominator[1]"',
)

#: model -> sections that `fopi init --plant MODEL` writes
SECTIONS_BY_MODEL = {start.model: start for start in (_LAG, _POLE, _TRANSFER_FUNCTION)}

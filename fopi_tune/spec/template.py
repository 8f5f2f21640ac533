"""The commented spec that `fopi init` writes."""

from __future__ import annotations

import re

from fopi_tune.errors import DomainError
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.objectives import OBJECTIVES
from fopi_tune.spec.language import NAME_PATTERN, NAME_RULE, SCHEMA_VERSION
from fopi_tune.spec.report import quoted

_TEMPLATE = """\
# A spec for fopi-tune: what the loop must do, for every plant of a family.  Times are in seconds, frequencies in rad/s,
# angles in degrees and gains in dB; the unit is part of each name.  `fopi tune` on this file prints the gains.
schema: {version}       # version of this language; `fopi schema` prints it as JSON Schema
name: {name}   # also the name of the results' folder
description: Robust fractional PI for a first-order lag whose time constant is uncertain.

# The plant.  Every number may be known (x) or uncertain ({{min, max}} or {{nominal, min, max}}; nominal is the midpoint
# when left out).  The requirements hold for the whole box of the uncertain numbers.  Other models:
#   {{model: pole, gain: 4.39, pole_rad_s: 0.1746}}                               is gain / (s + pole_rad_s)
#   {{model: transfer_function, numerator: [1.0], denominator: [1.0, 1.4, 1.0]}}  has descending powers of s
plant:
  model: lag                  # static_gain e^(-dead_time_s s) / (time_constant_s s + 1)
  static_gain: 1.0            # output unit per control unit
  time_constant_s: {{nominal: 2.25, min: 1.6, max: 3.1}}
  dead_time_s: 0.0            # 0 when left out

# The controller C(s) = kp + ki / s^alpha.  A number fixes a gain ("alpha: 1" is the ordinary PI), a range is searched;
# kp and ki are free on a side without an end.  alpha lies between 0 and 2; without ends, 0.1 ... 1.9 is searched.
controller:
  kp: {{min: 0.0, max: 10.0}}
  ki: {{min: 0.0, max: 10.0}}
  alpha: {{min: 0.3, max: 1.5}}

# What the loop must do.  Each entry is one quantity with one relation: equals, at_least, at_most or between: [a, b].
# It holds for every plant of the family, or with `on: nominal` for the nominal one.  Quantities:
{quantities}
# The functions of frequency hold from from_rad_s to to_rad_s (all frequencies when left out), or at at_rad_s alone.
# Stability of every plant of the family is always required.
requirements:
  - crossover_rad_s: {{equals: 0.3}}          # speed of the nominal loop
    on: nominal
  - phase_margin_deg: {{equals: 90}}          # its damping
    on: nominal
  - phase_margin_deg: {{at_least: 80}}        # and that of every other plant
  - gain_margin_db: {{at_least: 12.04}}       # the gain may be 4 times as large
  - sensitivity_db: {{at_most: -20}}          # slow disturbances are reduced to a tenth
    to_rad_s: 0.02

# What to do with the freedom that is left; without it, the gains are deepest inside all requirements.  One of:
{objectives}
objective: {{minimize: phase_margin_spread_deg}}

# How the gains become a controller on the computer (`fopi run` exports C code).  Remove the section if there is none.
digital:
  sample_time_s: 0.2
  method: oustaloup           # or modified_oustaloup, fit
  poles: 7                    # of the approximation of s^(1-alpha)
  band_rad_s: [1.0e-3, 1.0e3] # where it holds
  rule: tustin                # or matched
  delay_samples: 0            # computing delay
  design: sampled             # the requirements are about the loop on samples; or continuous
  # output_limits: [-1.0, 1.0]                  # of the control; also in the exported C code
  # measurement_unit: km/h

# How many plants the Monte-Carlo test draws from the family, and its seed.
validation:
  samples: 10000
  seed: 1
  # design: random            # or latin_hypercube, sobol
  # distributions:            # of the uncertain numbers, uniform on their ranges when left out; one of:
  #   time_constant_s: {{truncated_normal: {{mean: 2.25, std: 0.4}}}}                   # without what lies outside
  #   time_constant_s: {{beta: {{a: 2, b: 3}}}}                                         # on the range
  #   time_constant_s: {{normal: {{mean: 2.25, std: 0.4}}}}                             # may leave the range
  #   time_constant_s: {{nominal_plus_noise: {{shape: half_normal, mean: 0.85}}}}       # may; or normal, uniform
  # samples_file: draws.csv   # instead: a CSV file beside this one, a header of uncertain numbers, a plant a row
"""


def template(name: str) -> str:
    """A spec with every section explained, which can be used as it is.

    Args:
        name: name of the design.

    Raises:
        DomainError: the name cannot be a folder's.
    """
    if re.fullmatch(NAME_PATTERN, name) is None:
        raise DomainError(f"{quoted(name)} cannot be a spec's name; {NAME_RULE}")
    return _TEMPLATE.format(
        version=SCHEMA_VERSION,
        name=f'"{name}"',
        quantities="\n".join(f"#   {q.name:<30}{q.meaning}" for q in QUANTITIES.values()),
        objectives="\n".join(f"#   {sense}: {word}" for sense, words in OBJECTIVES.items() for word in words),
    )

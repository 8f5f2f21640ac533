"""The commented spec that `fopi init` writes."""

from __future__ import annotations

import re

from fopi_tune.errors import DomainError
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.objectives import OBJECTIVES
from fopi_tune.spec.language import NAME_PATTERN, NAME_RULE, SCHEMA_VERSION
from fopi_tune.spec.templates.sections import SECTIONS_BY_MODEL, TemplateSections
from fopi_tune.spec.yaml.problems import quoted

_TEMPLATE = """\
{modeline}\
# A spec for fopi-tune: what the loop must do, for every plant of a family.  Times are in seconds, frequencies in rad/s,
# angles in degrees and gains in dB; the unit is part of each name.  `fopi run` on this file finds the gains.
schema: {version}       # version of this language; `fopi schema` prints it as JSON Schema
name: {name}   # also the name of the results' folder
description: {description}

# The plant.  Every number may be known (x) or uncertain ({{min, max}} or {{nominal, min, max}}; nominal is the midpoint
# when left out).  The requirements hold for the whole box of the uncertain numbers.  Other models:
{others}
{plant}

# The controller C(s) = kp + ki / s^alpha.  A number fixes a gain ("alpha: 1" is the ordinary PI), a range is searched;
# kp and ki are free on a side without an end.  alpha lies between 0 and 2; without ends, 0.1 ... 1.9 is searched.
# With `structure: pid`, kd and derivative_filter_time_constant_s (a number, Tf) it is kp + ki/s + kd s/(Tf s + 1), and
# with `structure: fopid` and the order mu of the derivative besides kp + ki/s^alpha + kd s^mu/(Tf s + 1), mu at most 1.
# With `measurement_filter: {{order: 1, time_constant_s: T}}`, or order: 2, C has the factor 1/(1 + sT), or
# 1/(1 + sT + s^2 T^2/2), on the measurement.
{controller}

# What the loop must do.  Each entry is one quantity with one relation: equals, at_least, at_most or between: [a, b].
# It holds for every plant of the family, or with `on: nominal` for the nominal one.  Quantities:
{quantities}
# The functions of frequency hold from from_rad_s to to_rad_s (all frequencies when left out), or at at_rad_s alone.
# Stability of every plant of the family is always required.
{requirements}

# What to do with the freedom that is left; without it, the gains are deepest inside all requirements.  One of:
{objectives}
{objective}

# How the gains become a controller on the computer (`fopi run` exports C code).  Remove the section if there is none.
{digital}

# What `fopi simulate` drives the loop through, and `fopi validate` every drawn plant; both judge it by `limits`.
# With `scenario: step_and_load` a limit may stand among the requirements, too: gains are then designed for it.
{scenarios}

# How many plants the Monte-Carlo test draws from the family, and its seed.
validation:
  samples: 10000
  seed: 1
  # design: random            # or latin_hypercube, sobol
  # distributions:            # of the uncertain numbers, uniform on their ranges when left out; one of:
  #   {uncertain_name}: {{truncated_normal: {{mean: 2.25, std: 0.4}}}}                   # without what lies outside
  #   {uncertain_name}: {{beta: {{a: 2, b: 3}}}}                                         # on the range
  #   {uncertain_name}: {{triangular: {{min: 1.6, mode: 2.0, max: 3.1}}}}                # may leave the range
  #   {uncertain_name}: {{normal: {{mean: 2.25, std: 0.4}}}}                             # may; or lognormal
  #   {uncertain_name}: {{nominal_plus_noise: {{shape: half_normal, mean: 0.85}}}}       # may; or normal, uniform
  # samples_file: draws.csv   # instead: a CSV file beside this one, a header of uncertain numbers, a plant a row
"""
#: a line for each model; the template lists those that it does not use
_MODELS = {
    "lag": "{model: lag, static_gain: 1.0, time_constant_s: 2.25}             is static_gain / (time_constant_s s + 1)",
    "pole": "{model: pole, gain: 4.39, pole_rad_s: 0.1746}                           is gain / (s + pole_rad_s)",
    "transfer_function": "{model: transfer_function, numerator: [1.0], denominator: [1, 1.4, 1]}  has descending "
    "powers of s",
}


def template(name: str, sections: TemplateSections = SECTIONS_BY_MODEL["lag"], schema_file: str | None = None) -> str:
    """A spec with every section explained, which can be used as it is.

    Args:
        name: name of the design.
        sections: those that depend on the plant.
        schema_file: the language's JSON Schema, as seen from the spec's folder; editors read it from the first line.

    Raises:
        DomainError: the name cannot be a folder's.
    """
    if re.fullmatch(NAME_PATTERN, name) is None:
        raise DomainError(f"{quoted(name)} cannot be a spec's name; {NAME_RULE}")
    return _TEMPLATE.format(
        modeline="" if schema_file is None else f"# yaml-language-server: $schema=./{schema_file}\n",
        version=SCHEMA_VERSION,
        name=f'"{name}"',
        others="\n".join(f"#   {line}" for model, line in _MODELS.items() if model != sections.model),
        quantities="\n".join(f"#   {q.name:<30}{q.meaning}" for q in QUANTITIES.values()),
        objectives="\n".join(f"#   {sense}: {word}" for sense, words in OBJECTIVES.items() for word in words),
        **sections.texts(),
    )

"""Which limit a number names, and how far limits of scenarios are moved."""

from __future__ import annotations

import pytest

from fopi_tune.prices import movable_limit, movable_limits
from fopi_tune.spec import parse_spec

_SPEC = """\
schema: 1
name: a
plant: {{model: lag, static_gain: 1, time_constant_s: 2}}
digital: {{sample_time_s: 0.1}}
scenarios: [{{name: s, duration_s: 10, reference: [{{at_s: 0, value: 1}}]}}]
requirements:
  - {{overshoot: {{at_most: {limit}}}}}
  - {{phase_margin_deg: {{between: [50, 90]}}}}
  - {{iae: {{at_most: 3}}}}
  - {{sensitivity_db: {{at_most: 6}}}}
"""


def test_limits_are_numbered_as_the_spec_has_them() -> None:
    spec = parse_spec(_SPEC.format(limit=0.1))
    named = dict.fromkeys(["2.lower", "2.upper"], "phase_margin_deg")
    named |= {"1": "overshoot", "3": "iae", "4": "sensitivity_db"}
    assert {name: movable_limit(spec, name).quantity_name for name in named} == named
    assert sorted(limit.name for limit in movable_limits(spec)) == sorted(named)
    assert movable_limit(spec, "3").at(4.0).scenario_requirements[1].limit == 4.0


@pytest.mark.parametrize("limit", [-0.1, 0.0, 0.1])
def test_limits_of_either_sign_move_up_and_down(limit: float) -> None:
    movable = movable_limit(parse_spec(_SPEC.format(limit=limit)), "overshoot")
    assert movable.farthest_limit(-1) < movable.default_end(-1) < limit < movable.default_end(1)
    assert movable.default_end(1) < movable.farthest_limit(1)

"""Plants without an uncertain number, and units: the same design in all of them."""

from __future__ import annotations

import pytest
from cases.scenario_designs import parsed

from fopi_tune.design.time_domain.problem import ScenarioProblem
from fopi_tune.design.time_domain.search import design_for_scenarios
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec


def spec_in(second: float = 1.0, output: float = 1.0, tau: str = "{{min: {2!r}, max: {3!r}}}") -> DesignSpec:
    """A lag under a limited rate, with times in units of `second` and outputs in units of `output`."""
    a, t = output, second
    known = tau.format(None, None, 2.0 * t, 3.0 * t)
    return parsed(
        f"""
schema: 1
name: units
plant: {{model: lag, static_gain: {2.0 * a!r}, time_constant_s: {known}}}
controller: {{kp: {{min: 0, max: {5.0 / a!r}}}, ki: {{min: 0, max: {5.0 / (a * t)!r}}}, alpha: 1}}
requirements: [{{overshoot: {{at_most: {0.05 * a!r}}}}}, {{peak_rate_per_s: {{at_most: {0.6 * a / t!r}}}}}]
objective: {{minimize: ise}}
digital: {{sample_time_s: {0.2 * t!r}, band_rad_s: [{1e-3 / t!r}, {1e3 / t!r}]}}
scenarios: [{{name: s, duration_s: {12.0 * t!r}, reference: [{{at_s: 0, value: {a!r}}}]}}]
""".replace(".0e", "e")
    )


def test_a_plant_without_an_uncertain_number_is_designed_for() -> None:
    spec = spec_in(tau="{2!r}")
    assert ScenarioProblem.of(spec).corners.shape == (1, 0)
    found = design_for_scenarios(spec)
    assert found.status is Status.SOLVED
    assert found.scenario_multipliers[1] is not None
    assert found.scenario_multipliers[1] > 0.0


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("second", "output"), [(1e-6, 1e-3), (3600.0, 1e4)])
def test_units_change_no_design(second: float, output: float) -> None:
    wanted, found = design_for_scenarios(spec_in()), design_for_scenarios(spec_in(second, output))
    assert wanted.gains is not None
    assert found.gains is not None
    assert found.gains.kp * output == pytest.approx(wanted.gains.kp, rel=1e-8)
    assert found.gains.ki * output * second == pytest.approx(wanted.gains.ki, rel=1e-8)

"""Seven problems of designs for scenarios, with the worst plant's IAE of the best gains that another solver found.

The brake in three scenarios, the throttle without and with a control that meets its limits, and two loops with a dead
time under a step of the load.  In the first five the measurement is a velocity in km/h.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

_FILTER = "method: oustaloup, poles: 7, band_rad_s: [1.0e-3, 1.0e3], rule: tustin"
_BRAKE = """\
schema: 1
name: {name}
plant: {{model: lag, static_gain: 10.0, time_constant_s: {{nominal: 2.25, min: 1.6, max: 3.1}}}}
controller: {{kp: {{min: 0, max: 5}}, ki: {{min: 0, max: 5}}, alpha: {{min: 0.3, max: 1.5}}}}
digital: {{sample_time_s: 0.2, {filter}, measurement_unit: km/h}}
scenarios:
  - {{name: ramp, duration_s: 60, initial_output: 30, load: [{{at_s: 0, value: 3.0}}],
     reference: [{{at_s: 0, value: 0, ramp_s: {ramp}}}]}}
  - {{name: step, duration_s: 60, initial_output: 30, load: [{{at_s: 0, value: 3.0}}],
     reference: [{{at_s: 0, value: 0}}]}}
requirements:
  - sensitivity_db: {{at_most: 2.0}}
  - phase_margin_deg: {{at_least: 60}}
  - {{acceleration_m_s2: {{at_most: 2.0}}, scenario: {scenario}}}
objective: {{minimize: iae, scenario: {scenario}}}
"""
_THROTTLE = """\
schema: 1
name: {name}
plant: {{model: pole, gain: 4.39, pole_rad_s: {{nominal: 0.1746, min: 0.15, max: 0.2}}}}
controller: {{kp: {{min: 0, max: 5}}, ki: {{min: 0, max: 5}}, alpha: {{min: 0.3, max: 1.5}}}}
digital: {{sample_time_s: 0.2, {filter}, output_limits: [0, 1], measurement_unit: km/h}}
scenarios: [{{name: town, duration_s: 60, reference: [{{at_s: 0, value: {speed}}}]}}]
requirements:
  - sensitivity_db: {{at_most: {peak}}}
  - phase_margin_deg: {{at_least: {margin}}}
  - overshoot: {{at_most: {overshoot}}}
  - acceleration_m_s2: {{at_most: 2.0}}
objective: {{minimize: iae, scenario: town}}
"""
_DELAY = """\
schema: 1
name: brake_delay
plant: {{model: lag, static_gain: 1.0, time_constant_s: {{nominal: 2.25, min: 1.6, max: 3.1}}, dead_time_s: 0.3}}
controller: {{kp: {{min: 0.0, max: 10.0}}, ki: {{min: 0.0, max: 10.0}}, alpha: {{min: 0.3, max: 1.5}}}}
digital: {{sample_time_s: 0.2, {filter}}}
scenarios: [{{name: load, duration_s: 100, reference: [{{at_s: 0, value: 0}}], load: [{{at_s: 0, value: 1}}]}}]
requirements:
  - phase_margin_deg: {{at_least: 60}}
  - sensitivity_db: {{at_most: 2.5}}
  - {{sensitivity_db: {{at_most: -20}}, to_rad_s: 0.05}}
objective: {{minimize: iae, scenario: load}}
"""
_THREE = """\
schema: 1
name: lgd
plant:
  model: lag
  static_gain: {{nominal: 1.0, min: 0.8, max: 1.25}}
  time_constant_s: {{nominal: 2.25, min: 1.6, max: 3.1}}
  dead_time_s: {{nominal: 0.3, min: 0.2, max: 0.4}}
controller: {{kp: {{min: 0.0, max: 20.0}}, ki: {{min: 0.0, max: 20.0}}, alpha: {{min: 0.5, max: 1.4}}}}
digital: {{sample_time_s: 0.1, {filter}, delay_samples: 1}}
scenarios:
  - {{name: step, duration_s: 40, reference: [{{at_s: 0, value: 1}}]}}
  - {{name: load, duration_s: 60, reference: [{{at_s: 0, value: 0}}], load: [{{at_s: 0, value: 1}}]}}
requirements:
  - sensitivity_db: {{at_most: 4.0}}
  - complementary_sensitivity_db: {{at_most: 2.0}}
  - control_sensitivity_db: {{at_most: 12.0}}
  - phase_margin_deg: {{at_least: 50}}
  - {{overshoot: {{at_most: 0.1}}, scenario: step}}
  - {{peak_control: {{at_most: 3.0}}, scenario: step}}
objective: {{minimize: iae, scenario: load}}
"""


@dataclass(frozen=True)
class ScenarioDesign:
    """A problem and its answer.

    Args:
        text: the spec.
        iae: of the worst plant with the best gains.
        gains: kp, ki and alpha of these; None where the optimum is too flat to compare them.
    """

    text: str
    iae: float
    gains: tuple[float, float, float] | None = None

    @property
    def spec(self) -> DesignSpec:
        """As it is read."""
        return parsed(self.text)


@lru_cache(maxsize=256)
def parsed(text: str) -> DesignSpec:
    """A spec from its text."""
    return parse_spec(text)


def brake(name: str, scenario: str, ramp: float = 5.0) -> str:
    """The text of a problem of the brake."""
    return _BRAKE.format(name=name, scenario=scenario, ramp=ramp, filter=_FILTER)


def throttle(name: str, speed: float, peak: float, margin: float, overshoot: float) -> str:
    """The text of a problem of the throttle."""
    return _THROTTLE.format(name=name, speed=speed, peak=peak, margin=margin, overshoot=overshoot, filter=_FILTER)


DESIGNS: dict[str, ScenarioDesign] = {
    "brake_ramp_10": ScenarioDesign(brake("brake_ramp_10", "ramp", 10.0), 13.527, (0.3295, 0.3170, 1.0)),
    "brake_ramp_4.5": ScenarioDesign(brake("brake_ramp_4.5", "ramp", 4.5), 24.80, (0.3295, 0.1754, 0.9637)),
    "brake_step": ScenarioDesign(brake("brake_step", "step"), 119.4, (0.0315, 0.0355, 0.975)),
    "throttle": ScenarioDesign(throttle("throttle", 15, 3.0, 60, 0.75), 36.58, (0.6653, 0.1330, 1.0)),
    "throttle_sat": ScenarioDesign(throttle("throttle_sat", 20, 6.0, 35, 0.1), 78.41),
    "brake_delay": ScenarioDesign(_DELAY.format(filter=_FILTER), 1.366, (1.3370, 0.8109, 1.0)),
    "lgd": ScenarioDesign(_THREE.format(filter=_FILTER), 1.694, (1.2113, 0.6327, 0.99977)),
}

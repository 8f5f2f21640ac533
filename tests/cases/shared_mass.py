"""A car whose throttle and brake have one mass:  m v' = F u - c v, and a brake that takes longer the heavier it is."""

from __future__ import annotations

from pathlib import Path

from fopi_tune.spec import load_system
from fopi_tune.spec.model import SystemSpec

_MODE = """\
schema: 1
name: {name}
plant: {{{plant}}}
controller: {{kp: 1, ki: 0.4, alpha: 1}}
requirements: [{{phase_margin_deg: {{at_least: 20}}}}]
digital: {{sample_time_s: 0.1}}
"""
MASS = "{min: 900, max: 1400, nominal: 1100}"
THROTTLE = f"model: pole, parameters: {{m: {MASS}, c: {{min: 40, max: 60}}}}, gain: 4000/m, pole_rad_s: c/m"
BRAKE = f"model: lag, parameters: {{m: {MASS}}}, static_gain: 12, time_constant_s: m/500"
#: both time constants are one
LAGS = "model: lag, static_gain: 12, time_constant_s: {min: 1.6, max: 3.1, nominal: 2.25}"
_SYSTEM = """\
schema: 1
name: car
system:
  throttle: {{spec: throttle.yaml, gains: {{kp: 0.3, ki: 0.1, alpha: 0.9}}, output_limits: [0, 1]}}
  brake: {{spec: brake.yaml, gains: {{kp: 0.4, ki: 0.2, alpha: 0.8}}, output_limits: [-1, 0]}}
  hysteresis: 0.3
  inactive: {inactive}
{more}
scenarios:
  - name: town
    duration_s: 30
    initial_output: 8
    before: free
    reference: [{{at_s: 0, value: 3}}, {{at_s: 10, value: 6}}]
limits: [{{acceleration_m_s2: {{at_most: 50}}}}]
validation: {{samples: 60, seed: 3{validation}}}
"""


def write(
    folder: Path,
    more: str = "  shared: [m]",
    throttle: str = THROTTLE,
    brake: str = BRAKE,
    inactive: str = "reset",
    validation: str = "",
) -> Path:
    """The system's file and those of its modes."""
    for name, plant in (("throttle", throttle), ("brake", brake)):
        text = _MODE.format(name=name, plant=plant).replace("0.1}", "0.1, measurement_unit: m/s}")
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    path = folder / "car.yaml"
    path.write_text(_SYSTEM.format(more=more, inactive=inactive, validation=validation), encoding="utf-8")
    return path


def car(folder: Path, **texts: str) -> SystemSpec:
    """The system; see `write`."""
    return load_system(write(folder, **texts))

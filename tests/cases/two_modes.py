"""Systems of two modes by any names, written into a folder:  a rig that is heated and cooled, in degrees."""

from __future__ import annotations

from pathlib import Path

from fopi_tune.spec import load_system
from fopi_tune.spec.model import SystemSpec

_RAISES = "{model: lag, static_gain: 20, time_constant_s: {min: 3, max: 6, nominal: 4}}"
_LOWERS = "{model: lag, static_gain: 12, time_constant_s: {min: 1.5, max: 3, nominal: 2}}"
_SPEC = """\
schema: 1
name: {name}
plant: {plant}
requirements: [{{phase_margin_deg: {{at_least: 20}}}}]
digital: {{sample_time_s: 0.1, poles: 5}}
"""
_GAINS = ("{kp: 0.12, ki: 0.08, alpha: 0.9}", "{kp: 0.2, ki: 0.15, alpha: 0.8}")
_LIMITS = ("[0, 1]", "[-1, 0]")
_SCENARIO = """\
scenarios:
  - {name: day, duration_s: 40, reference: [{at_s: 0, value: 8}, {at_s: 12, value: 3}, {at_s: 24, value: 6, ramp_s: 3}]}
"""


def write(
    folder: Path, names: tuple[str, str] = ("heater", "fan"), turns: str = "hysteresis: 0.3", *, more: str = "",
    limits: tuple[str, str] = _LIMITS,
) -> Path:  # fmt: skip
    """The system's file, and the specs of its modes beside it.

    Args:
        folder: where.
        names: of the modes, as they are written.
        turns: lines of the section `system` besides the modes.
        more: lines at the end.
        limits: of the modes' controls, in their order.
    """
    lines = []
    for name, plant, gains, limit in zip(names, (_RAISES, _LOWERS), _GAINS, limits, strict=True):
        (folder / f"{name}.yaml").write_text(_SPEC.format(name=name, plant=plant), encoding="utf-8")
        lines.append(f"  {name}: {{spec: {name}.yaml, gains: {gains}, output_limits: {limit}}}")
    indented = [f"  {line}" for line in turns.splitlines()]
    text = "\n".join(["schema: 1", "name: rig", "system:", *lines, *indented, _SCENARIO, more, ""])
    path = folder / "rig.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def rig(folder: Path, *words: object, **more: object) -> SystemSpec:
    """The system; see `write`."""
    return load_system(write(folder, *words, **more))  # pyright: ignore[reportArgumentType]

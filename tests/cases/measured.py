"""Measured frequency responses of the tests:  rational plants, sampled as a test bench would, and their specs."""

from __future__ import annotations

import numpy as np

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.core.loops import Plants
from fopi_tune.core.measured.curve import Curve
from fopi_tune.core.plant import Plant
from fopi_tune.spec.load import parse_spec
from fopi_tune.spec.model import DesignSpec

LAG = Plant((1.0,), (2.0, 1.0), 0.3)
TWO = Plant((2.0,), (0.3, 1.7, 1.0), 0.1)
INTEGRATOR = Plant((1.0,), (0.5, 1.0, 0.0), 0.1)
RESONANCE = Plant((4.0,), (1.0, 0.4, 4.0), 0.2)
UNSTABLE = Plant((2.0,), (1.0, -1.0), 0.05)
NEGATIVE = Plant((-2.0,), (1.0, 1.0), 0.1)
PLANTS = {
    "lag": LAG, "two": TWO, "integrator": INTEGRATOR, "resonance": RESONANCE, "unstable": UNSTABLE,
    "negative": NEGATIVE,
}  # fmt: skip


def unstable_poles(plant: Plant) -> int:
    """Of the plant, in the right half-plane."""
    return int(Plants.of(plant).unstable_poles[0])


def response(plant: Plant, omega: Array) -> Complex:
    """P(j omega), dead time included."""
    return Plants.of(plant).response(np.zeros(len(omega), dtype=np.intp), omega) * np.exp(
        -1j * omega * plant.dead_time_s
    )


def curve(plant: Plant, low: float = 1e-3, high: float = 1e3, points: int = 361) -> Curve:
    """The plant measured without noise."""
    omega = np.geomspace(low, high, points)
    found = response(plant, omega)
    return Curve(omega, np.log(np.abs(found)), np.angle(found))


def csv(plant: Plant, low: float = 1e-3, high: float = 1e3, points: int = 361, deviation: float = 0.0) -> bytes:
    """A file of it; with a relative standard deviation noise is added, and its size is a column."""
    omega = np.geomspace(low, high, points)
    found = response(plant, omega)
    chance = np.random.default_rng(1)
    noise = chance.standard_normal(points) + 1j * chance.standard_normal(points)
    size = deviation * np.abs(found)
    found = found + size * noise
    lines = ["omega_rad_s,real,imag" + (",magnitude_std" if deviation else "")]
    for w, p, s in zip(omega, found, size, strict=True):
        lines.append(f"{w:.12g},{p.real:.12g},{p.imag:.12g}" + (f",{s:.6g}" if deviation else ""))
    return ("\n".join(lines) + "\n").encode()


def text_of(plant: str, requirements: str, objective: str = "", controller: str = "", more: str = "") -> str:
    """A spec's text; `plant` is what stands behind `plant:`, all other words behind theirs."""
    kept = controller or "{kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, alpha: {min: 0.5, max: 1.4}}"
    lines = ["schema: 1", "name: measured", f"plant: {plant}", f"controller: {kept}", f"requirements: {requirements}"]
    return "\n".join([*lines, *([f"objective: {objective}"] if objective else []), more, ""])


def measured_spec(
    plant: Plant, requirements: str, objective: str = "", controller: str = "", data: bytes | None = None
) -> DesignSpec:
    """The spec of a measured plant."""
    told = f"{{model: frequency_response, file: f.csv, unstable_poles: {unstable_poles(plant)}}}"
    files = {"f.csv": csv(plant) if data is None else data}
    return parse_spec(text_of(told, requirements, objective, controller), files=files)


def rational_spec(plant: Plant, requirements: str, objective: str = "", controller: str = "") -> DesignSpec:
    """The spec of the plant itself."""
    told = (
        f"{{model: transfer_function, numerator: {list(plant.numerator)}, denominator: {list(plant.denominator)}, "
        f"dead_time_s: {plant.dead_time_s}}}"
    )
    return parse_spec(text_of(told, requirements, objective, controller))

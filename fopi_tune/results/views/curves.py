"""Curves of a designed loop:  frequency responses and the response to a step, of the nominal plant and the corners.

The loop is that of the requirements: on samples with `design: sampled`, else in continuous time.  Matplotlib is loaded
when something is drawn.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.core.controller import FoPi
from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.core.fractional_plants.family import is_fractional
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.digital.implementation import designed_implementation, implementation_of, nominal_crossover, runtime_of
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import DesignSpec

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: points of a curve, and how far it reaches on both sides of the crossover
_POINTS, _REACH = 400, 1e3


@dataclass(frozen=True, eq=False)
class LoopResponse:
    """L on a grid of frequencies, a row a plant: the nominal one, then the corners of its box.

    Args:
        omega_rad_s: ascending, rad/s, shape (n,).
        loop: L, dimensionless, shape (m, n).
    """

    omega_rad_s: Array
    loop: Complex

    @property
    def magnitude_db(self) -> Array:
        """|L|, dB, shape (m, n)."""
        return 20.0 * np.log10(np.abs(self.loop))

    @property
    def phase_deg(self) -> Array:
        """arg L, deg, unwrapped along each row; shape (m, n)."""
        return np.degrees(np.unwrap(np.angle(self.loop), axis=1))


@dataclass(frozen=True, eq=False)
class StepResponse:
    """A step of the reference, then one of the load, a row a plant: the nominal one, then the corners of its box.

    Args:
        time_s: s, shape (n,).
        reference: output unit, shape (n,).
        output: output unit, shape (m, n).
        control: that is applied, control unit, shape (m, n).
    """

    time_s: Array
    reference: Array
    output: Array
    control: Array


class LoopCurves:
    """A result with gains whose loop can be looked at; its class has a `spec` and `gains`."""

    spec: DesignSpec
    gains: FoPi | None

    @property
    def controller(self) -> FoPi | None:
        """The gains; called with complex s, rad/s, they are C(s)."""
        return self.gains

    def bode(self, omega_rad_s: Array | None = None) -> LoopResponse:
        """L, of the nominal plant and the corners of its box.

        Args:
            omega_rad_s: frequencies, rad/s, shape (n,); None: three decades on both sides of the crossover, on samples
                below Nyquist's frequency.

        Raises:
            DomainError: there are no gains, or the plant is a list, fractional or measured.
        """
        gains, spec = self._gains(), self.spec
        if isinstance(spec.plant, PlantList) or spec.is_measured or is_fractional(spec.plant):
            raise DomainError("curves are of one family of transfer functions; `fopi report` draws the others")
        plants = Plants.members(spec.plant, spec.plant.corners())
        implementation = designed_implementation(spec, gains)
        loops = Loops.of(gains, plants)
        if implementation is not None:
            loops = SampledLoops.implemented(gains, implementation, plants)
        if omega_rad_s is None:
            middle = nominal_crossover(spec, gains) or 1.0
            highest = min(middle * _REACH, 0.999 * loops.highest_rad_s)
            omega_rad_s = np.geomspace(min(middle / _REACH, 1e-3 * highest), highest, _POINTS)
        try:
            omega = np.asarray(omega_rad_s, dtype=float)
        except (TypeError, ValueError):
            raise DomainError(f"omega_rad_s = {omega_rad_s!r:.100} is no row of frequencies; give one, rad/s") from None
        if omega.ndim != 1 or not np.all((omega > 0.0) & (omega < loops.highest_rad_s)):
            raise DomainError(f"frequencies must lie between 0 and {loops.highest_rad_s:g} rad/s, in one row")
        rows = np.repeat(np.arange(len(plants)), len(omega))
        return LoopResponse(omega, loops.response(rows, np.tile(omega, len(plants))).reshape(len(plants), -1))

    def nyquist(self, omega_rad_s: Array | None = None) -> Complex:
        """L, dimensionless, shape (m, n); arguments and errors as for `bode`."""
        return self.bode(omega_rad_s).loop

    def step(self) -> StepResponse:
        """The loop on samples after a step of the reference, then of the load, as `fopi simulate` drives it.

        Raises:
            DomainError: as for `bode`, the spec has no section `digital`, or the filter cannot be made.
        """
        # a design and its text need no simulation
        from fopi_tune.simulation.default_scenario import default_scenario
        from fopi_tune.simulation.measures import scenario_of
        from fopi_tune.simulation.sampled.simulate import simulate
        from fopi_tune.simulation.scenario import Mode

        gains, spec = self._gains(), self.spec
        self.bode(np.array([1e-9]))  # refuses what has no curves
        implementation = implementation_of(spec, gains)
        controller = runtime_of(implementation.sections, spec)
        nominal = spec.plant.member(spec.plant.nominal_point)
        scenario = default_scenario(nominal, controller, implementation.sample_time_s, implementation.delay_samples)
        plants = Plants.members(spec.plant, spec.plant.corners())
        run = scenario_of(scenario, implementation, 0)
        found = simulate([Mode(controller, plants)], run)
        return StepResponse(found.time_s, run.signals.reference, found.output, found.applied)

    def plot_bode(self, axes: tuple[Axes, Axes] | None = None) -> tuple[Axes, Axes]:
        """Draw magnitude and phase; the axes are new ones where none are given.  Errors as for `bode`."""
        found = self.bode()
        above, below = axes or _axes(2)
        for row, (size, phase) in enumerate(zip(found.magnitude_db, found.phase_deg, strict=True)):
            above.semilogx(found.omega_rad_s, size, **_style(row))
            below.semilogx(found.omega_rad_s, phase, **_style(row))
        above.set_ylabel("|L|, dB")
        below.set_ylabel("arg L, deg")
        below.set_xlabel("frequency, rad/s")
        above.legend()
        return above, below

    def plot_nyquist(self, axes: Axes | None = None) -> Axes:
        """Draw L in the complex plane around -1, which is marked.  Errors as for `bode`."""
        (drawn,) = (axes,) if axes is not None else _axes(1)
        for row, curve in enumerate(self.nyquist()):
            drawn.plot(curve.real, curve.imag, **_style(row))
        drawn.plot(-1.0, 0.0, "k+", label="-1")
        drawn.set(xlim=(-3.0, 2.0), ylim=(-3.0, 2.0), aspect="equal", xlabel="Re L", ylabel="Im L")
        drawn.legend()
        return drawn

    def plot_step(self, axes: tuple[Axes, Axes] | None = None) -> tuple[Axes, Axes]:
        """Draw output and control after the steps of `step`.  Errors as there."""
        found = self.step()
        above, below = axes or _axes(2)
        above.step(found.time_s, found.reference, "k--", where="post", linewidth=0.8, label="reference")
        for row, (output, control) in enumerate(zip(found.output, found.control, strict=True)):
            above.plot(found.time_s, output, **_style(row))
            below.step(found.time_s, control, where="post", **_style(row))
        above.set_ylabel("output")
        below.set_ylabel("control")
        below.set_xlabel("time, s")
        above.legend()
        return above, below

    def _gains(self) -> FoPi:
        gains = self.controller
        if gains is None:
            raise DomainError(f"{self.spec.name} has no gains, and no loop to look at")
        return gains


def _style(row: int) -> dict[str, Any]:
    """Of the nominal plant, and of corners, which share a word."""
    if row == 0:
        return {"color": "#0072B2", "label": "nominal plant"}
    return {"color": "#999999", "linewidth": 0.8, "zorder": 1, **({"label": "corners"} if row == 1 else {})}


def _axes(count: int) -> tuple[Axes, ...]:
    """New axes below each other, in a figure that shows itself in a notebook."""
    from matplotlib import pyplot as plt

    _, axes = plt.subplots(count, 1, squeeze=False, layout="constrained", sharex=count > 1)
    return tuple(axes[:, 0])

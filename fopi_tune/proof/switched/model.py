"""Two sampled loops that take turns, as exact matrices:  SystemSpec, gains -> SwitchedModel -> matrices of balls.

The state is z = (y, x_throttle, x_brake).  The active controller, with e = r - y,

    v = direct e + sum_k x_k,    u = v within the limits,    x_k <- p_k (x_k + w_k g (u - v)) + r_k e,              (1)

drives a stable plant of first order, whose input is held over a sample:

    y <- (1 - m) y + m K u,    m = 1 - e^{-Ts/tau} .                                                                 (2)

The inactive one is held, is reset to an output of 0 when its turn comes, or tracks the applied output:

    x_k <- p_k x_k  (k > 0),    x_0 = u' - direct e - sum_{k>0} x_k,                                                (3)

u' being u within its own limits.  (2) is affine in m for K fixed and in K for m fixed: the matrices of all plants of a
family lie in the convex hull of those at the ends.  This holds too where tau varies while the loop runs, even within a
sample: m is then 1 minus the exponential of minus the integral of 1/tau, which stays between the same ends.

Arithmetic is exact, on the doubles that controllers and specs store.

Source: (1) and (3) are `fopi_tune.digital.runtime` and (2) is the zero-order hold of a lag; the rest is derived here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from flint import arb, arb_mat

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.switched_runtime import Memory
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import SystemSpec

#: m and K of (2)
Lag = tuple[arb, arb]


@dataclass(frozen=True)
class SwitchedLoop:
    """One mode.

    Args:
        name: of the mode.
        controller: as its target stores it, in float64.
        plant: the family.
        delay_samples: from the measurement to the new control, in samples.
    """

    name: str
    controller: Runtime
    plant: PlantFamily
    delay_samples: float = 0.0


@dataclass(frozen=True)
class SwitchedModel:
    """Two loops that share their output and take turns, the raising one first.

    Args:
        sample_time_s: Ts.
        hysteresis: half-width around the setpoint, output unit.
        memory: of the inactive controller.
        loops: throttle and brake.
        min_dwell_samples: samples that a mode stays at least after it was entered; 0 and 1 are any.
    """

    sample_time_s: float
    hysteresis: float
    memory: Memory
    loops: tuple[SwitchedLoop, SwitchedLoop]
    min_dwell_samples: int = 0

    @classmethod
    def of(cls, system: SystemSpec, gains: Mapping[str, FoPi]) -> SwitchedModel:
        """The model of a system with its digital controllers.

        Args:
            system: gives plants, digital sections, hysteresis, memory and minimum dwell.
            gains: of both modes, by name.

        Raises:
            DomainError: a mode has no gains, or no digital controller can be made of them.
        """
        if missing := [mode.name for mode in system.modes if mode.name not in gains]:
            raise DomainError(f"there are no gains of {' and '.join(missing)}; give those of both modes")
        throttle, brake = (_loop_of(system, index, gains[mode.name]) for index, mode in enumerate(system.modes))
        memory, dwell = Memory(system.inactive), system.min_dwell_samples
        return cls(system.sample_time_s, system.hysteresis, memory, (throttle, brake), dwell)

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of sections of both controllers."""
        return len(self.loops[0].controller.poles), len(self.loops[1].controller.poles)

    @property
    def obstacle(self) -> str:
        """Why nothing about the switching can be proved with these methods; empty where it can be tried."""
        for loop in self.loops:
            if found := loop_obstacle(loop):
                return found
        overlap = self.loops[1].controller.limits[1] > self.loops[0].controller.limits[0]
        if overlap and self.memory is Memory.TRACKING:
            return (
                "the limits of both controls overlap, so that what a tracking controller holds depends on the other's "
                "control; write output_limits so that the second mode's control ends where the first one's begins"
            )
        return ""


@dataclass(frozen=True)
class LagRange:
    """All plants of a family as (2), in balls.

    Args:
        shares: the least and the largest m, per sample.
        gains: the least and the largest K, output unit per unit of control.
        vertices: (m, K) at all pairs of ends; the convex hull of their matrices holds those of all plants.
    """

    shares: tuple[arb, arb]
    gains: tuple[arb, arb]
    vertices: tuple[Lag, ...]


def lag_range(loop: SwitchedLoop, sample_time_s: float) -> LagRange:
    """The plants of a family as lags, at the current precision.

    Args:
        loop: its plant has `loop_obstacle` empty.
        sample_time_s: Ts.
    """
    # a ball per end; an exact number gives one end
    values = {
        name: [arb(number.min)] if number.is_exact else [arb(number.min), arb(number.max)]
        for name, number in loop.plant.parameters.items()
    }
    if loop.plant.model == "lag":
        shares = [_share(1 / tau, sample_time_s) for tau in reversed(values["time_constant_s"])]
        gains = values["static_gain"]
    else:
        poles = values["pole_rad_s"]
        shares = [_share(pole, sample_time_s) for pole in poles]
        gains = [values["gain"][0] / poles[-1]]
        if len(poles) + len(values["gain"]) > 2:
            gains.append(values["gain"][-1] / poles[0])
    corners = tuple((share, gain) for share in shares for gain in gains)
    return LagRange((shares[0], shares[-1]), (gains[0], gains[-1]), corners)


def lag_at(loop: SwitchedLoop, sample_time_s: float, numbers: Mapping[str, float]) -> Lag:
    """One plant of the family as a lag.

    Args:
        loop: its plant has `loop_obstacle` empty.
        sample_time_s: Ts.
        numbers: values of the uncertain numbers, in the spec's units; the nominal ones where left out.
    """
    value = {name: arb(numbers.get(name, number.nominal)) for name, number in loop.plant.parameters.items()}
    if loop.plant.model == "lag":
        return _share(1 / value["time_constant_s"], sample_time_s), value["static_gain"]
    return _share(value["pole_rad_s"], sample_time_s), value["gain"] / value["pole_rad_s"]


def loop_matrices(controller: Runtime, lag: Lag) -> tuple[arb_mat, arb_mat, arb_mat]:
    """One loop around its equilibrium:  zeta <- A zeta + B q,  v - v* = C zeta,  where q = v - u is cut off.

    zeta = (y - r, x_0 - r/K, x_1, ...): at rest the integrator alone holds the control r/K.

    Args:
        controller: with an integrator.
        lag: m and K.

    Returns:
        A, shape (n + 1, n + 1), B (n + 1, 1) and C (1, n + 1).
    """
    (share, gain), count = lag, len(controller.poles)
    direct, back = arb(controller.direct), arb(controller.tracking_gain)
    step = share * gain
    a = arb_mat(count + 1, count + 1)
    b, c = arb_mat(count + 1, 1), arb_mat(1, count + 1)
    a[0, 0], b[0, 0], c[0, 0] = 1 - share - step * direct, -step, -direct
    rows = zip(controller.poles, controller.residues, controller.weights, strict=True)
    for k, (pole, residue, weight) in enumerate(rows, 1):
        a[0, k], a[k, 0], a[k, k] = step, -arb(residue), arb(pole)
        b[k, 0], c[0, k] = -back * arb(pole) * arb(weight), arb(1)
    return a, b, c


def _share(rate: arb, sample_time_s: float) -> arb:
    """m of (2), by expm1, which keeps the digits of a slow plant."""
    return -(-rate * arb(sample_time_s)).expm1()


def _loop_of(system: SystemSpec, index: int, gains: FoPi) -> SwitchedLoop:
    mode = system.modes[index]
    implementation = implementation_of(mode.spec, gains)
    limits = mode.spec.digital.output_limits if mode.spec.digital is not None else None
    controller = Runtime.of(implementation.sections, Precision.FLOAT64, limits)
    return SwitchedLoop(mode.name, controller, mode.spec.plant, implementation.delay_samples)


def loop_obstacle(loop: SwitchedLoop) -> str:
    """Why a loop is outside of these methods; empty where it is not."""
    parameters, name = loop.plant.parameters, loop.name
    if loop.plant.model not in ("lag", "pole"):
        return f"{name}: only plants of model lag or pole are handled; write this one so"
    if parameters["dead_time_s"].max > 0.0 or loop.delay_samples > 0.0:
        return f"{name}: dead time and computing delay are not modelled in this proof"
    if parameters["static_gain" if loop.plant.model == "lag" else "gain"].min <= 0.0:
        return f"{name}: the plant's gain must be positive; turn the sign of its control"
    if loop.plant.model == "pole" and parameters["pole_rad_s"].min <= 0.0:
        return f"{name}: the plant is not stable by itself; only stable ones are handled"
    if not loop.controller.has_integrator:
        return f"{name}: the controller has no integrator, so that it rests beside the setpoint"
    return ""

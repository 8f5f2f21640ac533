"""Two sampled loops that take turns, as exact matrices:  SystemSpec, gains -> SwitchedModel -> matrices of balls.

The state is z = (y, x_1, x_2).  The active controller, with e = r - y,

    v = direct e + sum_k x_k,    u = v within the limits,    x_k <- p_k (x_k + w_k g (u - v)) + r_k e,              (1)

drives a stable plant of first order, whose input is held over a sample:

    y <- (1 - m) y + m K u,    m = 1 - e^{-Ts/tau} .                                                                 (2)

With a computing delay of D <= Ts a sample begins with the last sample's control, and its plant where the mode changed:

    y <- (1 - m_2)((1 - m_1) y + m_1 K u_last) + m_2 K u,    m_1 = 1 - e^{-D/tau},  m_2 = 1 - e^{-(Ts - D)/tau},     (4)

and the state grows by u_last.  The inactive controller is held, is reset to an output of 0 when its turn comes, or
tracks the applied output:

    x_k <- p_k x_k  (k > 0),    x_0 = u' - direct e - sum_{k>0} x_k,                                                (3)

u' being u within its own limits.  (2) is affine in m for K fixed and in K for m fixed: the matrices of all plants of a
family lie in the convex hull of those at the ends, as those of (4) do, which is affine in each of m_1, m_2 and K.  This
holds too where tau varies while the loop runs, even within a sample: m is then 1 minus the exponential of minus the
integral of 1/tau, which stays between the same ends.

Arithmetic is exact, on the doubles that controllers and specs store.

Source: (1) and (3) are `fopi_tune.digital.runtime`; (2) is the zero-order hold of a lag, (4) of one with a delay, as in
Astrom and Wittenmark, Computer-Controlled Systems, 1997, section 2.3; the rest is derived here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from flint import arb, arb_mat

from fopi_tune.core.controller import FoPi
from fopi_tune.core.parametric.family import ParametricFamily
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.switching_lines import SwitchingLines, Threshold
from fopi_tune.core.terms.feedforward import FeedForward
from fopi_tune.digital.implementation import implementation_of, runtime_of
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.switched_runtime import Memory
from fopi_tune.errors import DomainError
from fopi_tune.proof.verdict import RATE_NOT_MODELLED
from fopi_tune.spec.model import SystemSpec

#: a control without limits has those of a double; one like this is taken for none too
_LARGEST_LIMIT = 1e100
COASTING_NOT_MODELLED = "coasting is not modelled in this proof; without coast the modes alone can be proved"
LINES_NOT_MODELLED = "an absolute line is not modelled in this proof; write both lines relative to the setpoint"


@dataclass(frozen=True)
class Lag:
    """One plant over a sample, in balls.

    Args:
        share: m of (2), or m_2 of (4): under the control that the sample computes.
        gain: K, output unit per unit of control.
        late: m_1 of (4), under the control of the sample before; None without a computing delay.
    """

    share: arb
    gain: arb
    late: arb | None = None


@dataclass(frozen=True)
class SwitchedLoop:
    """One mode.

    Args:
        name: of the mode.
        controller: as its target stores it, in float64.
        plant: the family.
        delay_samples: from the measurement to the new control, in samples.
        feedforward: of the setpoint; None without one.
        hold_below_per_s: of the plant's standstill at an output of 0, output unit per s; None without one.
    """

    name: str
    controller: Runtime
    plant: PlantFamily
    delay_samples: float = 0.0
    feedforward: FeedForward | None = None
    hold_below_per_s: float | None = None

    @property
    def is_limited(self) -> bool:
        """Whether the control has limits on both sides."""
        return all(abs(limit) < _LARGEST_LIMIT for limit in self.controller.limits)


@dataclass(frozen=True)
class SwitchedModel:
    """Two loops that share their output and take turns, the raising one first.

    Args:
        sample_time_s: Ts.
        hysteresis: half-width around the setpoint, output unit, or other lines; of absolute ones little is proved.
        memory: of the inactive controller.
        loops: the raising one, then the lowering one.
        min_dwell_samples: samples that a mode stays at least after it was entered; 0 and 1 are any.
        shared: names of numbers that both plants have the same value of; bounds hold without that too.
    """

    sample_time_s: float
    hysteresis: float | SwitchingLines
    memory: Memory
    loops: tuple[SwitchedLoop, SwitchedLoop]
    min_dwell_samples: int = 0
    shared: tuple[str, ...] = ()

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
        raising, lowering = (_loop_of(system, index, gains[mode.name]) for index, mode in enumerate(system.modes))
        memory, dwell = Memory(system.inactive), system.min_dwell_samples
        return cls(system.sample_time_s, system.hysteresis, memory, (raising, lowering), dwell, system.shared)

    @property
    def lines(self) -> SwitchingLines:
        """Where the modes take turns."""
        return SwitchingLines.of(self.hysteresis)

    @property
    def upper(self) -> float:
        """a: with the raising mode active, y >= r + a makes the other one take its turn; output unit."""
        return self._relative(self.lines.up)

    @property
    def lower(self) -> float:
        """b: with the lowering mode active, y <= r + b makes the other one take its turn; output unit, at most a."""
        return self._relative(self.lines.down)

    @property
    def upper_line(self) -> str:
        """The upper line in words."""
        return "the hysteresis" if self.lines.half_width is not None else f"the line of to_{self.loops[1].name}_above"

    @property
    def lower_line(self) -> str:
        """The lower line in words."""
        return "the hysteresis" if self.lines.half_width is not None else f"the line of to_{self.loops[0].name}_below"

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
        if self.lines.coasts:
            return COASTING_NOT_MODELLED
        if self.lines.up.is_absolute or self.lines.down.is_absolute:
            return LINES_NOT_MODELLED
        if self.loops[0].delay_samples != self.loops[1].delay_samples:
            return "the controllers have computing delays that differ; give both the same"
        overlap = self.loops[1].controller.limits[1] > self.loops[0].controller.limits[0]
        if overlap and self.memory is Memory.TRACKING:
            return (
                "the limits of both controls overlap, so that what a tracking controller holds depends on the other's "
                "control; write output_limits so that the second mode's control ends where the first one's begins"
            )
        return ""

    @staticmethod
    def _relative(line: Threshold) -> float:
        if line.is_absolute:
            raise DomainError(LINES_NOT_MODELLED)
        return line.value


@dataclass(frozen=True)
class LagRange:
    """All plants of a family as (2), in balls.

    Args:
        shares: the least and the largest m of a whole sample.
        gains: the least and the largest K, output unit per unit of control.
        late: the least and the largest m_1 of (4); 0 without a computing delay.
        vertices: plants at all combinations of ends; the convex hull of their matrices holds those of all plants.
    """

    shares: tuple[arb, arb]
    gains: tuple[arb, arb]
    late: tuple[arb, arb]
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
        rates = [1 / tau for tau in reversed(values["time_constant_s"])]
        gains = values["static_gain"]
    else:
        rates = poles = values["pole_rad_s"]
        gains = [values["gain"][0] / poles[-1]]
        if len(poles) + len(values["gain"]) > 2:
            gains.append(values["gain"][-1] / poles[0])
    late, own = _times(loop, sample_time_s)
    shares = [_share(rate, arb(sample_time_s)) for rate in rates]
    parts = [[_share(rate, time) for rate in rates] for time in (late, own)]
    if not loop.delay_samples > 0.0:
        vertices = tuple(Lag(share, gain) for share in shares for gain in gains)
    else:
        # a whole sample's delay leaves nothing to the control that the sample computes
        parts = [part if time > 0 else part[:1] for part, time in zip(parts, (late, own), strict=True)]
        vertices = tuple(Lag(share, gain, before) for before in parts[0] for share in parts[1] for gain in gains)
    return LagRange((shares[0], shares[-1]), (gains[0], gains[-1]), (parts[0][0], parts[0][-1]), vertices)


def lag_at(loop: SwitchedLoop, sample_time_s: float, numbers: Mapping[str, float]) -> Lag:
    """One plant of the family as a lag.

    Args:
        loop: its plant has `loop_obstacle` empty.
        sample_time_s: Ts.
        numbers: values of the uncertain numbers, in the spec's units; the nominal ones where left out.
    """
    value = {name: arb(numbers.get(name, number.nominal)) for name, number in loop.plant.parameters.items()}
    if loop.plant.model == "lag":
        rate, gain = 1 / value["time_constant_s"], value["static_gain"]
    else:
        rate, gain = value["pole_rad_s"], value["gain"] / value["pole_rad_s"]
    late, own = _times(loop, sample_time_s)
    return Lag(_share(rate, own), gain, _share(rate, late) if loop.delay_samples > 0.0 else None)


def loop_matrices(controller: Runtime, lag: Lag) -> tuple[arb_mat, arb_mat, arb_mat]:
    """One loop around its equilibrium:  zeta <- A zeta + B q,  v - v* = C zeta,  where q = v - u is cut off.

    zeta = (y - r, x_0 - r/K, x_1, ...): at rest the integrator alone holds the control r/K.  With a computing delay
    u_last - r/K comes last.

    Args:
        controller: with an integrator.
        lag: the plant.

    Returns:
        A, shape (N, N), B (N, 1) and C (1, N), with N = n + 1, or n + 2 with a computing delay.
    """
    share, late, count = lag.share, lag.late, len(controller.poles)
    direct, back = arb(controller.direct), arb(controller.tracking_gain)
    step, size = share * lag.gain, count + 1 + (late is not None)
    a, b, c = arb_mat(size, size), arb_mat(size, 1), arb_mat(1, size)
    kept = 1 - share if late is None else (1 - share) * (1 - late)
    a[0, 0], b[0, 0], c[0, 0] = kept - step * direct, -step, -direct
    rows = zip(controller.poles, controller.residues, controller.weights, strict=True)
    for k, (pole, residue, weight) in enumerate(rows, 1):
        a[0, k], a[k, 0], a[k, k] = step, -arb(residue), arb(pole)
        b[k, 0], c[0, k] = -back * arb(pole) * arb(weight), arb(1)
    if late is not None:
        a[0, count + 1] = (1 - share) * late * lag.gain
        for k in range(count + 1):
            a[count + 1, k] = c[0, k]
        b[count + 1, 0] = arb(-1)
    return a, b, c


def _times(loop: SwitchedLoop, sample_time_s: float) -> tuple[arb, arb]:
    """How long the last control and the new one act in a sample, s."""
    late = arb(loop.delay_samples)
    return late * arb(sample_time_s), (1 - late) * arb(sample_time_s)


def _share(rate: arb, time_s: arb) -> arb:
    """m of (2) over a time, by expm1, which keeps the digits of a slow plant."""
    return -(-rate * time_s).expm1()


def _loop_of(system: SystemSpec, index: int, gains: FoPi) -> SwitchedLoop:
    mode = system.modes[index]
    implementation = implementation_of(mode.spec, gains)
    controller = runtime_of(implementation.sections, mode.spec)
    own = mode.feedforward, mode.hold_below_per_s
    return SwitchedLoop(mode.name, controller, mode.spec.plant, implementation.delay_samples, *own)


def loop_obstacle(loop: SwitchedLoop) -> str:
    """Why a loop is outside of these methods, with its name; empty where it is not."""
    found = plant_obstacle(loop)
    return f"{loop.name}: {found}" if found else ""


def plant_obstacle(loop: SwitchedLoop) -> str:
    """Why a loop is outside of these methods; empty where it is not."""
    parameters = loop.plant.parameters
    if loop.controller.limits_rate:
        return RATE_NOT_MODELLED
    if loop.feedforward is not None:
        return "a feed-forward of the setpoint is not modelled in this proof"
    if loop.hold_below_per_s is not None:
        return "a standstill is not modelled in this proof"
    if not loop.controller.acts_on_error:
        return "a derivative, a measurement filter and a setpoint weight are not modelled in this proof"
    if isinstance(loop.plant, ParametricFamily):
        return "plants by named parameters or zeros and poles are not handled; write a lag or a pole"
    if loop.plant.model not in ("lag", "pole"):
        return "only plants of model lag or pole are handled"
    if parameters["dead_time_s"].max > 0.0:
        return "a dead time is not modelled in this proof"
    if not 0.0 <= loop.delay_samples <= 1.0:
        return "a computing delay of more than one sample is not modelled in this proof"
    if parameters["static_gain" if loop.plant.model == "lag" else "gain"].min <= 0.0:
        return "the plant's gain must be positive; turn the sign of its control"
    if loop.plant.model == "pole" and parameters["pole_rad_s"].min <= 0.0:
        return "the plant is not stable by itself; only stable ones are handled"
    if not loop.controller.has_integrator:
        return "the controller has no integrator, so that it rests beside the setpoint"
    return ""

"""Sampled-data loops:  a digital controller, a zero-order hold, a plant with its delays, and the sampler.

Let the dead time and the computing delay together be d + f samples (d whole, 0 <= f < 1).  At the sampling instants the
plant behind the hold is exactly

    P(z) = z^-(d+1) Q(z)/R(z),    Q(z) = c adj(zI - Phi) (g_0 z + g_1) + q0 R(z),    R(z) = det(zI - Phi),           (1)

with Phi = e^{A Ts}, g_0 = int_0^{(1-f)Ts} e^{As} b ds, g_1 = int_{(1-f)Ts}^{Ts} e^{As} b ds, q0 the direct path; the
measurement is taken just before the new control acts.  A, b and c are a state space of the plant without its delay.  Q
and R are stored as polynomials in delta = z - 1, which avoids cancellation at poles close to 1.

The bilinear map z = (1 + w)/(1 - w) takes the unit circle to the imaginary axis, w = j nu with nu = tan(omega Ts/2),
and its outside to the right half-plane.  The loop is rational in w, so that crossings and peaks are found as for
continuous loops, from the same Bode form (`fopi_tune.core.bode_form`) with u = ln nu.  A root z0 gives the factor

    z - z0 = (-delta_0 + w (2 + delta_0))/(1 - w),    delta_0 = z0 - 1,    z^-1 = (1 - w)/(1 + w) .                  (2)

Source: Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., 1997; (2) is the w-transform of a factor.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array, BodeForm, Complex, Rows
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.roots import leading_coefficients, polynomial_at
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.core.zero_order_hold import behind_hold
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    from fopi_tune.core.compiled.loops import Direct

_AXIS_TOLERANCE = 1e-9
#: exponents of omega are clipped here, so that nu and 1/nu stay finite
_U_CAP = 600.0
#: samples; a delay this close to a whole number of samples is rounded to it
WHOLE = 1e-12
MOST_DELAY_SAMPLES = 10_000
#: in delta; a zero beyond this has no effect on the unit circle
_FARTHEST_ZERO = 1e12


@dataclass(frozen=True)
class SampledPlants(Plants):
    """m plants behind a hold, as in (1).

    Args:
        numerator: Q in descending powers of delta, shape (m, n + 1).
        denominator: R, shape (m, n + 1).
        dead_time_s: 0; all delay is in `late`.
        late: d + 1, the delay in samples, shape (m,), whole numbers.
    """

    late: Array

    @classmethod
    def behind_hold(cls, plants: Plants, sample_time_s: float, delay_s: float) -> SampledPlants:
        """Sample plants exactly.

        Args:
            plants: m continuous plants.
            sample_time_s: Ts.
            delay_s: computing delay, on top of the plants' dead times.

        Raises:
            DomainError: more than 10,000 samples of delay.
        """
        samples = (plants.dead_time_s + delay_s) / sample_time_s
        if np.any(samples > MOST_DELAY_SAMPLES):
            raise DomainError(
                f"the dead time is {samples.max():.3g} samples long; take a sample time that is not that much shorter"
            )
        whole = np.floor(samples + WHOLE)
        part = np.clip(samples - whole, 0.0, 1.0)
        numerator, denominator = behind_hold(plants.numerator, plants.denominator, sample_time_s, part)
        return cls(numerator, denominator, np.zeros(len(plants)), whole + 1.0)

    def take(self, rows: Rows) -> SampledPlants:
        """Select rows, with repetition."""
        return SampledPlants(self.numerator[rows], self.denominator[rows], self.dead_time_s[rows], self.late[rows])

    @cached_property
    def unstable_poles(self) -> NDArray[np.int_]:
        """Number of poles outside the unit circle, shape (m,)."""
        rho = _nudged(_ray(self.poles))
        return (np.isfinite(self.poles) & (self.poles != 0.0) & (rho.real < 0.0)).sum(axis=1)

    @cached_property
    def hidden_on_axis(self) -> NDArray[np.bool_]:
        """Whether Q and R share a root on the unit circle, shape (m,): a hidden mode that no controller moves."""
        poles, zeros = self.poles[:, :, None], self.zeros[:, None, :]
        on_circle = np.isfinite(poles) & (np.abs(np.abs(1.0 + poles) - 1.0) <= _AXIS_TOLERANCE * np.abs(poles))
        # roots that a lower degree than others' does not have are infinite
        both = on_circle & np.isfinite(zeros)
        poles, zeros = np.where(both, poles, 0.0), np.where(both, zeros, 0.0)
        return np.asarray((both & (np.abs(zeros - poles) <= _AXIS_TOLERANCE * np.abs(poles))).any(axis=(1, 2)))

    def at(self, rows: Rows, u: Array) -> Complex:
        """P at nu = e^u; rows and u of shape (n,)."""
        delta = shifted(u)
        late = np.exp(-2j * self.late[rows] * np.arctan(np.exp(u)))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return late * polynomial_at(self.numerator[rows], delta) / polynomial_at(self.denominator[rows], delta)

    @cached_property
    def log(self) -> BodeForm:
        """ln P; every pole outside the unit circle starts at -180 deg, as in continuous time."""
        leading = leading_coefficients(self.numerator) / leading_coefficients(self.denominator)
        return _bode_form(leading, self.zeros, self.poles, self.late)


@dataclass(frozen=True)
class SampledLoops(Loops):
    """m loops of one digital controller; `kp`, `ki`, `alpha` are the gains it approximates.

    Args:
        sections: the controller.
    """

    plants: SampledPlants  # pyright: ignore[reportIncompatibleVariableOverride]
    sections: Sections

    @classmethod
    def implemented(cls, gains: FoPi, implementation: Implementation, plants: Plants) -> SampledLoops:
        """One digital controller with every one of these continuous plants."""
        rows = np.ones(len(plants))
        sampled = SampledPlants.behind_hold(plants, implementation.sample_time_s, implementation.delay_s)
        return cls(
            gains.kp * rows, gains.ki * rows, gains.alpha * rows, sampled, implementation.sections,
            measurement_filter=gains.measurement_filter,
        )  # fmt: skip

    def take(self, rows: Rows) -> SampledLoops:
        """Select rows."""
        return SampledLoops(
            self.kp[rows], self.ki[rows], self.alpha[rows], self.plants.take(rows), self.sections,
            measurement_filter=self.measurement_filter,
        )  # fmt: skip

    @cached_property
    def integral_is_cancelled(self) -> NDArray[np.bool_]:
        """Whether the controller's pole at z = 1 meets a zero of the plant there, shape (m,)."""
        return np.asarray((1.0 in self.sections.poles) & (self.plants.numerator[:, -1] == 0.0))

    @property
    def highest_rad_s(self) -> float:
        """Nyquist's frequency pi/Ts."""
        return float(np.pi / self.sections.sample_time_s)

    def omega_of(self, u: Array) -> Array:
        """omega = (2/Ts) atan(e^u)."""
        return 2.0 / self.sections.sample_time_s * np.arctan(np.exp(np.clip(u, -700.0, 700.0)))

    def u_of(self, omega_rad_s: Array) -> Array:
        """ln tan(omega Ts/2); inf from Nyquist's frequency on."""
        half = 0.5 * np.asarray(omega_rad_s, dtype=float) * self.sections.sample_time_s
        inside = np.minimum(half, 0.5 * np.pi)
        with np.errstate(divide="ignore"):
            u = np.log(np.sin(inside)) - np.log(np.maximum(np.cos(inside), 0.0))
        return np.where(half >= 0.5 * np.pi, np.inf, u)

    @property
    def log_unit(self) -> float:
        """ln(2/Ts)."""
        return float(np.log(2.0 / self.sections.sample_time_s))

    def stretch(self, u: Array) -> Array:
        """d ln omega/du = sin(2x)/(2x) at x = omega Ts/2 = atan(e^u)."""
        cut = np.clip(u, -_U_CAP, _U_CAP)
        return 1.0 / (2.0 * np.cosh(cut) * np.arctan(np.exp(cut)))

    @property
    def filter_of_nu(self) -> MeasurementFilter | None:
        """F as a function of w = j nu, (1) of `measurement_filter`."""
        filtered = self.measurement_filter
        return None if filtered is None else filtered.slower(2.0 / self.sections.sample_time_s)

    @property
    def _filter_polynomials(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Of F in delta, with w = delta/(2 + delta)."""
        if self.filter_of_nu is None:
            return (1.0,), (1.0,)
        a = self.filter_of_nu.time_constant_s
        if self.filter_of_nu.order == 1:
            return (1.0, 2.0), (1.0 + a, 2.0)
        return (1.0, 4.0, 4.0), (1.0 + a + 0.5 * a * a, 4.0 + 2.0 * a, 4.0)

    @cached_property
    def _log_terms(self) -> BodeForm:
        """ln(C/F)."""
        zeros, poles, gain = zeros_and_poles(self.sections)
        one = _bode_form(np.array([gain]), zeros[None, :], poles[None, :], np.zeros(1))
        return one.take(np.zeros(len(self), dtype=np.intp))

    @cached_property
    def log(self) -> BodeForm:
        """ln L."""
        zeros, poles, gain = zeros_and_poles(self.sections)
        rows, plants = len(self), self.plants
        found = _bode_form(
            gain * leading_coefficients(plants.numerator) / leading_coefficients(plants.denominator),
            np.concatenate([np.broadcast_to(zeros, (rows, len(zeros))), plants.zeros], axis=1),
            np.concatenate([np.broadcast_to(poles, (rows, len(poles))), plants.poles], axis=1),
            plants.late,
        )
        return found if self.filter_of_nu is None else found + self.filter_of_nu.log(rows)

    def controller_at(self, u: Array) -> Complex:
        """C with its measurement filter at nu = e^u, shape (n,)."""
        terms = self.sections.at(shifted(u))
        return terms if self.filter_of_nu is None else terms * self.filter_of_nu(1j * np.exp(u))

    def controller_at_real(self, delta: float) -> float:
        """C with its measurement filter at z = 1 + delta, dimensionless and greater than 1."""
        terms = float(self.sections.at(np.array([delta + 0j])).real[0])
        if self.filter_of_nu is None:
            return terms
        return terms * float(self.filter_of_nu(complex(delta / (2.0 + delta))).real)

    def response(self, rows: Rows, omega: Array) -> Complex:
        """L(e^{j omega Ts}); rows and omega of shape (n,)."""
        u = np.clip(self.u_of(omega), -_U_CAP, _U_CAP)
        return self.controller_at(u) * self.plants.at(rows, u)

    @cached_property
    def direct(self) -> Direct:
        """For compiled functions: the sections and the plants behind the hold."""
        from fopi_tune.core.compiled.loops import Direct

        sections = self.sections
        table = np.array([np.array(sections.poles) - 1.0, np.array(sections.residues)], dtype=float)
        late = self.plants.late.astype(float)
        return Direct(np.zeros((6, len(self))), table, float(sections.direct), *self._polynomials, late, True)


def shifted(u: Array) -> Complex:
    """delta = z - 1 = 2j nu/(1 - j nu) at nu = e^u, shape (n,)."""
    return 2j / (np.exp(-np.clip(u, -_U_CAP, _U_CAP)) - 1j)


@lru_cache(maxsize=64)
def zeros_and_poles(sections: Sections) -> tuple[Complex, Complex, float]:
    """Zeros and poles of C in delta = z - 1, and its leading coefficient.

    The zeros are the finite generalised eigenvalues lambda of the sections' own state space,

        det [[diag(p - 1) - lambda, r], [1', direct]] = 0 ,

    which needs no division by the direct feedthrough, which may be small.  Zeros beyond `_FARTHEST_ZERO` are left out.
    """
    from scipy.linalg import eigvals

    shifts, residues = np.array(sections.poles) - 1.0, np.array(sections.residues)
    n = len(shifts)
    poles = shifts.astype(complex)
    if not n:
        return poles, poles, sections.direct
    pencil = np.zeros((n + 1, n + 1))
    pencil[:n, :n] = np.diag(shifts)
    pencil[:n, n], pencil[n, :n], pencil[n, n] = residues, 1.0, sections.direct
    pairs = np.asarray(eigvals(pencil, np.diag([*np.ones(n), 0.0]), homogeneous_eigvals=True), dtype=complex)
    top, bottom = pairs[0], pairs[1]
    finite = np.abs(top) < _FARTHEST_ZERO * np.abs(bottom)
    zeros = np.asarray(top[finite] / bottom[finite], dtype=complex)
    if len(zeros) == n:
        return zeros, poles, sections.direct
    # the next coefficients of direct prod (delta - p) + sum r_k prod_(i != k) (delta - p_i)
    leading = float(residues.sum())
    if len(zeros) < n - 1 or leading == 0.0:
        return _by_polynomial(shifts, residues, poles)
    return zeros, poles, leading


def _by_polynomial(shifts: Array, residues: Array, poles: Complex) -> tuple[Complex, Complex, float]:
    """Zeros and poles where the sum of the residues vanishes too: roots of sum r_k prod_(i != k) (delta - p_i)."""
    top = np.zeros(len(shifts))
    for k, residue in enumerate(residues):
        top = top + residue * np.real(np.poly(np.delete(shifts, k)))
    top = np.trim_zeros(top, "f")
    if not len(top):
        raise DomainError("the digital controller is 0: there is no loop; use other gains or another filter")
    return np.roots(top).astype(complex), poles, float(top[0])


def _bode_form(gain: Array, zeros: Complex, poles: Complex, late: Array) -> BodeForm:
    """ln of gain prod(delta - zeros)/prod(delta - poles) z^-late in Bode form, by (2); roots at inf are ignored."""
    roots = np.concatenate([zeros, poles], axis=1)
    sign = np.concatenate([np.ones(zeros.shape), -np.ones(poles.shape)], axis=1)
    there = np.isfinite(roots)
    origin = there & (roots == 0.0)
    inner = there & ~origin
    safe: Complex = np.where(inner, roots, 1.0)
    rho: Complex = np.where(inner, _nudged(_ray(safe)), 0.0)
    moving = inner & (rho != 0.0)
    constant = np.log(np.abs(gain)) + (sign * np.where(inner, np.log(np.abs(safe)), 0.0)).sum(axis=1)
    slope0 = (sign * origin).sum(axis=1)
    constant = constant + slope0 * np.log(2.0)
    unstable = (moving & (sign < 0) & (rho.real < 0.0)).sum(axis=1)
    # the sign as omega -> 0: a real root delta_0 > 0 gives -delta_0 < 0
    flips = (inner & (np.abs(safe.imag) <= 1e-12 * np.abs(safe)) & (safe.real > 0.0)).sum(axis=1)
    negative = ((gain < 0) ^ (flips % 2 == 1)) ^ (unstable % 2 == 1)
    phase0 = np.asarray(-np.pi * negative - np.pi * unstable + 0.5 * np.pi * slope0, dtype=float)
    excess = -(sign * there).sum(axis=1) + late
    m = len(gain)
    rays = np.where(moving, rho, 1.0)
    return BodeForm(
        constant,
        slope0,
        phase0,
        np.concatenate([sign, excess[:, None], -late[:, None]], axis=1),
        np.ones((m, roots.shape[1] + 2)),
        np.concatenate([np.where(moving, -np.log(np.abs(rays)), np.inf), np.zeros((m, 2))], axis=1),
        np.concatenate(
            [
                np.where(moving, np.angle(1j * rays), 0.0),
                np.full((m, 1), -0.5 * np.pi),
                np.full((m, 1), 0.5 * np.pi),
            ],
            axis=1,
        ),
        np.zeros(m),
    )


def _ray(roots: Complex) -> Complex:
    """rho of -delta_0 (1 + rho w): -(2 + delta_0)/delta_0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-(2.0 + roots) / roots, dtype=complex)


def _nudged(rho: Complex) -> Complex:
    """The same rays, with roots on the unit circle moved just inside."""
    on_axis = np.isfinite(rho) & (np.abs(rho.real) <= _AXIS_TOLERANCE * np.abs(rho.imag))
    return np.where(on_axis, _AXIS_TOLERANCE * np.abs(rho.imag) + 1j * rho.imag, rho)

"""The loop on samples as a loop on the imaginary axis:  filter, hold equivalents and delays at s = j e^v (compiled).

With w = (2/Ts) tan(omega Ts/2), v = ln(w/omega_s), h = omega_s Ts/2 and z = (1 + h s)/(1 - h s) the unit circle is the
axis s = j e^v, Nyquist's frequency v -> inf, and

    omega/omega_s = atan(h e^v)/h ,     arg z^-d = -2 d atan(h e^v) ,                                               (1)
    F = e^g/s prod_k (s + z_k)/(s + p_k) ,     ln z_k, ln p_k = a + b alpha + c ln alpha ,                          (2)

where F stands for omega_s^alpha s^-alpha by Tustin's rule.  With T = Ts/2, or tan(w_p T)/w_p where it is prewarped, the
filter's own s is s Ts/(2 T), which moves its corners.  Matched poles and zeros have tanh(h corner)/h for a corner.  The
gain g sets |F| where `digital/` sets it.  A derivative of the order mu is, by Tustin's rule whatever the integral's is,

    D = s^2 F_(2 - mu)/(Tf s + 1) ,                                                                                 (3)

F_(2 - mu) being (2) at the order 2 - mu with T = Ts/2 (`digital/transforms.py`, (3)); at mu = 1 that is s/(Tf s + 1).
A plant behind the hold is a quotient of polynomials in s of its own degree and a whole number of samples of delay.

Source: derived; `core/sampled_loops.py`, (2), with w = h s, and `digital/oustaloup.py`, (1) and (3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.sampled_loops import WHOLE, SampledPlants
from fopi_tune.design.constraints import Scale
from fopi_tune.design.global_search.compiled import Sampling, compiled, entry
from fopi_tune.digital.discretize import Method, Rule
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import DigitalSpec

#: terms of the exponential series: 0.5^16/16! = 1e-18
_TERMS = 17
#: the modified filter's fast zero and pole, as in `digital/oustaloup.py`
_FAST = math.log(10.0 / 9.0)


@compiled
def turn_of(v, delay, half):
    """How far a dead time (in 1/omega_s), or whole samples of delay, turn the phase, rad."""
    return math.exp(v) * delay if half == 0.0 else 2.0 * delay * math.atan(half * math.exp(v))


@compiled
def turn_rate(v, delay, half):
    """d turn/d v."""
    turn = math.exp(v) * delay
    return turn if half == 0.0 else 2.0 * half * turn / (1.0 + (half * math.exp(v)) ** 2)


@entry
def log_omega_of(v, half):
    """ln(omega/omega_s), by (1)."""
    return v if half == 0.0 else math.log(math.atan(half * math.exp(v)) / half)


@compiled
def stretch_of(v, half):
    """d ln omega/d v."""
    nu = half * math.exp(v)
    return 1.0 if half == 0.0 else nu / ((1.0 + nu * nu) * math.atan(nu))


@compiled
def delayed_at_real(delay, s, half):
    """e^-(delay s), or z^-delay of whole samples, at a real s."""
    return math.exp(-s * delay) if half == 0.0 else ((1.0 - half * s) / (1.0 + half * s)) ** delay


@entry
def plant_of(family, point, plant):
    """Write the coefficients of the plant at a point of the box."""
    if len(family.powers) > 0:
        polynomials_of(family, point, plant)
    else:
        for k in range(len(plant)):
            total = family.terms[0, k]
            for u in range(len(point)):
                total += point[u] * family.terms[1 + u, k]
            plant[k] = total
    if family.half > 0.0:
        behind_hold(plant, family.half, family.delay)
        filter_denominator(plant)


@compiled
def filter_denominator(plant):
    """Multiply D by 1 + a s + b s^2 of a measurement filter: by Tustin's rule F has the same form in s = j e^v."""
    width = (len(plant) - 3) // 2
    lag, square = plant[2 * width + 1], plant[2 * width + 2]
    if lag == 0.0:
        return
    for k in range(width, 2 * width):
        # ascending k lowers the power; what is read has not been changed yet
        if k + 1 < 2 * width:
            plant[k] += lag * plant[k + 1]
        if k + 2 < 2 * width:
            plant[k] += square * plant[k + 2]


@compiled
def polynomials_of(family, point, plant):
    """Write the coefficients that are polynomials in a point of the box."""
    for k in range(len(plant)):
        plant[k] = 0.0
    for t in range(len(family.powers)):
        product = 1.0
        for u in range(len(point)):
            for _ in range(family.powers[t, u]):
                product *= point[u]
        for k in range(len(plant)):
            plant[k] += product * family.terms[t, k]


@compiled
def behind_hold(plant, half, delay):
    """Replace a continuous plant's coefficients by those of its exact hold equivalent, as `core/sampled_loops.py`, (1).

    Args:
        plant: N, D, the dead time in 1/omega_s and two numbers of a filter; then N, D and whole samples.
        half: h.
        delay: the computing delay in samples.
    """
    width = (len(plant) - 3) // 2
    n = width - 1
    while plant[2 * width - 1 - n] == 0.0:
        n -= 1
    samples = 0.5 * plant[2 * width] / half + delay
    whole = math.floor(samples + WHOLE)
    part = max(samples - whole, 0.0)
    # time in samples: the coefficients of falling powers take 1, 2 h, (2 h)^2, ...
    top, bottom, leading = np.empty(n + 1), np.empty(n + 1), plant[2 * width - 1 - n]
    for k in range(n + 1):
        unit = (2.0 * half) ** k / leading
        top[k], bottom[k] = plant[width - 1 - n + k] * unit, plant[2 * width - 1 - n + k] * unit
    a, c = np.zeros((n, n)), np.empty(n)
    for k in range(n):
        a[0, k], c[k] = -bottom[1 + k], top[1 + k] - top[0] * bottom[1 + k]
        if k > 0:
            a[k, k - 1] = 1.0
    step, first = transition(a, 1.0)
    second = np.zeros(n)
    if part > 0.0:
        moved, first = transition(a, 1.0 - part)
        _, last = transition(a, part)
        product(moved, last, second)
        for k in range(n):
            second[k] += last[k]
    q, r = np.zeros(n + 1), np.zeros(n + 1)
    r[0] = 1.0
    b, moved, row = np.eye(n), np.empty((n, n)), np.empty(n)
    for k in range(n):
        # Faddeev and LeVerrier's recursion of `core/zero_order_hold.py`
        product(b, first, row)
        for i in range(n):
            q[k] += c[i] * row[i]
            q[k + 1] += c[i] * row[i]
        product(b, second, row)
        for i in range(n):
            q[k + 1] += c[i] * row[i]
        product_of(step, b, moved)
        trace = 0.0
        for i in range(n):
            trace += moved[i, i]
        for i in range(k + 1, n + 1):
            if bottom[i] != 0.0:
                r[k + 1] = -trace / (k + 1)
        for i in range(n):
            for j in range(n):
                b[i, j] = moved[i, j] - (trace / (k + 1) if i == j else 0.0)
    for k in range(n + 1):
        q[k] += top[0] * r[k]
    if bottom[n] != 0.0:
        q[n] = top[n] / bottom[n] * r[n]
    write_bilinear(q, half, plant, width)
    write_bilinear(r, half, plant, 2 * width)
    plant[2 * width] = whole + 1.0


@compiled
def product(matrix, vector, out):
    """Write a small matrix times a vector."""
    for i in range(len(vector)):
        out[i] = 0.0
        for k in range(len(vector)):
            out[i] += matrix[i, k] * vector[k]


@compiled
def product_of(a, b, out):
    """Write the product of two small matrices."""
    for i in range(len(a)):
        for j in range(len(a)):
            out[i, j] = 0.0
            for k in range(len(a)):
                out[i, j] += a[i, k] * b[k, j]


@compiled
def transition(a, t):
    """e^(A t) - I, and int_0^t e^(A s) ds e_1, by the series at t/2^k and k doublings."""
    n, norm = len(a), 0.0
    for i in range(n):
        size = 0.0
        for k in range(n):
            size += abs(a[i, k])
        norm = max(norm, size)
    halvings = 0
    while norm * t > 0.5:
        t *= 0.5
        halvings += 1
    less, power, scratch = np.zeros((n, n)), np.eye(n), np.empty((n, n))
    integral, more = np.zeros(n), np.empty(n)
    if n > 0:
        integral[0] = t
    for k in range(1, _TERMS):
        product_of(a, power, scratch)
        for i in range(n):
            for j in range(n):
                power[i, j] = scratch[i, j] * (t / k)
                less[i, j] += power[i, j]
            integral[i] += power[i, 0] * (t / (k + 1))
    for _ in range(halvings):
        product(less, integral, more)
        product_of(less, less, scratch)
        for i in range(n):
            integral[i] = 2.0 * integral[i] + more[i]
            for j in range(n):
                less[i, j] = 2.0 * less[i, j] + scratch[i, j]
    return less, integral


@compiled
def write_bilinear(coefficients, half, out, end):
    """A polynomial in delta = 2 h s/(1 - h s), times (1 - h s)^n, as one in s, falling powers that end before `end`."""
    n = len(coefficients) - 1
    found, factor = np.zeros(n + 1), np.zeros(n + 1)
    found[0], factor[0] = coefficients[0], 1.0
    for k in range(1, n + 1):
        for j in range(n, 0, -1):
            found[j] = 2.0 * half * found[j - 1]
            factor[j] -= half * factor[j - 1]
        found[0] = 0.0
        for j in range(n + 1):
            found[j] += coefficients[k] * factor[j]
    for j in range(n + 1):
        out[end - 1 - j] = found[j]


@dataclass(frozen=True)
class Samples:
    """What samples a loop.

    Args:
        digital: the spec's section.
        scale: omega_s and g_s.
        crossover_rad_s: the nominal crossover, where a prewarped or matched filter is exact; None: the band's middle.
    """

    digital: DigitalSpec
    scale: Scale
    crossover_rad_s: float | None = None

    @property
    def half(self) -> float:
        """h."""
        return 0.5 * self.scale.omega_rad_s * self.digital.sample_time_s

    @property
    def nyquist_rad_s(self) -> float:
        """pi/Ts."""
        return math.pi / self.digital.sample_time_s

    def log_nu(self, omega_rad_s: Array) -> Array:
        """ln tan(omega Ts/2); inf from Nyquist's frequency on."""
        angle = 0.5 * np.asarray(omega_rad_s, dtype=float) * self.digital.sample_time_s
        below = np.minimum(angle, 0.5 * math.pi)
        with np.errstate(divide="ignore"):
            return np.where(angle < 0.5 * math.pi, np.log(np.tan(below)), np.inf)

    @cached_property
    def sampling(self) -> Sampling:
        """The filter's numbers.

        Raises:
            DomainError: a method that is not smooth in alpha.
        """
        digital, method = self.digital, Method(self.digital.method)
        if method is Method.FIT:
            raise DomainError(
                "method: fit has no `design: sampled`, as its poles jump when alpha changes; take "
                "modified_oustaloup, or a fixed alpha and the solver convex"
            )
        corners, middle = self._corners, self._middle
        low, high = digital.band_rad_s
        log_s = math.log(self.scale.omega_rad_s)
        at = self.crossover_rad_s
        if at is None or at >= self.nyquist_rad_s:
            at = math.sqrt(low * min(high, self.nyquist_rad_s))
        warped = float(self.log_nu(np.array(at))) - math.log(self.half)
        if Rule(digital.rule) is Rule.MATCHED:
            gain = (middle, middle, math.log(at) - log_s, warped)
            return Sampling(self.half, corners, 1, np.array(gain))
        if digital.prewarp == "crossover":
            moved = warped - (math.log(at) - log_s)
            corners[:, 0] += moved
            return Sampling(self.half, corners, 0, np.array((middle, middle + moved, middle + moved, middle + moved)))
        return Sampling(self.half, corners, 0, np.array((middle, middle, middle, middle)))

    @property
    def _middle(self) -> float:
        """ln of the middle of the band, scaled."""
        low, high = self.digital.band_rad_s
        return math.log(math.sqrt(low * high)) - math.log(self.scale.omega_rad_s)

    @property
    def _corners(self) -> Array:
        """a, b and c of (2) in continuous time, a row a corner."""
        method, (low, high) = Method(self.digital.method), self.digital.band_rad_s
        log_s = math.log(self.scale.omega_rad_s)
        count = self.digital.poles - (method is Method.MODIFIED_OUSTALOUP)
        step = math.log(high / low) / max(count, 1)
        base = math.log(low) - log_s + step * (np.arange(count) + 0.5)
        # beta = 1 - alpha:  ln z_k, ln p_k = base -+ beta step/2
        tilt = np.full(count, 0.5 * step)
        zeros = np.column_stack([base - tilt, tilt, 0.0 * tilt])
        poles = np.column_stack([base + tilt, -tilt, 0.0 * tilt])
        if method is Method.MODIFIED_OUSTALOUP:
            fast = math.log(high) - log_s + _FAST
            zeros, poles = np.vstack([zeros, [fast, 0.0, 0.0]]), np.vstack([poles, [fast, 0.0, -1.0]])
        return np.stack([zeros, poles], axis=1).reshape(-1, 3)

    def with_orders(self, derivative: float) -> Sampling:
        """The filters' numbers beside a derivative of any order.

        Args:
            derivative: Tf omega_s.

        Raises:
            DomainError: a method that is not smooth in the orders.
        """
        if Method(self.digital.method) is Method.FIT:
            raise DomainError(
                "method: fit has no `design: sampled` for structure: fopid, as its poles jump when an order changes; "
                "take method: oustaloup or modified_oustaloup"
            )
        return self.sampling._replace(derivative=derivative, rise_corners=self._corners)

    def integrator(self, derivative: float) -> Sampling:
        """The numbers of an integrator, which every method makes without corners, beside a derivative.

        Args:
            derivative: Tf omega_s.  The derivative is made by Tustin's rule whatever the integrator's is, so that with
                h s = (z - 1)/(z + 1) it is s/(Tf omega_s s + 1).
        """
        gain = np.zeros(4) if Method(self.digital.method) is Method.FIT else self.sampling.gain
        return Sampling(self.half, np.zeros((0, 3)), 0, gain, derivative)

    def plants(self, plants: Plants) -> SampledPlants:
        """Behind the hold."""
        digital = self.digital
        return SampledPlants.behind_hold(plants, digital.sample_time_s, digital.delay_samples * digital.sample_time_s)

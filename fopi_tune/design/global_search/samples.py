"""The loop on samples as a loop on the imaginary axis:  filter, hold equivalents and delays at s = j e^v (compiled).

With w = (2/Ts) tan(omega Ts/2), v = ln(w/omega_s), h = omega_s Ts/2 and z = (1 + h s)/(1 - h s) the unit circle is the
axis s = j e^v, Nyquist's frequency v -> inf, and

    omega/omega_s = atan(h e^v)/h ,     arg z^-d = -2 d atan(h e^v) ,                                               (1)
    F = e^g/s prod_k (s + z_k)/(s + p_k) ,     ln z_k, ln p_k = a + b alpha + c ln alpha ,                          (2)

where F stands for omega_s^alpha s^-alpha by Tustin's rule.  With T = Ts/2, or tan(w_p T)/w_p where it is prewarped, the
filter's own s is s Ts/(2 T), which moves its corners.  Matched poles and zeros have tanh(h corner)/h for a corner.  The
gain g sets |F| where `digital/` sets it.  A plant behind the hold is a quotient of polynomials in s of its own degree
and a whole number of samples of delay.

Source: derived; `core/sampled_loops.py`, (2), with w = h s, and `digital/oustaloup.py`, (1) and (3).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.sampled_loops import WHOLE, SampledPlants
from fopi_tune.core.zero_order_hold import behind_hold
from fopi_tune.design.constraints import Scale
from fopi_tune.design.global_search.compiled import Family, Sampling, compiled
from fopi_tune.digital.discretize import Method, Rule
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import DigitalSpec

#: nodes with which the degree along one number is found, and the most of a whole box
_NODES, _MOST_NODES = (6, 9, 17, 33, 65), 12_000
#: relative to the largest coefficient of its power of s; smaller terms are left out, larger ones of many numbers
_NEGLIGIBLE = (1e-13, 1e-12, 1e-11, 1e-10, 1e-9)
#: relative; terms that do not fall any more are rounding if they are smaller
_ROUNDING = 1e-9
#: the modified filter's fast zero and pole, as in `digital/oustaloup.py`
_FAST = math.log(10.0 / 9.0)
#: where the controller's numbers begin in what `controller_of` returns
_HALF, _GAIN, _CORNERS = 3, 4, 5


@compiled
def controller_of(x, sampling):
    """The gains (kp', ki', alpha) and, on samples, h, e^g and the corners z_1, p_1, z_2, ... at this alpha."""
    if sampling.half == 0.0:
        return x
    alpha, h, corners = x[2], sampling.half, sampling.corners
    middle, last, here, there = sampling.gain[0], sampling.gain[1], sampling.gain[2], sampling.gain[3]
    found = np.empty(_CORNERS + len(corners))
    found[:3], found[_HALF] = x[:3], h
    g, sign = last - here + there - alpha * middle, 1.0
    for k in range(len(corners)):
        corner = math.exp(corners[k, 0] + corners[k, 1] * alpha + corners[k, 2] * math.log(alpha))
        if sampling.matched:
            square = corner * corner
            g += 0.5 * sign * (math.log(math.exp(2.0 * here) + square) - math.log(math.exp(2.0 * last) + square))
            corner = math.tanh(h * corner) / h
        g -= 0.5 * sign * math.log(math.exp(2.0 * there) + corner * corner)
        found[_CORNERS + k] = corner
        sign = -sign
    found[_GAIN] = math.exp(g)
    return found


@compiled
def filter_at(controller, omega):
    """(2) at s = j omega: real and imaginary part."""
    real, imag, square = 0.0, -controller[_GAIN] / omega, omega * omega
    for k in range(_CORNERS, len(controller), 2):
        zero, pole = controller[k], controller[k + 1]
        size = pole * pole + square
        a, b = (zero * pole + square) / size, omega * (pole - zero) / size
        real, imag = real * a - imag * b, real * b + imag * a
    return real, imag


@compiled
def integral_at_real(controller, log_s):
    """s^-alpha, or (2), at a real s."""
    if len(controller) == 3:
        return math.exp(-controller[2] * log_s)
    s = math.exp(log_s)
    value = controller[_GAIN] / s
    for k in range(_CORNERS, len(controller), 2):
        value *= (s + controller[k]) / (s + controller[k + 1])
    return value


@compiled
def half_of(controller):
    """h; 0 for the continuous loop."""
    return controller[_HALF] if len(controller) > 3 else 0.0


@compiled
def turn_of(v, delay, half):
    """How far a dead time (in 1/omega_s), or whole samples of delay, turn the phase, rad."""
    return math.exp(v) * delay if half == 0.0 else 2.0 * delay * math.atan(half * math.exp(v))


@compiled
def turn_rate(v, delay, half):
    """d turn/d v."""
    turn = math.exp(v) * delay
    return turn if half == 0.0 else 2.0 * half * turn / (1.0 + (half * math.exp(v)) ** 2)


@compiled
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


@compiled
def plant_of(family, point, plant):
    """Write the coefficients of the plant at a point of the box."""
    p = len(point)
    if len(family.powers) == 0:
        for c in range(len(plant)):
            plant[c] = family.affine[0, c]
            for u in range(p):
                plant[c] += point[u] * family.affine[1 + u, c]
        return
    late, terms = family.late, np.ones((p, family.most + 1))
    for k in range(p):
        x = math.log(point[k]) if family.logarithmic[k] else point[k]
        if k == family.late_axis:
            samples = point[k] * family.per_second + family.late
            late = math.floor(samples + WHOLE) + 1.0
            x = max(samples - late + 1.0, 0.0)
        x = (x - family.middle[k]) / family.reach[k]
        terms[k, 1] = x
        for n in range(2, family.most + 1):
            terms[k, n] = 2.0 * x * terms[k, n - 1] - terms[k, n - 2]
    for c in range(len(plant)):
        plant[c] = 0.0
    width = (len(plant) - 1) // 2
    for r in range(len(family.powers)):
        factor = 1.0
        for k in range(p):
            factor *= terms[k, family.powers[r, k]]
        for c in range(family.first, width):
            plant[c] += factor * family.values[r, c]
            plant[width + c] += factor * family.values[r, width + c]
    plant[len(plant) - 1] = late


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

    @property
    def needs_crossover(self) -> bool:
        """Whether the filter depends on the loop's crossover."""
        return self.digital.prewarp == "crossover" or Rule(self.digital.rule) is Rule.MATCHED

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
                "method: fit has no `design: sampled`, as its poles jump when alpha changes; take modified_oustaloup"
            )
        low, high = digital.band_rad_s
        log_s, count = math.log(self.scale.omega_rad_s), digital.poles - (method is Method.MODIFIED_OUSTALOUP)
        step = math.log(high / low) / max(count, 1)
        base = math.log(low) - log_s + step * (np.arange(count) + 0.5)
        # beta = 1 - alpha:  ln z_k, ln p_k = base -+ beta step/2
        tilt = np.full(count, 0.5 * step)
        zeros = np.column_stack([base - tilt, tilt, 0.0 * tilt])
        poles = np.column_stack([base + tilt, -tilt, 0.0 * tilt])
        if method is Method.MODIFIED_OUSTALOUP:
            fast = math.log(high) - log_s + _FAST
            zeros, poles = np.vstack([zeros, [fast, 0.0, 0.0]]), np.vstack([poles, [fast, 0.0, -1.0]])
        corners = np.stack([zeros, poles], axis=1).reshape(-1, 3)
        middle = math.log(math.sqrt(low * high)) - log_s
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

    def plants(self, plants: Plants) -> SampledPlants:
        """Behind the hold."""
        digital = self.digital
        return SampledPlants.behind_hold(plants, digital.sample_time_s, digital.delay_samples * digital.sample_time_s)

    def coefficients(self, numerator: Array, denominator: Array) -> tuple[Array, Array]:
        """Polynomials in delta = z - 1 as ones in s: delta = 2 h s/(1 - h s), times (1 - h s)^n."""
        n = numerator.shape[1] - 1
        change = np.zeros((n + 1, n + 1))
        for k in range(n + 1):
            product = np.ones(1)
            for factor in [np.array([2.0 * self.half, 0.0])] * (n - k) + [np.array([-self.half, 1.0])] * k:
                product = np.convolve(product, factor)
            change[k] = product
        return numerator @ change, denominator @ change


def chebyshev_family(samples: Samples, family: PlantFamily, width: int, factor: float) -> Family:
    """The coefficients over the box as sums of Chebyshev terms.

    Args:
        samples: the hold and the computing delay.
        family: the plants.
        width: of a padded polynomial.
        factor: what numerators are multiplied by.

    Raises:
        DomainError: more uncertain numbers than can be interpolated.
    """
    low, high, digital = family.low, family.high, samples.digital
    p, names = len(low), family.uncertain_names
    axis = names.index("dead_time_s") if "dead_time_s" in names else -1
    exact_late = family.parameters["dead_time_s"].nominal / digital.sample_time_s + digital.delay_samples
    logarithmic = (low * high > 0.0) & (low > 0.0)
    first, last = np.where(logarithmic, np.log(np.where(logarithmic, low, 1.0)), low), np.array(high)
    last = np.where(logarithmic, np.log(np.where(logarithmic, high, 1.0)), last)
    if axis >= 0:
        logarithmic[axis] = False
        ends = np.array([low[axis], high[axis]]) / digital.sample_time_s + digital.delay_samples
        whole = np.floor(ends + WHOLE)
        one = whole[0] == whole[1]
        first[axis], last[axis] = (np.maximum(ends - whole, 0.0)) if one else (0.0, 1.0)
    middle, reach = 0.5 * (first + last), 0.5 * (last - first)

    def at(x: Array) -> Array:
        number = middle + reach * x
        points = np.where(logarithmic, np.exp(np.where(logarithmic, number, 0.0)), number)
        part = points[:, axis] if axis >= 0 else np.full(len(x), _part(exact_late))
        numerator, denominator, _ = family.coefficients(points)
        top, bottom = behind_hold(numerator, denominator, digital.sample_time_s, part)
        top, bottom = samples.coefficients(top, bottom)
        padding = np.zeros((len(x), width - top.shape[1]))
        return np.hstack([padding, top * factor, padding, bottom, np.zeros((len(x), 1))])

    spectra, counts, negligible = [_spectrum(at, p, k) for k in range(p)], [], 0.0
    for negligible in _NEGLIGIBLE:
        counts = [int(np.flatnonzero(terms > negligible)[-1]) + 1 for terms in spectra]
        if math.prod(counts) <= _MOST_NODES:
            break
    else:
        raise DomainError(
            f"{p} uncertain numbers over these ranges are more than `design: sampled` can interpolate; fix some of "
            "them, or narrow their ranges"
        )
    nodes = np.meshgrid(*(_nodes(count) for count in counts), indexing="ij")
    values = at(np.stack([n.ravel() for n in nodes], axis=1) if p else np.zeros((1, 0)))
    size = np.abs(values).max(axis=0)
    values = values.reshape(*counts, -1)
    for k, count in enumerate(counts):
        values = np.moveaxis(np.tensordot(_transform(count), values, (1, k)), 0, k)
    values = values.reshape(-1, values.shape[-1])
    powers = np.stack([n.ravel() for n in np.indices(counts)], axis=1) if p else np.zeros((1, 0))
    kept = (np.abs(values) > negligible * size).any(axis=1)
    late = digital.delay_samples if axis >= 0 else math.floor(exact_late + WHOLE) + 1.0
    powers = np.ascontiguousarray(powers[kept]).astype(np.int64)
    return Family(
        np.zeros((1 + p, values.shape[1])), powers, np.ascontiguousarray(values[kept]), middle, reach, logarithmic,
        axis, float(late), 1.0 / digital.sample_time_s, int(powers.max(initial=1)), int(np.flatnonzero(size)[0]),
    )  # fmt: skip


def _part(samples: float) -> float:
    return max(samples - math.floor(samples + WHOLE), 0.0)


def _nodes(count: int) -> Array:
    return np.cos(math.pi * (np.arange(count) + 0.5) / count)


def _transform(count: int) -> Array:
    """Values at the nodes -> Chebyshev coefficients."""
    matrix = 2.0 / count * np.cos(math.pi * np.outer(np.arange(count), np.arange(count) + 0.5) / count)
    matrix[0] *= 0.5
    return matrix


def _spectrum(at: Callable[[Array], Array], p: int, k: int) -> Array:
    """How large the terms of one number are, relative to each coefficient's largest: at the box's middle and a vertex.

    Ends where terms are negligible, or no more than rounding: where they no longer fall.
    """
    relative = np.ones(1)
    for nodes in _NODES:
        x = np.zeros((2 * nodes, p))
        x[nodes:] = -1.0
        x[:, k] = np.tile(_nodes(nodes), 2)
        values = at(x).reshape(2, nodes, -1)
        size = np.maximum(np.abs(values).max(axis=(0, 1)), 1e-300)
        terms = np.abs(np.einsum("ij,bjc->bic", _transform(nodes), values)).max(axis=0) / size
        tail, before = terms[-(nodes // 3) :].max(axis=0), terms[nodes // 3 : -(nodes // 3)].max(axis=0)
        rounding = np.where((before < 30.0 * tail) & (tail < _ROUNDING), 10.0 * tail, 0.0)
        relative = np.where(terms > rounding, terms, 0.0).max(axis=1)
        if relative[-1] <= _NEGLIGIBLE[0]:
            break
    return relative

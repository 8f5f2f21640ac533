"""A family's plants on grids of frequencies:  ln P, its limits omega -> 0 and infinity (Nyquist) in closed form.

The polynomials give the value of ln P, the Bode form gives the branch of its phase: undamped poles are passed on the
right, and each pole in the right half-plane contributes -180 deg at omega -> 0, as Nyquist's criterion needs it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from fopi_tune.core.bode_form import Array, BodeForm, Complex, Rows
from fopi_tune.core.families.plant_list import PlantList, PlantMember
from fopi_tune.core.fractional_plants.family import fractional_part
from fopi_tune.core.loops import Plants
from fopi_tune.core.parametric.family import ParametricFamily
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.roots import times
from fopi_tune.core.sampled_loops import SampledPlants
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.design.constraints import Scale
from fopi_tune.design.global_search.compiled import (
    COEFFICIENTS,
    DELAY,
    END,
    NO_SAMPLES,
    OF_PLANTS,
    WIDTH,
    Family,
    Sampling,
    Table,
)
from fopi_tune.design.global_search.families.fractional import fractional_terms, numbers_of_terms, sides_at_real
from fopi_tune.design.global_search.samples import Samples, plant_of
from fopi_tune.errors import DomainError

#: rad; the dead time turns P by at most this between columns, up to `_LAST_TURN`
_TURN = 0.6
_LAST_TURN = 40.0
#: rad; beyond this turn between columns the grid no longer shows the phase
_ALIAS = 1.2
#: sparse columns beyond the constraints' grid, where only the controller changes
DECADES_BEYOND, _BEYOND_STEP = 5.0, 1.5
#: offsets of columns around a lightly damped root, in widths of its resonance
_AROUND = (-9, -6, -4, -3, -2, -1.5, -1, -0.75, -0.5, -0.25, 0, 0.25, 0.5, 0.75, 1, 1.5, 2, 3, 4, 6, 9)
_NARROWEST = 1e-3
#: ln tan(omega Ts/2) where a grid becomes dense and, mirrored, sparse again, and where it ends
_FIRST_LOG_NU, _LAST_LOG_NU = -2.5, 14.0
#: columns on which whole samples of delay turn
_MOST_TURNS = 4000


@dataclass(frozen=True)
class Scaled:
    """A family in scaled numbers: omega/omega_s, F P/g_s, dead time times omega_s, or whole samples of delay.

    A measurement filter F is counted to the plant, as C P = (C/F) (F P); |C S| alone asks for it apart.

    Args:
        family: the plants.
        scale: omega_s and g_s.
        plants: the coefficients over the box: 9 of N, 9 of D, the delay, 2 of F; of a list those of the first member.
        samples: what samples the loop; None in continuous time.
        parts: of a list of plants, each member alone; points are then places in the list, the member's index first.
    """

    family: PlantFamily
    scale: Scale
    plants: Family
    samples: Samples | None = None
    parts: tuple[Scaled, ...] = ()

    @classmethod
    def of(cls, family: PlantFamily, scale: Scale, samples: Samples | None = None) -> Scaled:
        """Scale the coefficients; in continuous time they are affine in the uncertain numbers, or polynomials.

        Raises:
            DomainError: a numerator or a denominator of more than degree 8, or a filter that cannot be searched.
        """
        if isinstance(family, PlantList):
            parts = [cls._of_member(member, scale, samples) for member in family.members]
            return cls(family, scale, parts[0].plants, samples, tuple(parts))
        low, high = family.low, family.high
        if (fractional := fractional_part(family)) is not None:
            return cls(family, scale, fractional_terms(fractional, scale, samples is not None))
        numerator, denominator, _ = family.coefficients(family.nominal_point[None, :])
        filtered = scale.measurement_filter
        room = WIDTH if filtered is None else WIDTH - filtered.order
        if max(numerator.shape[1], denominator.shape[1]) > room:
            beside = "" if filtered is None else f" beside a measurement filter of order {filtered.order}"
            raise DomainError(f"the plant's degree exceeds {room - 1}{beside}; reduce its order")
        corners = np.vstack([low, low + np.diag(high - low)]) if len(low) else np.zeros((1, 0))
        rows = _scaled(family.coefficients(corners), scale, filtered=samples is None)
        # one factor for all members keeps the coefficients affine, or polynomials
        unit = float(np.abs(rows[:, WIDTH : 2 * WIDTH]).max())
        of_filter = np.array([scale.lag_and_square])
        if isinstance(family, ParametricFamily):
            terms = _in_units(_scaled(family.terms(), scale, filtered=samples is None), unit)
            # F is the same for all members: a term without a power
            terms = np.vstack([np.pad(terms, ((0, 0), (0, 2))), np.pad(of_filter, ((0, 0), (DELAY + 1, 0)))])
            powers = np.vstack([family.powers, np.zeros((1, len(low)), dtype=np.int64)])
        else:
            rows = np.hstack([_in_units(rows, unit), np.repeat(of_filter, len(rows), axis=0)])
            powers = np.zeros((0, len(low)), dtype=np.int64)
            slopes = (rows[1:] - rows[0]) / (high - low)[:, None] if len(low) else np.zeros((0, rows.shape[1]))
            terms = np.vstack([rows[0] - low @ slopes, slopes])
        half, delay = (0.0, 0.0) if samples is None else (samples.half, float(samples.digital.delay_samples))
        return cls(family, scale, Family(terms, half, delay, powers), samples)

    @classmethod
    def _of_member(cls, member: PlantMember, scale: Scale, samples: Samples | None) -> Scaled:
        try:
            return cls.of(member.family, scale, samples)
        except DomainError as error:
            raise DomainError(f"{member.name}: {error}") from None

    @property
    def terms(self) -> tuple[int, int]:
        """Of fractional plants the numbers of terms of N and D, else (0, 0)."""
        return numbers_of_terms(self.plants)

    @property
    def sampling(self) -> Sampling:
        """What responses of the controller depend on besides its own numbers."""
        # the orders beside a derivative are set where they are known
        derivative = self.scale.filter_s * self.scale.omega_rad_s
        if self.samples is None:
            return NO_SAMPLES._replace(derivative=derivative)
        if not derivative:
            return self.samples.sampling
        return self.samples.with_orders(derivative) if self.scale.has_orders else self.samples.integrator(derivative)

    def with_samples(self, samples: Samples) -> Scaled:
        """The same plants sampled otherwise."""
        return replace(self, samples=samples, parts=tuple(part.with_samples(samples) for part in self.parts))

    def members(self, points: Array) -> Array:
        """Coefficients of the plants at points of the box, shape (m, 21)."""
        if isinstance(self.family, PlantList):
            return np.array([self.member(point) for point in points])
        if self.samples is None and len(self.plants.powers) == 0:
            return self.plants.terms[0] + points @ self.plants.terms[1:]
        return np.array([self.member(point) for point in points])

    def member(self, point: Array) -> Array:
        """Coefficients of the plant at a point of the box, shape (21,)."""
        if isinstance(self.family, PlantList):
            index = int(point[0])
            return self.parts[index].member(self.family.point(index, point[None, :])[0])
        if self.samples is None and len(self.plants.powers) == 0:
            return self.plants.terms[0] + point @ self.plants.terms[1:]
        plant = np.empty(COEFFICIENTS)
        plant_of(self.plants, point, plant)
        return plant

    def horizon(self, horizon_s: float) -> float:
        """The real s of a horizon T: 1/(T omega_s), on samples that of z = e^(Ts/T)."""
        if self.samples is None:
            return 1.0 / (horizon_s * self.scale.omega_rad_s)
        return math.tanh(0.5 * self.samples.digital.sample_time_s / horizon_s) / self.samples.half

    def delayed_at_real(self, s: float, delay: Array) -> Array:
        """e^-(delay s), or z^-delay of whole samples, at a real s; shape of `delay`."""
        if self.samples is None:
            return np.exp(-s * delay)
        return ((1.0 - self.samples.half * s) / (1.0 + self.samples.half * s)) ** delay

    def v_of(self, log_omega: float) -> float:
        """v at the ln of a frequency in rad/s; inf from Nyquist's on."""
        if self.samples is None:
            return log_omega - math.log(self.scale.omega_rad_s)
        return float(self.samples.log_nu(np.exp(log_omega))) - math.log(self.samples.half)


def _scaled(coefficients: tuple[Array, Array, Array], scale: Scale, filtered: bool) -> Array:
    """Numerators, denominators and dead times in scaled numbers, side by side, shape (m, 19).

    `filtered`: times F, which on samples comes behind the hold.
    """
    numerator, denominator, dead_time = coefficients
    if filtered and scale.measurement_filter is not None:
        denominator = times(denominator, scale.measurement_filter.coefficients)
    omega = scale.omega_rad_s

    def padded(rows: Array) -> Array:
        powers = omega ** np.arange(rows.shape[1] - 1, -1, -1.0)
        return np.hstack([np.zeros((len(rows), WIDTH - rows.shape[1])), rows * powers])

    return np.hstack([padded(numerator) / scale.gain, padded(denominator), dead_time[:, None] * omega])


def _in_units(rows: Array, unit: float) -> Array:
    return np.hstack([rows[:, :-1] / unit, rows[:, -1:]])


def vertices(family: PlantFamily) -> Array:
    """The nominal point and the vertices of the box, shape (m, p); a sample of them where there are more than 64.

    Of a list of plants those of every member, as places in the list.
    """
    if isinstance(family, PlantList):
        return np.vstack([family.place(k, vertices(member.family)) for k, member in enumerate(family.members)])
    low, high = family.low, family.high
    if len(low) == 0:
        return np.zeros((1, 0))
    if len(low) > 6:
        generator = np.random.default_rng(0)
        some = low + generator.integers(0, 2, (64, len(low))) * (high - low)
        return np.vstack([family.nominal_point, low, high, some])
    every = np.array(list(itertools.product(*zip(low, high, strict=True)))).reshape(-1, len(low))
    return np.vstack([family.nominal_point, every])


def box_grid(family: PlantFamily) -> tuple[Array, Array]:
    """The nominal point and a grid of the whole box, shape (m, p), with the grid's spacing, shape (p,).

    Of a list of plants those of every member, as places in the list; it has no common spacing.
    """
    if isinstance(family, PlantList):
        grids = [family.place(k, box_grid(member.family)[0]) for k, member in enumerate(family.members)]
        return np.vstack(grids), np.zeros(0)
    low, high, p = family.low, family.high, len(family.low)
    if p == 0:
        return np.zeros((1, 0)), np.zeros(0)
    if p > 6:
        return vertices(family), high - low
    count = {1: 9, 2: 5, 3: 3, 4: 3}.get(p, 2)
    grid = np.array(list(itertools.product(*(np.linspace(a, b, count) for a, b in zip(low, high, strict=True)))))
    if count == 2:
        grid = np.vstack([grid, 0.5 * (low + high)])
    return np.vstack([family.nominal_point, grid]), (high - low) / (count - 1)


def frequency_grid(scaled: Scaled, named: Array, per_decade: int, per_decade_beyond: int) -> Array:
    """Frequencies in rad/s: dense around the plants' corners, fine at resonances and where a dead time turns."""
    family, scale, samples = scaled.family, scaled.scale, scaled.samples
    plants = Plants.members(family, vertices(family))
    roots = plants.corner_roots
    low, high = float(scale.omega_grid[0]), float(scale.omega_grid[-1])
    delays = plants.dead_time_s[plants.dead_time_s > 0]
    filters = [1.0 / scale.filter_s] if scale.filter_s else []
    filters += [1.0 / scale.measurement_filter.time_constant_s] if scale.measurement_filter else []
    corners = np.concatenate(
        [np.abs(roots), 1.0 / delays, named[(named > low) & (named < high)], [scale.omega_rad_s], filters]
    )
    if samples is not None:
        # below its band the filter is an integrator
        band = samples.digital.band_rad_s[0]
        low, corners = min(low, 0.1 * band), np.append(corners, band)
    first, last = max(float(corners.min()) / 10.0, low), min(float(corners.max()) * 10.0, high)
    more = np.exp(np.arange(_BEYOND_STEP, DECADES_BEYOND * math.log(10.0), _BEYOND_STEP))
    parts = [
        low / more,
        high * more,
        _logarithmic(first, last, per_decade),
        _logarithmic(low, first, per_decade_beyond),
        _logarithmic(last, high, per_decade_beyond),
        named,
        _resonances(roots),
    ]
    if samples is not None:
        parts += _towards_nyquist(samples, float(plants.dead_time_s.max(initial=0.0)), per_decade)
    elif len(delays):
        step, end = _TURN / float(delays.max()), _LAST_TURN / float(delays.max())
        parts.append(np.arange(step, end, step))
    omega = np.unique(np.concatenate(parts))
    omega = omega[omega > 0]
    if samples is not None:
        omega = omega[samples.log_nu(omega) < _LAST_LOG_NU + 0.1]
        apart = np.concatenate([[True], np.diff(samples.log_nu(omega)) > 1e-9])
    else:
        apart = np.concatenate([[True], np.diff(np.log(omega)) > 1e-9])
    return omega[apart]


def _towards_nyquist(samples: Samples, dead_time_s: float, per_decade: int) -> list[Array]:
    """Frequencies on the way to Nyquist's: as the delay turns, and by decades of tan(omega Ts/2)."""
    time_s, nyquist = samples.digital.sample_time_s, samples.nyquist_rad_s
    late_s = dead_time_s + (1.0 + samples.digital.delay_samples) * time_s
    count = min(math.ceil(nyquist * late_s / _TURN), _MOST_TURNS)
    nu = np.exp(np.concatenate([
        np.linspace(_FIRST_LOG_NU, -_FIRST_LOG_NU, 2 * per_decade),
        np.arange(-_FIRST_LOG_NU, _LAST_LOG_NU, _BEYOND_STEP),
    ]))  # fmt: skip
    return [nyquist * np.arange(1, count) / count, 2.0 / time_s * np.arctan(nu)]


def _logarithmic(low: float, high: float, per_decade: int) -> Array:
    if high <= low:
        return np.array([low])
    return np.geomspace(low, high, int(per_decade * math.log10(high / low)) + 2)


def _resonances(roots: Complex) -> Array:
    light = roots[(np.abs(roots.real) < 0.5 * np.abs(roots.imag)) & (roots.imag > 0)]
    width = np.maximum(np.abs(light.real) / np.abs(light), _NARROWEST)
    return (np.abs(light.imag)[:, None] * (1.0 + width[:, None] * np.array(_AROUND))).ravel()


def table_of(scaled: Scaled, points: Array, omega_rad_s: Array, horizon_s: float) -> Table:
    """The plants at points of the box, shape (m, p), on a grid of frequencies."""
    if isinstance(scaled.family, PlantList):
        return _table_of_list(scaled, scaled.family, points, omega_rad_s, horizon_s)
    samples, omega_s = scaled.samples, scaled.scale.omega_rad_s
    plants = Plants.members(scaled.family, points)
    if samples is not None:
        plants = samples.plants(plants)
    log_gain = math.log(scaled.scale.gain)
    m, n = len(points), len(omega_rad_s)
    u = np.log(omega_rad_s) if samples is None else samples.log_nu(omega_rad_s)
    rows, all_u = np.repeat(np.arange(m), n), np.tile(u, m)
    filtered = _filter_in_table(scaled)
    form = plants.log if filtered is None else plants.log + filtered.log(m)
    bode = form.value(rows, all_u).reshape(m, n)
    if isinstance(plants, SampledPlants):
        direct = plants.at(rows, all_u).reshape(m, n)
    else:
        direct = plants.response(rows, np.tile(omega_rad_s, m)).reshape(m, n)
    direct = direct if filtered is None else direct * filtered(1j * np.exp(u))
    turned = plants.dead_time_s[:, None] * omega_rad_s
    with np.errstate(divide="ignore", invalid="ignore"):
        log: Complex = np.log(direct)
    phase = log.imag - turned
    phase = phase + 2.0 * np.pi * np.round((bode.imag - phase) / (2.0 * np.pi))
    usable = np.isfinite(log)
    gain, phase = np.where(usable, log.real, bode.real) - log_gain, np.where(usable, phase, bode.imag)
    gain = _with_ends(form, gain, log_gain)
    plant_gain = gain if filtered is None else _unfiltered_gain(plants, rows, all_u, log_gain)
    end_phase = np.where(plants.dead_time_s > 0, phase[:, -1], form.end()[1])
    phase = np.column_stack([form.phase0, phase, end_phase])
    v = u - math.log(omega_s if samples is None else samples.half)
    v = np.concatenate([[v[0] - 3.0], v, [v[-1] + 3.0]])
    omega = np.exp(v)
    omega[0], omega[-1] = 0.0, np.inf
    log_omega = v
    if samples is not None:
        omega = np.arctan(samples.half * omega) / samples.half
        log_omega = np.log(np.arctan(samples.half * np.exp(v)) / samples.half)
    delay = plants.dead_time_s * omega_s
    with np.errstate(invalid="ignore"):
        turns = delay[:, None] * np.diff(omega) > _ALIAS
    turns[:, -1] = True
    alias = np.where(delay > 0, np.argmax(turns, axis=1), n + 2).astype(np.int64)
    linear, members = np.exp(gain), scaled.members(points)
    s = scaled.horizon(horizon_s)
    top, bottom = sides_at_real(members, s)
    error_gain = top / bottom
    error_gain *= scaled.delayed_at_real(s, members[:, DELAY])
    late = members[:, DELAY] if samples is not None else np.zeros(m)
    lag, square = scaled.scale.lag_and_square
    filter_gain = -0.5 * np.log((1.0 - square * np.exp(2.0 * v)) ** 2 + (lag * np.exp(v)) ** 2)
    return Table(
        v, omega, gain, phase, linear * np.cos(phase), linear * np.sin(phase), delay,
        plants.unstable_poles.astype(np.int64), form.phase0 - 0.5 * np.pi * form.slope0,
        form.slope0.astype(float), form.slope_end().astype(float), alias, error_gain, members, points.astype(float),
        log_omega, np.ascontiguousarray(late), scaled.sampling, filter_gain, np.ascontiguousarray(plant_gain),
    )  # fmt: skip


def _table_of_list(scaled: Scaled, family: PlantList, places: Array, omega_rad_s: Array, horizon_s: float) -> Table:
    """The tables of the members at places in a list, row by row as these are."""
    parts = [(rows, table_of(scaled.parts[k], own, omega_rad_s, horizon_s)) for k, rows, own in family.parts(places)]
    order = np.argsort(np.concatenate([rows for rows, _ in parts]), kind="stable")
    tables = [table for _, table in parts]
    stacked = {name: np.concatenate([getattr(table, name) for table in tables])[order] for name in OF_PLANTS}
    return tables[0]._replace(**stacked, points=places.astype(float))


def table_of_member(table: Table, family: PlantList, index: int) -> Table:
    """One member's rows of a list's table, with points of that member's box."""
    rows = np.flatnonzero(table.points[:, 0] == index)
    own = {name: getattr(table, name)[rows] for name in OF_PLANTS}
    return table._replace(**own, points=family.point(index, table.points[rows]))


def _unfiltered_gain(plants: Plants, rows: Rows, u: Array, log_gain: float) -> Array:
    """ln|P| of a table's columns, without the measurement filter."""
    form = plants.log
    inside = form.value(rows, u).real.reshape(len(plants), -1) - log_gain
    return _with_ends(form, inside, log_gain)


def _with_ends(form: BodeForm, inside: Array, log_gain: float) -> Array:
    """ln|.|, scaled, with its limits as omega -> 0 and infinity before and behind; shape (m, n + 2)."""
    high_slope = form.slope_end()
    at_end = np.where(np.abs(high_slope) < 1e-9, form.end()[0] - log_gain, np.sign(high_slope) * END)
    at_zero = np.where(form.slope0 == 0, form.scale - log_gain, -np.sign(form.slope0) * END)
    return np.clip(np.column_stack([at_zero, inside, at_end]), -END, END)


def _filter_in_table(scaled: Scaled) -> MeasurementFilter | None:
    """F by u = ln omega, or by ln tan(omega Ts/2)."""
    found, samples = scaled.scale.measurement_filter, scaled.samples
    if found is None or samples is None:
        return found
    return found.slower(2.0 / samples.digital.sample_time_s)

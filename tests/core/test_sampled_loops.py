"""Sampled-data loops in floating point, against state space, eigenvalues, `control` and brute-force scans."""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Callable
from functools import cache
from typing import Any

import control
import numpy as np
import pytest
from cases.plants import brake, spec_of
from cases.project import CONTINUOUS
from oracles import sampled_loops as oracle
from scipy.signal import cont2discrete

import fopi_tune as ft
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.margins import margins_of
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.core.plant import Plant
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import unstable_closed_loop_poles
from fopi_tune.digital.discretize import sections_of
from fopi_tune.digital.oustaloup import oustaloup
from fopi_tune.digital.transforms import tustin
from fopi_tune.proof import verify
from fopi_tune.proof.verification.results import Outcome
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import Relation, Requirement

#: relative; rounding of the exponential and of a solve next to z = 1, both well below it
RESPONSE = 1e-9
REFERENCE = ft.FoPi(0.24027, 0.39344, 0.9)

PLANTS: dict[str, Plant] = {
    "lag": Plant((2.0,), (1.5, 1.0)),
    "integrator": Plant((0.7,), (1.0, 0.0)),
    "unstable pole": Plant((1.0,), (1.0, -0.3)),
    "double integrator": Plant((1.0, 0.2), (1.0, 0.0, 0.0)),
    "undamped pole": Plant((1.0,), (1.0, 0.0, 4.0)),
    "second order": Plant((1.0,), (1.0, 0.8, 2.0)),
    "non-minimum phase": Plant((-0.5, 1.0), (1.0, 2.0, 1.0)),
    "integrator and lag": Plant((1.0,), (1.0, 1.0, 0.0)),
    "biproper": Plant((0.4, 1.0), (1.0, 1.0)),
    "static gain": Plant((0.6,), (1.0,)),
    "faster than the samples": Plant((1.0,), (2e-7, 1.0)),
    "slower than the samples": Plant((1.0,), (2e5, 1.0)),
}


def loops_of(plant: Plant, sections: Sections, delay_samples: float = 0.0) -> SampledLoops:
    implementation = Implementation(sections, delay_samples)
    return SampledLoops.implemented(ft.FoPi(1.0, 1.0, 1.0), implementation, Plants.of(plant))


def frequencies(sample_time_s: float) -> np.ndarray:
    nyquist = math.pi / sample_time_s
    return np.concatenate([np.geomspace(1e-3 * nyquist, nyquist, 60), np.linspace(0.05, 0.999, 40) * nyquist])


def random_sections(rng: np.random.Generator, sample_time_s: float, size: float = 1.0) -> Sections:
    """Any poles inside the circle, an integrator or not."""
    inner = np.sort(rng.uniform(-0.9, 0.999, size=rng.integers(0, 4)))[::-1]
    poles = (1.0, *inner.tolist()) if rng.random() < 0.7 else tuple(inner.tolist())
    residues = size * rng.normal(size=len(poles)) * (1.02 - np.array(poles))
    return Sections(sample_time_s, size * float(rng.normal()), poles, tuple(residues.tolist()))


def zoh(plant: Plant, sample_time_s: float) -> tuple[np.ndarray, np.ndarray]:
    """SciPy's own discretisation, without dead time."""
    system: Any = cont2discrete((plant.numerator, plant.denominator), sample_time_s, method="zoh")
    return np.ravel(system[0]), np.ravel(system[1])


def random_plant(rng: np.random.Generator) -> Plant:
    degree = int(rng.integers(1, 4))
    denominator = np.real(np.poly(-rng.uniform(-0.3, 3.0, size=degree)))
    numerator = rng.normal(size=int(rng.integers(1, degree + 1)))
    return Plant(
        tuple(numerator.tolist()), tuple(denominator.tolist()), float(rng.choice([0.0, rng.uniform(0.0, 0.7)]))
    )


# -- the plant behind the hold ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("delay", [0.0, 0.5, 1.0, 2.3])
def test_the_held_plant_responds_as_its_state_space(name: str, delay: float) -> None:
    plant, ts = PLANTS[name], 0.2
    omega = frequencies(ts)
    loops = loops_of(plant, Sections(ts, 1.0, (), ()), delay)
    found = loops.response(np.zeros(len(omega), dtype=np.intp), omega)
    wanted = oracle.sample(plant, ts, delay).response(omega)
    # a zero at z = -1 itself leaves the oracle's rounding alone
    np.testing.assert_allclose(found, wanted, rtol=RESPONSE, atol=1e-14 * float(np.median(np.abs(wanted))))


@pytest.mark.parametrize("name", [name for name in PLANTS if name not in ("biproper", "static gain")])
def test_the_held_plant_is_that_of_scipy(name: str) -> None:
    """SciPy's sample is taken at the same moment: without a direct path it does not matter on which side."""
    plant, ts = PLANTS[name], 0.2
    omega = frequencies(ts)
    z = np.exp(1j * omega * ts)
    top, bottom = zoh(plant, ts)
    wanted = np.polyval(top, z) / np.polyval(bottom, z)
    loops = loops_of(plant, Sections(ts, 1.0, (), ()), 3.0)
    found = loops.response(np.zeros(len(omega), dtype=np.intp), omega)
    # expanded polynomials in z lose digits next to z = 1: 1e-3 of Nyquist to the second power, times 1e-16
    np.testing.assert_allclose(found, wanted * z**-3.0, rtol=1e-8, atol=1e-14 * float(np.median(np.abs(wanted))))


def test_a_stiff_plant_keeps_its_slow_part() -> None:
    """Poles at 1e6 and 1 rad/s: the fast one has settled, what is left is the slow lag to 1e-6."""
    ts = 0.2
    omega = frequencies(ts)
    rows = np.zeros(len(omega), dtype=np.intp)
    sections = Sections(ts, 1.0, (), ())
    stiff = loops_of(Plant((1e6,), (1.0, 1e6 + 1.0, 1e6)), sections).response(rows, omega)
    lag = loops_of(Plant((1.0,), (1.0, 1.0)), sections).response(rows, omega)
    np.testing.assert_allclose(stiff, lag, rtol=1e-5)


def test_delays_just_beside_a_whole_number_of_samples_agree() -> None:
    omega = frequencies(0.25)
    rows = np.zeros(len(omega), dtype=np.intp)
    values = [
        loops_of(Plant((1.0,), (1.0, 1.0), dead_time), Sections(0.25, 1.0, (), ())).response(rows, omega)
        for dead_time in (0.75 - 1e-9, 0.75, 0.75 + 1e-9)
    ]
    # the response is continuous there: it moves by omega times 1e-9
    np.testing.assert_allclose(values[0], values[1], rtol=1e-7)
    np.testing.assert_allclose(values[2], values[1], rtol=1e-7)


def test_a_delay_of_too_many_samples_is_named() -> None:
    with pytest.raises(ft.DomainError, match="samples long"):
        loops_of(Plant((1.0,), (1.0, 1.0), 1.0), Sections(1e-5, 1.0, (), ()))


# -- closed-loop poles ------------------------------------------------------------------------------------------------


@pytest.mark.thinned(4)
@pytest.mark.parametrize("seed", range(30))
def test_closed_loop_poles_are_counted_as_eigenvalues_are(seed: int) -> None:
    """A hundred plants of one shape a filter: three thousand loops, those within 1e-7 of the circle left out."""
    rng = np.random.default_rng(seed)
    ts, degree = float(10.0 ** rng.uniform(-1.5, 0.3)), int(rng.integers(1, 4))
    sections = random_sections(rng, ts, float(10.0 ** rng.uniform(-1.5, 0.8)))
    delay = float(rng.choice([0.0, 0.5, 1.0, 4.0, rng.uniform(0.0, 3.0)]))
    tops, dead_times = rng.normal(size=(100, degree)), rng.uniform(0.0, 0.7, size=100)
    bottoms = np.array([np.real(np.poly(-rng.uniform(-0.3, 3.0, size=degree))) for _ in range(100)], dtype=np.float64)
    implementation = Implementation(sections, delay)
    loops = SampledLoops.implemented(ft.FoPi(1.0, 1.0, 1.0), implementation, Plants(tops, bottoms, dead_times))
    counts, checked = unstable_closed_loop_poles(loops), 0
    for top, bottom, dead_time, count in zip(tops, bottoms, dead_times, counts, strict=True):
        plant = Plant(tuple(top.tolist()), tuple(bottom.tolist()), float(dead_time))
        sizes = oracle.sizes(oracle.sample(plant, ts, delay), sections)
        if np.all(np.abs(sizes - 1.0) > 1e-7):
            assert count == (sizes > 1.0).sum(), (plant, sections, delay)
            checked += 1
    assert checked > 90


# -- margins ----------------------------------------------------------------------------------------------------------


def stable_loops(seed: int, wanted: int, keep: Callable[[SampledLoops], bool]) -> list[tuple[Plant, Sections, float]]:
    rng = np.random.default_rng(seed)
    found: list[tuple[Plant, Sections, float]] = []
    while len(found) < wanted:
        ts = float(10.0 ** rng.uniform(-1.3, 0.0))
        plant, sections = random_plant(rng), random_sections(rng, ts, 0.7)
        delay = float(rng.choice([0.0, 1.0, rng.uniform(0.0, 2.0)]))
        # a direct path jumps at whole samples; the margins below are found by moving delays and gains
        if oracle.sizes(oracle.sample(plant, ts, delay), sections).max() < 1.0 - 1e-4:
            loops = loops_of(plant, sections, delay)
            if keep(loops):
                found.append((plant, sections, delay))
    return found


def gain_margin(loops: SampledLoops) -> float:
    """The factor that a stable loop's gain may grow by."""
    found = margins_of(loops).gain_margin_db
    assert found is not None
    return 10.0 ** (found / 20.0)


def test_raising_the_gain_by_the_margin_puts_a_pole_on_the_circle() -> None:
    for plant, sections, delay in stable_loops(1, 15, lambda loops: math.isfinite(gain_margin(loops))):
        factor = gain_margin(loops_of(plant, sections, delay))
        sampled = oracle.sample(plant, sections.sample_time_s, delay)
        inside, outside = (
            oracle.sizes(sampled, oracle.scaled(sections, factor * (1.0 + sign * 1e-5))).max() for sign in (-1.0, 1.0)
        )
        assert inside < 1.0 < outside


@pytest.mark.parametrize(
    ("plant", "sections", "at"),
    [
        (Plant((1.0,), (1.0, 1.0)), Sections(0.5, 0.8, (), ()), "nyquist"),
        (Plant((1.0,), (1.0, 1.0)), Sections(0.5, -0.4, (), ()), "zero"),
        (Plant((0.3, 1.0), (1.0, 1.0)), Sections(0.5, 0.5, (1.0,), (0.1,)), "nyquist"),
    ],
)
def test_margins_at_the_ends_of_the_axis_are_found(plant: Plant, sections: Sections, at: str) -> None:
    """L(-1) < 0, and P control with L(1) < 0: there is no crossing inside, only the limit."""
    found = margins_of(loops_of(plant, sections))
    assert found.gain_margin_rad_s == pytest.approx(0.0 if at == "zero" else math.pi / 0.5, rel=1e-12)
    factor = gain_margin(loops_of(plant, sections))
    sampled = oracle.sample(plant, 0.5)
    radii = [oracle.sizes(sampled, oracle.scaled(sections, factor * (1.0 + sign * 1e-9))).max() for sign in (-1.0, 1.0)]
    assert radii[0] < 1.0 < radii[1]


def test_a_continuous_loop_has_its_gain_margin_at_rest() -> None:
    """P control with L(0) = -0.4 puts a pole on s = 0 at 2.5 times the gain."""
    found = margins_of(Loops.of(ft.FoPi(-0.4, 0.0, 0.9), Plants.of(Plant((1.0,), (1.0, 1.0)))))
    assert found.gain_margin_db == pytest.approx(20.0 * math.log10(2.5), rel=1e-12)
    assert found.gain_margin_rad_s == 0.0


def test_margins_are_those_of_the_control_package() -> None:
    rng, compared = np.random.default_rng(4), 0
    while compared < 20:
        ts = 0.3
        plant = Plant(
            (float(rng.uniform(0.5, 2.0)),), (1.0, float(rng.uniform(0.5, 2.0)), float(rng.uniform(0.3, 1.0)))
        )
        sections = Sections(ts, float(rng.uniform(0.1, 0.6)), (1.0,), (float(rng.uniform(0.02, 0.2)),))
        top, bottom = zoh(plant, ts)
        pi = control.TransferFunction([sections.direct, sections.residues[0] - sections.direct], [1.0, -1.0], ts)
        loop = pi * control.TransferFunction(top, bottom, ts)
        margins: Any = control.stability_margins(loop, returnall=True, method="poly")
        gain, phase, _, at_phase, at_gain, _ = (np.atleast_1d(part) for part in margins)
        found = margins_of(loops_of(plant, sections))
        # control finds crossings as roots of expanded polynomials in z of degree 6: seven digits are left
        np.testing.assert_allclose(found.gain_crossovers_rad_s, np.sort(at_gain), rtol=1e-6)
        np.testing.assert_allclose(found.angles_from_minus_one_deg, phase[np.argsort(at_gain)], atol=1e-4)
        closed: Any = control.feedback(loop, 1)
        assert found.stable == bool(np.all(np.abs(closed.poles()) < 1.0))
        if not found.stable:
            assert found.phase_margin_deg is found.delay_margin_s is found.gain_margin_db is None
            continue
        assert found.phase_margin_deg == pytest.approx(float(np.abs(phase).min(initial=math.inf)), abs=1e-4)
        useful = (gain > 1.0) & (at_phase < 0.999 * math.pi / ts)
        if useful.any():
            assert found.gain_margin_db == pytest.approx(20.0 * math.log10(float(gain[useful].min())), abs=1e-5)
            compared += 1


def test_a_delay_margin_of_whole_samples_can_be_added_as_dead_time() -> None:
    """A whole sample more turns L by omega Ts and nothing else; parts of samples alias, and are no such turn."""
    ts, checked = 0.1, 0
    for late in (1, 2, 3, 5, 8):
        for shape in (Plant((1.0,), (1.0, 1.0)), Plant((1.0,), (1.0, 1.5, 0.6))):
            # the gain at which the loop with so many more samples is marginal
            sections = Sections(ts, 1.0, (1.0,), (0.05,))
            factor = gain_margin(loops_of(shape, sections, float(late)))
            found = margins_of(loops_of(shape, oracle.scaled(sections, factor)))
            if len(found.gain_crossovers_rad_s) == 1:
                assert found.delay_margin_s == pytest.approx(late * ts, rel=1e-9)
                checked += 1
    assert checked >= 8


@pytest.mark.parametrize(("gain", "at"), [(0.5, math.pi / 0.5), (-0.5, 0.0)])
def test_a_gain_below_one_on_samples_has_infinite_margins(gain: float, at: float) -> None:
    """gain/z is -1/2 at z = -1 or at z = 1."""
    found = margins_of(loops_of(Plant((1.0,), (1.0,)), Sections(0.5, gain, (), ())))
    assert found.stable
    assert (found.crossover_rad_s, found.phase_margin_deg, found.delay_margin_s) == (None, math.inf, math.inf)
    assert found.gain_margin_db == pytest.approx(20.0 * math.log10(2.0), rel=1e-12)
    assert found.gain_margin_rad_s == pytest.approx(at, rel=1e-12)


def test_a_loop_that_ends_above_unit_gain_on_samples_bears_no_sample_more() -> None:
    """0.5/(z (z + 0.9)) is 5 at z = -1; z^2 + 0.9 z + 0.5 is stable, z^3 + 0.9 z^2 + 0.5 has a root below -1."""
    ts, plant, sections = 0.5, Plant((1.0,), (1.0,)), Sections(0.5, 0.0, (-0.9,), (0.5,))
    found = margins_of(loops_of(plant, sections))
    # |z + 0.9| = 0.5
    turn = math.acos((0.25 - 1.81) / 1.8)
    z = complex(math.cos(turn), math.sin(turn))
    angle = math.degrees(np.angle(-0.5 / (z * (z + 0.9))))
    assert found.stable
    assert found.gain_crossovers_rad_s == pytest.approx((turn / ts,), rel=1e-12)
    assert found.angles_from_minus_one_deg == pytest.approx((angle,), rel=1e-10)
    assert found.phase_margin_deg == pytest.approx(abs(angle), rel=1e-10)
    assert found.delay_margin_s == 0.0
    assert found.delay_margin_rad_s == pytest.approx(math.pi / ts, rel=1e-12)
    assert not margins_of(loops_of(plant, sections, 1.0)).stable


def test_the_phase_slope_is_the_difference_quotient() -> None:
    for plant, sections, delay in stable_loops(2, 10, lambda loops: margins_of(loops).crossover_rad_s is not None):
        found = margins_of(loops_of(plant, sections, delay))
        assert found.crossover_rad_s is not None
        assert found.phase_slope_deg_per_decade is not None
        if found.crossover_rad_s > 0.99 * math.pi / sections.sample_time_s:
            continue
        loop = oracle.Loop.of(plant, Implementation(sections, delay))
        h = 1e-5
        gains = loop.gain(found.crossover_rad_s * np.exp(np.array([h, -h])))
        wanted = float(np.degrees(np.angle(gains[0] / gains[1])) / (2.0 * h) * math.log(10.0))
        # second-order differences: h^2 times the third derivative, and rounding 1e-16/h
        assert found.phase_slope_deg_per_decade == pytest.approx(wanted, rel=1e-5, abs=1e-4)


@cache
def any_stable_loops() -> list[tuple[Plant, Sections, float]]:
    return stable_loops(3, 8, lambda loops: True)


RESPONSES = {
    Response.SENSITIVITY: "sensitivity_db",
    Response.COMPLEMENTARY_SENSITIVITY: "complementary_sensitivity_db",
    Response.CONTROL_SENSITIVITY: "control_sensitivity_db",
    Response.LOOP_GAIN: "loop_gain_db",
}


@pytest.mark.thinned(3)
@pytest.mark.parametrize("response", RESPONSES)
@pytest.mark.parametrize("largest", [True, False])
def test_extremes_are_those_of_a_dense_scan(response: Response, largest: bool) -> None:
    sign = 1.0 if largest else -1.0
    for plant, sections, delay in any_stable_loops():
        nyquist = math.pi / sections.sample_time_s
        loop = oracle.Loop.of(plant, Implementation(sections, delay))
        for low, high in ((0.01 * nyquist, 0.3 * nyquist), (0.1 * nyquist, math.inf), (0.05 * nyquist, 3.0 * nyquist)):
            found = extremes(loops_of(plant, sections, delay), response, low, high, largest)
            scan = loop.extreme(RESPONSES[response], low, high, sign, fine=True)
            # the scan refines its peaks to 1e-10 of omega; values next to z = -1 lose what 1 + z cancels
            assert sign * found.value[0] == pytest.approx(scan, abs=1e-7)
            assert low * (1.0 - 1e-12) <= found.omega_rad_s[0] <= min(high, nyquist) * (1.0 + 1e-12)


# -- the reference ----------------------------------------------------------------------------------------------------


def reference_peak(sample_time_s: float, poles: int, band: tuple[float, float]) -> float:
    sections = tustin(REFERENCE, oustaloup(REFERENCE.alpha, poles, band), sample_time_s)
    points = np.linspace(1.6, 3.1, 16)[:, None]
    loops = SampledLoops.implemented(REFERENCE, Implementation(sections), Plants.members(brake(), points))
    return math.exp(float(extremes(loops, Response.SENSITIVITY, 0.0, math.inf).value.max()))


def test_the_reference_peak_on_samples_is_that_of_a_scan() -> None:
    """1.1637 in continuous time; seven poles from 1e-3 to 1e3 rad/s by Tustin's rule at 0.2 s make it 1.19376."""
    found = reference_peak(0.2, 7, (1e-3, 1e3))
    sections = tustin(REFERENCE, oustaloup(0.9, 7, (1e-3, 1e3)), 0.2)
    scan = oracle.Loop.of(Plant((1.0,), (3.1, 1.0)), Implementation(sections)).extreme(
        "sensitivity_db", 0.0, 10.0, 1.0, True
    )
    assert found == pytest.approx(math.exp(scan), rel=1e-9)
    assert found == pytest.approx(1.193758, abs=1e-6)


def test_faster_samples_approach_the_continuous_peak_to_first_order() -> None:
    """Late by half a sample of hold: the peak's distance halves with Ts.  15 poles leave 1e-5 of the filter's own."""
    points = np.linspace(1.6, 3.1, 16)[:, None]
    loops = Loops.of(REFERENCE, Plants.members(brake(), points))
    ideal = math.exp(float(extremes(loops, Response.SENSITIVITY, 0.0, math.inf).value.max()))
    assert ideal == pytest.approx(1.1637075, abs=1e-6)
    distances = np.array([reference_peak(ts, 15, (1e-4, 1e4)) - ideal for ts in (0.2, 0.1, 0.05, 0.025)])
    assert np.all(distances > 0.0)
    orders = np.log2(distances[:-1] / distances[1:])
    assert np.all(np.abs(orders - 1.0) < 0.06)


# -- bands and Nyquist's frequency ------------------------------------------------------------------------------------


def outcomes(*requirements: Requirement) -> tuple[Outcome, ...]:
    sections = tustin(REFERENCE, oustaloup(0.9, 4, (1e-2, 1e2)), 0.2)
    found = verify(spec_of(brake(), *requirements), REFERENCE, implementation=Implementation(sections))
    assert not any(result.is_met for result in found.requirements if result.outcome is Outcome.BEYOND_NYQUIST)
    return tuple(result.outcome for result in found.requirements)


def test_a_band_above_nyquists_frequency_is_never_met() -> None:
    nyquist = math.pi / 0.2
    starts = [2.0 * nyquist, nyquist, math.nextafter(nyquist, 0.0), nyquist * (1.0 - 1e-14)]
    asked = [Requirement("sensitivity_db", Relation.AT_MOST, (30.0,), from_rad_s=start) for start in starts]
    assert outcomes(*asked) == (Outcome.BEYOND_NYQUIST,) * 4


def test_a_band_that_ends_above_nyquists_frequency_is_cut_there() -> None:
    nyquist = math.pi / 0.2
    ends = [nyquist * (1.0 - 1e-9), nyquist, 1.5 * nyquist, math.inf]
    asked = [Requirement("loop_gain_db", Relation.AT_MOST, (0.0,), from_rad_s=1.0, to_rad_s=end) for end in ends]
    assert outcomes(*asked) == (Outcome.MET,) * 4


def test_a_peak_search_with_very_many_cells_takes_little_memory() -> None:
    """The gain of this filter hardly falls over 70 decades: 285 MB when all cells of a level were evaluated at once."""
    spec = load_spec(CONTINUOUS / "lag_gain_and_delay.yaml")
    gains = ft.FoPi(0.0, -0.2, 0.01)
    assert spec.digital is not None
    implementation = Implementation(sections_of(gains, spec.digital, 1.27e-70), spec.digital.delay_samples)
    points = np.linspace(spec.plant.low, spec.plant.high, 200)
    loops = SampledLoops.implemented(gains, implementation, Plants.members(spec.plant, points))
    tracemalloc.start()
    try:
        found = extremes(loops, Response.COMPLEMENTARY_SENSITIVITY, 0.0, np.inf)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # the integrator makes |T| -> 1, and no gain of the loop is beyond that
    np.testing.assert_allclose(found.value, 0.0, atol=1e-9)
    assert peak < 60e6

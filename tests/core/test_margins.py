"""Crossovers and margins against `control.stability_margins`, brute-force scans, closed forms and published numbers."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.crossings import Crossings, gain_crossovers, phase_crossovers
from fopi_tune.core.margins import margins
from fopi_tune.core.plant import Plant
from fopi_tune.errors import DomainError

LAG = Plant((1.0,), (1.0, 1.0))


def loops_of(controller: FoPi, plant: Plant) -> Loops:
    return Loops.of(controller, Plants.of(plant))


def response(controller: FoPi, plant: Plant, omega: np.ndarray) -> np.ndarray:
    """L(j omega) written down anew, for the scans."""
    s = 1j * omega
    c = controller.kp + controller.ki * s**-controller.alpha
    return c * np.polyval(plant.numerator, s) / np.polyval(plant.denominator, s) * np.exp(-s * plant.dead_time_s)


def random_plant(rng: np.random.Generator, delayed: bool, least_damping: float = 0.01) -> Plant:
    def roots(number: int, right: float) -> list[complex]:
        found: list[complex] = []
        while len(found) < number:
            side, size = (1.0 if rng.random() < right else -1.0), 10.0 ** rng.uniform(-1, 1)
            if number - len(found) >= 2 and rng.random() < 0.6:
                zeta = 10.0 ** rng.uniform(math.log10(least_damping), 0)
                root = size * (side * zeta + 1j * math.sqrt(1.0 - zeta**2))
                found += [root, root.conjugate()]
            else:
                found.append(0.0 if right == 0.15 and rng.random() < 0.2 else side * size)
        return found

    order = int(rng.integers(1, 6))
    zeros, poles = roots(int(rng.integers(0, order)), 0.2), roots(order, 0.15)
    # A gain that brings |P| near 1 in the middle of the dynamics, where crossovers are many.
    gain = rng.choice([-1, 1], p=[0.2, 0.8]) * 10.0 ** rng.uniform(-1, 1)
    numerator, denominator = np.atleast_1d(np.real(np.poly(zeros))), np.real(np.poly(poles))
    numerator *= gain / abs(np.polyval(numerator, 1j) / np.polyval(denominator, 1j))
    delay = 10.0 ** rng.uniform(-2, 0.5) if delayed else 0.0
    return Plant(tuple(numerator.tolist()), tuple(denominator.tolist()), delay)


def random_controller(rng: np.random.Generator, alpha: float) -> FoPi:
    kp, ki = (rng.choice([0.0, 1.0, -1.0], p=[0.1, 0.75, 0.15]) * 10.0 ** rng.uniform(-1, 1) for _ in range(2))
    return FoPi(kp if kp or ki else 1.0, ki, alpha)


# --- published and closed-form numbers -----------------------------------------------------------------------------


def test_the_published_throttle_gains_have_the_recomputed_margins() -> None:
    found = margins(FoPi(0.09, 0.025, 0.8), Plant((4.39,), (1.0, 0.1746)))
    # PAPER.md section 7 prints four digits.
    assert found.crossover_rad_s == pytest.approx(0.4649, abs=5e-5)
    assert found.phase_margin_deg == pytest.approx(87.76, abs=5e-3)
    assert found.gain_margin_db == math.inf


@pytest.mark.parametrize(("gain", "crossover", "margin"), [(1.0, 0.00838, 141.0), (10.0, 0.7052, 95.75)])
def test_the_published_brake_gains_have_the_recomputed_margins(gain: float, crossover: float, margin: float) -> None:
    found = margins(FoPi(0.07, 0.11, 0.45), Plant((gain,), (2.25, 1.0)))
    assert found.crossover_rad_s == pytest.approx(crossover, rel=1e-3)
    assert found.phase_margin_deg == pytest.approx(margin, abs=0.06)


def test_the_brake_meets_the_claimed_point_with_another_gain_and_lag() -> None:
    found = margins(FoPi(0.07, 0.11, 0.45), Plant((10.80,), (2.525, 1.0)))
    # The gain and the lag are printed to four digits; so is what follows.
    assert found.crossover_rad_s == pytest.approx(0.7, rel=1e-3)
    assert found.phase_margin_deg == pytest.approx(93.0, abs=0.05)


def test_the_unit_gain_brake_meets_the_specification_with_the_recomputed_gains() -> None:
    found = margins(FoPi(0.3501, 0.4013, 0.8), Plant((1.0,), (2.25, 1.0)))
    assert found.crossover_rad_s == pytest.approx(0.3, rel=3e-4)
    assert found.phase_margin_deg == pytest.approx(90.0, abs=0.02)


@pytest.mark.parametrize(
    ("tau", "crossover", "margin"), [(1.6, 0.4855, 106.5), (2.35, 0.4, 100.0), (3.1, 0.3444, 95.6)]
)
def test_the_reference_brake_design_has_its_margins_over_the_lag(tau: float, crossover: float, margin: float) -> None:
    found = margins(FoPi(0.3976732, 0.6527344, 0.55), Plant((1.0,), (tau, 1.0)))
    assert found.crossover_rad_s == pytest.approx(crossover, abs=6e-5)
    assert found.phase_margin_deg == pytest.approx(margin, abs=0.06)


def test_the_reference_throttle_design_has_its_margins() -> None:
    found = margins(FoPi(0.0918608, 0.0224688, 0.8), Plant((4.39,), (1.0, 0.1746)))
    # Seven digits are printed.
    assert found.crossover_rad_s == pytest.approx(0.46, rel=2e-6)
    assert found.phase_margin_deg == pytest.approx(90.0, abs=2e-4)


def test_the_four_lag_loop_has_its_open_loop_value() -> None:
    loops = loops_of(FoPi(0.82274734724854, -0.45472580052281, 1.0), Plant((1.0,), (1.0, 4.0, 6.0, 4.0, 1.0)))
    value = loops.response(np.array([0]), np.array([0.8]))[0]
    assert abs(value) == pytest.approx(0.37180, abs=5e-6)
    assert math.degrees(np.angle(value)) == pytest.approx(-120.0, abs=5e-4)


def test_a_closed_form_design_gives_back_its_crossover_and_phase_margin() -> None:
    # PAPER.md sec. 3: X = e^{j(pm - pi)}/G(j wc), ki = -Im X wc^alpha / sin(alpha pi/2), kp = Re X - ki wc^-alpha cos
    rng = np.random.default_rng(11)
    for _ in range(50):
        alpha, omega, pm = rng.uniform(0.2, 1.8), 10.0 ** rng.uniform(-3, 3), math.radians(rng.uniform(10, 120))
        tau, delay = 10.0 ** rng.uniform(-1, 1) / omega, rng.uniform(0, 1) / omega
        x = np.exp(1j * (pm - math.pi)) * (1j * omega * tau + 1.0) * np.exp(1j * omega * delay)
        ki = -x.imag * omega**alpha / math.sin(0.5 * math.pi * alpha)
        kp = x.real - ki * omega**-alpha * math.cos(0.5 * math.pi * alpha)
        crossings = gain_crossovers(loops_of(FoPi(kp, ki, alpha), Plant((1.0,), (tau, 1.0), delay)))
        near = np.argmin(np.abs(crossings.omega_rad_s / omega - 1.0))
        # kp and ki carry rounding errors that a small sin(alpha pi/2) or slope enlarges.
        assert crossings.omega_rad_s[near] == pytest.approx(omega, rel=1e-9)
        off = math.radians(crossings.phase_margin_deg[near]) - pm
        assert math.remainder(off, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_the_gain_margin_is_infinite_for_a_lag_without_dead_time() -> None:
    for alpha in (0.1, 0.45, 0.8, 1.0):
        found = margins(FoPi(0.5, 0.6, alpha), LAG)
        assert found.gain_margin_db == math.inf
        assert found.gain_margin_rad_s is None
        assert found.gain_reduction_margin_db == -math.inf


def test_an_integrator_with_dead_time_has_its_textbook_margins() -> None:
    k, delay = 0.7, 1.3
    found = margins(FoPi(k, 0.0, 1.0), Plant((1.0,), (1.0, 0.0), delay))
    assert found.gain_margin_db == pytest.approx(20 * math.log10(0.5 * math.pi / (k * delay)), rel=1e-12)
    assert found.gain_margin_rad_s == pytest.approx(0.5 * math.pi / delay, rel=1e-12)
    assert found.phase_margin_deg == pytest.approx(90.0 - math.degrees(k * delay), rel=1e-12)
    assert found.delay_margin_s == pytest.approx(0.5 * math.pi / k - delay, rel=1e-12)


def test_three_equal_lags_have_their_textbook_gain_margin_and_phase_slope() -> None:
    found = margins(FoPi(4.0, 0.0, 1.0), Plant((1.0,), (1.0, 3.0, 3.0, 1.0)))
    assert found.gain_margin_db == pytest.approx(20 * math.log10(2.0), rel=1e-12)
    assert found.gain_margin_rad_s == pytest.approx(math.sqrt(3.0), rel=1e-12)
    omega = math.sqrt(4.0 ** (2.0 / 3.0) - 1.0)
    slope = -3.0 * omega / (1.0 + omega**2)
    assert found.phase_slope_deg_per_decade == pytest.approx(math.degrees(slope) * math.log(10.0), rel=1e-9)


def test_the_unwrapped_phase_of_an_unstable_plant_starts_at_minus_180_deg() -> None:
    found = margins(FoPi(2.0, 0.0, 1.0), Plant((1.0,), (1.0, -1.0)))
    # L(j sqrt 3) = 2/(j sqrt 3 - 1): -180 + 60 deg.
    assert found.crossover_rad_s == pytest.approx(math.sqrt(3.0), rel=1e-12)
    assert found.phase_margin_deg == pytest.approx(60.0, abs=1e-10)


def test_two_unstable_poles_start_at_minus_360_deg() -> None:
    found = margins(FoPi(4.0, 0.0, 1.0), Plant((1.0, 1.0), (1.0, -2.0, 1.0)))
    omega = found.crossover_rad_s
    assert omega is not None
    assert found.phase_margin_deg is not None
    expected = 180.0 - 360.0 + math.degrees(3.0 * math.atan(omega))
    assert found.phase_margin_deg == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("controller", [FoPi(-2.0, -0.1, 0.8), FoPi(-2.0, 0.0, 0.8), FoPi(0.0, -0.3, 1.5)])
def test_two_negative_signs_are_none(controller: FoPi) -> None:
    plus = FoPi(-controller.kp, -controller.ki, controller.alpha)
    for denominator in ((1.0, 1.0), (1.0, 2.0, -3.0), (1.0, 1.0, 0.0)):
        assert margins(controller, Plant((-1.0,), denominator, 0.1)) == margins(plus, Plant((1.0,), denominator, 0.1))


def test_a_loop_without_crossover_says_none() -> None:
    found = margins(FoPi(0.5, 0.0, 1.0), LAG)
    assert found.crossover_rad_s is None
    assert found.phase_margin_deg is None
    assert found.delay_margin_s is None
    assert found.phase_slope_deg_per_decade is None
    assert found.gain_crossovers_rad_s == ()


def test_no_controller_is_an_error() -> None:
    with pytest.raises(DomainError, match="kp = ki = 0"):
        margins(FoPi(0.0, 0.0, 1.0), LAG)


def test_a_loop_exactly_on_the_critical_point_has_margins_of_zero() -> None:
    found = margins(FoPi(8.0, 0.0, 1.0), Plant((1.0,), (1.0, 3.0, 3.0, 1.0)))
    assert found.phase_margin_deg == pytest.approx(0.0, abs=1e-9)
    assert min(found.gain_margin_db, -found.gain_reduction_margin_db) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("kp", [1.0, -1.0, 1.0 - 1e-10])
def test_a_static_gain_of_one_is_approached_but_not_crossed(kp: float) -> None:
    assert margins(FoPi(kp, 0.0, 1.0), LAG).gain_crossovers_rad_s == ()


@pytest.mark.parametrize("kp", [1.0, 2.0, 0.5])
def test_a_loop_of_a_constant_has_no_crossings(kp: float) -> None:
    found = margins(FoPi(kp, 0.0, 1.0), Plant((1.0,), (1.0,)))
    assert found.gain_crossovers_rad_s == ()
    assert found.gain_margin_db == math.inf


def test_a_phase_that_lies_on_minus_180_deg_does_not_cross_it() -> None:
    found = margins(FoPi(1.0, 0.0, 1.0), Plant((1.0,), (1.0, 0.0, 0.0)))
    assert found.phase_margin_deg == pytest.approx(0.0, abs=1e-12)
    assert found.gain_margin_db == math.inf


# --- a second opinion ----------------------------------------------------------------------------------------------


def test_every_crossover_of_an_ordinary_pi_agrees_with_control() -> None:
    import control

    rng = np.random.default_rng(21)
    compared = 0
    for _ in range(80):
        plant, controller = random_plant(rng, delayed=False, least_damping=0.003), random_controller(rng, 1.0)
        with warnings.catch_warnings():
            # control's own polynomial arithmetic may complain; its answer is compared nevertheless
            warnings.simplefilter("ignore")
            integral = controller.ki != 0.0
            above = np.polymul(plant.numerator, [controller.kp, controller.ki] if integral else [controller.kp])
            loop = control.TransferFunction(above, np.polymul(plant.denominator, [1.0, 0.0] if integral else [1.0]))
            gm, pm, _, wpc, wgc, _ = control.stability_margins(loop, returnall=True)
        loops = loops_of(controller, plant)
        gain, phase = gain_crossovers(loops), phase_crossovers(loops)
        order = np.argsort(wgc)
        # control squares the polynomials: its roots are good to half the digits
        np.testing.assert_allclose(gain.omega_rad_s, np.asarray(wgc)[order], rtol=1e-5)
        turn = np.mod(gain.phase_margin_deg - np.asarray(pm)[order] + 180.0, 360.0) - 180.0
        np.testing.assert_allclose(turn, 0.0, atol=1e-2)
        # control also lists a pole at omega = 0, where the gain is infinite
        finite = np.asarray(gm) > 1e-9
        order = np.argsort(np.asarray(wpc)[finite])
        np.testing.assert_allclose(phase.omega_rad_s, np.asarray(wpc)[finite][order], rtol=1e-5)
        np.testing.assert_allclose(1.0 / phase.gain, np.asarray(gm)[finite][order], rtol=1e-3)
        compared += len(wgc) + int(finite.sum())
    assert compared > 100


# --- brute force ---------------------------------------------------------------------------------------------------


def crossings_of_grid(u: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Sign changes of f on a grid, by linear interpolation."""
    at = np.flatnonzero((f[1:] >= 0) != (f[:-1] >= 0))
    return u[at] - f[at] * (u[at + 1] - u[at]) / (f[at + 1] - f[at])


def start_phase(controller: FoPi, plant: Plant, first: complex) -> float:
    """The documented phase as omega -> 0: the principal value `first`, moved by the turns the convention names."""
    numerator, denominator = np.trim_zeros(plant.numerator, "b"), np.trim_zeros(plant.denominator, "b")
    origin = (len(plant.numerator) - len(numerator)) - (len(plant.denominator) - len(denominator))
    right = int(np.sum(np.roots(denominator).real > 0))
    sign = numerator[-1] / denominator[-1] * (-1) ** right
    lead = controller.ki if controller.ki else controller.kp
    expected = 0.5 * math.pi * origin - math.pi * right - math.pi * ((sign < 0) != (lead < 0))
    if controller.ki:
        expected -= 0.5 * math.pi * controller.alpha
    phase = float(np.angle(first))
    return phase + 2.0 * math.pi * round((expected - phase) / (2.0 * math.pi))


def assert_a_scan_finds_no_more(controller: FoPi, plant: Plant, points: int, decades: float = 4.0) -> tuple[int, int]:
    """All crossings within 10^+-decades agree with those of a dense grid: number, place and unwrapped phase."""
    u = np.linspace(-decades, decades, points) * math.log(10.0)
    value = response(controller, plant, np.exp(u))
    log_gain, phase = np.log(np.abs(value)), np.unwrap(np.angle(value))
    # The grid starts where the loop is not yet its low-frequency asymptote; a coarse run leads there from 1e-65 rad/s.
    before = np.linspace(-150.0, u[0], 100_000)
    lead_in = np.unwrap(np.angle(response(controller, Plant(plant.numerator, plant.denominator), np.exp(before))))
    offset = start_phase(controller, plant, np.exp(1j * lead_in[0])) - lead_in[0]
    begin = lead_in[-1] + offset - plant.dead_time_s * np.exp(u[0])
    phase = phase + 2.0 * math.pi * np.round((begin - phase[0]) / (2.0 * math.pi))
    loops = loops_of(controller, plant)
    gain = inside(gain_crossovers(loops), u)
    expected = crossings_of_grid(u, log_gain)
    step = u[1] - u[0]
    assert len(gain) == len(expected), (controller, plant)
    # Linear interpolation errs by less than a grid step; the polished value is held against L itself.
    np.testing.assert_allclose(np.log(gain.omega_rad_s), expected, atol=step)
    np.testing.assert_allclose(np.abs(response(controller, plant, gain.omega_rad_s)), 1.0, rtol=1e-9)
    np.testing.assert_allclose(gain.phase_rad, np.interp(expected, u, phase), atol=0.05)
    every = phase_crossovers(loops)
    last = math.log(every.omega_rad_s[-1]) if plant.dead_time_s and len(every.row) else np.inf
    found = inside(every, u)
    x = (phase + math.pi) / (2.0 * math.pi)
    levels = np.arange(math.floor(x.min()), math.ceil(x.max()) + 1)
    lines = np.sort(np.concatenate([crossings_of_grid(u, x - level) for level in levels]))
    np.testing.assert_allclose(np.log(found.omega_rad_s), lines[lines <= last + step][: len(found)], atol=step)
    assert len(found) == len(lines[lines <= last + step])
    # Those left out (dead time only) have a smaller gain than one that is listed.
    beyond = np.exp(np.interp(lines[lines > last + step], u, log_gain))
    if len(beyond):
        assert np.all(beyond <= found.gain[found.gain < 1.0].max() * (1.0 + 1e-6))
    return len(gain), len(found)


class Inside(Crossings):
    """Crossings inside a grid."""

    def __len__(self) -> int:
        return len(self.row)


def inside(crossings: Crossings, u: np.ndarray) -> Inside:
    with np.errstate(divide="ignore"):
        at = np.log(crossings.omega_rad_s)
    keep = (at > u[0]) & (at < u[-1])
    return Inside(*(getattr(crossings, name)[keep] for name in Crossings.__dataclass_fields__))


def test_a_dense_scan_finds_no_crossing_that_was_missed() -> None:
    rng = np.random.default_rng(31)
    totals = np.zeros(2, dtype=int)
    for _ in range(25):
        controller = random_controller(rng, float(rng.uniform(0.1, 1.95)))
        totals += assert_a_scan_finds_no_more(controller, random_plant(rng, delayed=False), 200_000)
    assert totals.min() > 10


def test_a_dense_scan_finds_no_crossing_that_was_missed_with_dead_time() -> None:
    rng = np.random.default_rng(32)
    totals = np.zeros(2, dtype=int)
    for _ in range(25):
        controller = random_controller(rng, float(rng.uniform(0.1, 1.95)))
        # Two decades above the dynamics, so that the grid still resolves the turning of the dead time.
        totals += assert_a_scan_finds_no_more(controller, random_plant(rng, delayed=True), 200_000, decades=2.0)
    assert totals.min() > 10


@pytest.mark.long
@pytest.mark.parametrize("seed", range(8))
def test_many_dense_scans_find_no_crossing_that_was_missed(seed: int) -> None:
    rng = np.random.default_rng(1000 + seed)
    for _ in range(150):
        controller = random_controller(rng, float(rng.uniform(0.05, 1.99)))
        delayed = bool(rng.random() < 0.5)
        plant = random_plant(rng, delayed, least_damping=0.001)
        assert_a_scan_finds_no_more(controller, plant, 800_000, decades=2.0 if delayed else 4.0)


def test_two_sharp_resonances_give_five_gain_crossovers() -> None:
    zeta = 0.001
    denominator = np.polymul([1.0, 2 * zeta, 1.0], [1.0, 2 * zeta * 3.0, 9.0])
    numerator = 9.0 * np.array([0.3, 0.002, 1.0])
    plant = Plant(tuple((0.05 * numerator).tolist()), tuple(denominator.tolist()))
    gain_count, _ = assert_a_scan_finds_no_more(FoPi(0.3, 0.2, 0.7), plant, 1_000_000)
    assert gain_count == 5


@pytest.mark.parametrize("excess", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
def test_a_peak_a_hair_above_one_gives_its_close_pair_of_crossovers(excess: float) -> None:
    # |1/((jw)^2 + 2 zeta jw + 1)|^2 k^2 = 1: w^2 = 1 - 2 zeta^2 -+ sqrt(k^2 - 4 zeta^2 (1 - zeta^2))
    zeta = 0.05
    k = 2.0 * zeta * math.sqrt(1.0 - zeta**2) * (1.0 + excess)
    found = margins(FoPi(k, 0.0, 1.0), Plant((1.0,), (1.0, 2.0 * zeta, 1.0))).gain_crossovers_rad_s
    root = math.sqrt(k**2 - (2.0 * zeta) ** 2 * (1.0 - zeta**2))
    expected = [math.sqrt(1.0 - 2.0 * zeta**2 - root), math.sqrt(1.0 - 2.0 * zeta**2 + root)]
    assert len(found) == 2
    # Rounding of |L| (1e-15) moves a root by 1e-15 over the slope, which vanishes with the pair's distance.
    assert found == pytest.approx(expected, rel=1e-14 / root)
    below = k / (1.0 + excess) * (1.0 - excess)
    assert margins(FoPi(below, 0.0, 1.0), Plant((1.0,), (1.0, 2.0 * zeta, 1.0))).gain_crossovers_rad_s == ()


def test_a_close_pair_of_phase_crossovers_is_found() -> None:
    # C with a lag lifts the phase of 1/(s^2 (..)) just above -180 deg between two frequencies:
    # L = (s + a)(..)/(s^2 (s + 1)): phase + 180 = atan(w/a) - atan(w) - w L; it is 0 twice for small L and a < 1.
    a = 0.5
    for delay in (0.3, 0.339, 0.3399, 0.33998):
        controller = FoPi(1.0, a, 1.0)
        plant = Plant((1.0,), (1.0, 1.0, 0.0), delay)
        u = np.linspace(-3.0, 1.0, 2_000_001) * math.log(10.0)
        omega = np.exp(u)
        f = np.arctan(omega / a) - np.arctan(omega) - delay * omega
        expected = np.exp(crossings_of_grid(u, f))
        found = phase_crossovers(loops_of(controller, plant))
        near = found.omega_rad_s[(found.omega_rad_s > 1e-3) & (found.omega_rad_s < 10.0)]
        np.testing.assert_allclose(near[: len(expected)], expected, rtol=1e-4)


def test_crossings_come_sorted_without_duplicates_and_polished() -> None:
    rng = np.random.default_rng(41)
    for delayed in (False, True):
        for _ in range(40):
            controller, plant = random_controller(rng, float(rng.uniform(0.1, 1.9))), random_plant(rng, delayed)
            loops = loops_of(controller, plant)
            gain, phase = gain_crossovers(loops), phase_crossovers(loops)
            for crossings in (gain, phase):
                assert np.all(np.diff(crossings.omega_rad_s) > 1e-9 * crossings.omega_rad_s[1:])
            np.testing.assert_allclose(np.log(gain.gain), 0.0, atol=1e-10)
            off = np.mod(phase.phase_rad, 2.0 * math.pi) - math.pi
            # The phase itself is hundreds of radians at times; its rounding is 1e-14 of that.
            np.testing.assert_allclose(off, 0.0, atol=1e-10)


# --- dead time -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [1.0, 100.0, 1e4, 1e6])
def test_a_dead_time_long_against_the_lag_still_has_its_first_crossing(delay: float) -> None:
    found = margins(FoPi(0.1, 0.5 / delay, 1.0), Plant((1.0,), (1.0, 1.0), delay))
    omega = found.gain_margin_rad_s
    assert omega is not None
    c = 0.1 + 0.5 / delay / (1j * omega)
    assert np.angle(c) - math.atan(omega) - omega * delay == pytest.approx(-math.pi, abs=1e-9)
    assert found.gain_margin_db == pytest.approx(-20 * math.log10(abs(c) / math.hypot(1.0, omega)), rel=1e-9)


@pytest.mark.parametrize("delay", [0.01, 1.0, 100.0, 1e5])
def test_a_dead_time_far_slower_than_the_crossover_loses_no_low_phase_crossing(delay: float) -> None:
    # k/s: crossings at w L = pi/2 + 2 pi i, all those with |L| > 1 are needed for the reduction margin.
    found = phase_crossovers(loops_of(FoPi(10.0 / delay, 0.0, 1.0), Plant((1.0,), (1.0, 0.0), delay)))
    expected = (0.5 + 2.0 * np.arange(len(found.row))) * math.pi / delay
    assert len(found.row) >= 3
    np.testing.assert_allclose(found.omega_rad_s, expected, rtol=1e-12)


def test_a_static_plant_with_dead_time_lists_its_first_crossings_and_its_limit() -> None:
    loops = loops_of(FoPi(0.5, 0.0, 1.0), Plant((1.0,), (1.0,), 100.0))
    found = phase_crossovers(loops)
    assert found.omega_rad_s[0] == pytest.approx(math.pi / 100.0, rel=1e-12)
    assert found.omega_rad_s[-1] == math.inf
    np.testing.assert_allclose(found.gain, 0.5, rtol=1e-12)
    assert margins(FoPi(0.5, 0.0, 1.0), Plant((1.0,), (1.0,), 100.0)).gain_margin_db == pytest.approx(6.0206, abs=1e-4)


def test_a_gain_that_rises_to_its_limit_around_a_dead_time_has_the_margin_of_the_limit() -> None:
    # |(s + 1)/(s + 2)| rises from 1/2 to 1: no finite crossing is the worst.
    found = margins(FoPi(0.5, 0.0, 1.0), Plant((1.0, 1.0), (1.0, 2.0), 0.5))
    assert found.gain_margin_db == pytest.approx(20.0 * math.log10(2.0), rel=1e-12)
    assert found.gain_margin_rad_s == math.inf


def test_a_gain_that_falls_to_its_limit_around_a_dead_time_has_a_finite_worst_crossing() -> None:
    found = margins(FoPi(0.5, 0.0, 1.0), Plant((1.0, 2.0), (1.0, 4.0 / 3.0), 0.5))
    assert found.gain_margin_rad_s is not None
    assert math.isfinite(found.gain_margin_rad_s)


def test_fifty_thousand_turns_below_the_crossover_are_listed() -> None:
    loops = loops_of(FoPi(30.0, 1e-3, 0.5), Plant((1.0,), (1.0, 1.0), 1e4))
    found, last = phase_crossovers(loops), gain_crossovers(loops).phase_rad[-1]
    assert np.sum(found.gain > 1.0) == math.floor((-last + math.pi) / (2.0 * math.pi))


def test_millions_of_turns_are_refused_with_a_reason() -> None:
    with pytest.raises(DomainError, match="dead time"):
        margins(FoPi(30.0, 1e-3, 0.5), Plant((1.0,), (1.0, 1.0), 1e7))


# --- invariances and extremes --------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.integers(0, 100_000), st.floats(-9.0, 9.0), st.floats(-6.0, 6.0))
def test_the_unit_of_time_scales_every_crossover_and_the_unit_of_gain_none(
    seed: int, log_time: float, log_gain: float
) -> None:
    rng = np.random.default_rng(seed)
    controller = random_controller(rng, float(rng.uniform(0.2, 1.9)))
    plant = random_plant(rng, delayed=bool(rng.random() < 0.5))
    time, gain = 10.0**log_time, 10.0**log_gain
    n, m = len(plant.denominator) - 1, len(plant.numerator) - 1
    scaled = Plant(
        tuple((np.array(plant.numerator) * gain * time ** np.arange(m, -1.0, -1.0)).tolist()),
        tuple((np.array(plant.denominator) * time ** np.arange(n, -1.0, -1.0)).tolist()),
        plant.dead_time_s * time,
    )
    other = FoPi(controller.kp / gain, controller.ki / gain / time**controller.alpha, controller.alpha)
    for search in (gain_crossovers, phase_crossovers):
        first, second = search(loops_of(controller, plant)), search(loops_of(other, scaled))
        # Rounding of the scaled coefficients over the smallest slopes that were drawn.
        np.testing.assert_allclose(second.omega_rad_s * time, first.omega_rad_s, rtol=1e-8)
        np.testing.assert_allclose(second.phase_rad, first.phase_rad, rtol=1e-8)


@pytest.mark.parametrize("alpha", [0.01, 0.1, 1.9, 1.999])
def test_extreme_orders_have_their_closed_form_crossover(alpha: float) -> None:
    # |ki (jw)^-alpha/(jw)| = 1: w = ki^(1/(1 + alpha)), PM = 90 - 90 alpha.
    found = margins(FoPi(0.0, 3.0, alpha), Plant((1.0,), (1.0, 0.0)))
    assert found.crossover_rad_s == pytest.approx(3.0 ** (1.0 / (1.0 + alpha)), rel=1e-12)
    assert found.phase_margin_deg == pytest.approx(90.0 - 90.0 * alpha, abs=1e-9)


@pytest.mark.parametrize(
    ("controller", "plant"),
    [
        (FoPi(1.0, 0.2, 0.5), Plant((1.0,), tuple(np.poly([-1.0] * 8)))),
        (FoPi(1.0, 0.2, 1.5), Plant((1.0,), tuple(np.poly([-1.0] * 8)), 0.3)),
        (FoPi(2.0, 0.2, 0.5), Plant((1.0,), tuple(np.poly([-1.0] * 12)))),
    ],
)
def test_a_multiple_pole_costs_no_accuracy(controller: FoPi, plant: Plant) -> None:
    order = len(plant.denominator) - 1
    loops = loops_of(controller, plant)
    for crossings in (gain_crossovers(loops), phase_crossovers(loops)):
        s = 1j * crossings.omega_rad_s
        c = controller.kp + controller.ki * s**-controller.alpha
        # Evaluated as (s + 1)^-n, not from the expanded coefficients, which lose about n bits.
        gain = np.abs(c) * np.abs(1.0 + s) ** -order
        phase = np.angle(c) - order * np.angle(1.0 + s) - crossings.omega_rad_s * plant.dead_time_s
        np.testing.assert_allclose(crossings.gain, gain, rtol=1e-11)
        np.testing.assert_allclose(crossings.phase_rad, phase, atol=1e-10)
        assert len(crossings.row) > 0


def test_coefficients_over_many_decades_keep_the_crossover() -> None:
    # (1e12)/((1e-12 s + 1)(s + 1e12)) with kp = 2: w where |1 + jw 1e-12| = sqrt 2 each ... |L| = 2/(1 + (w 1e-12)^2)
    found = margins(FoPi(2.0, 0.0, 1.0), Plant((1e12,), (1e-12, 2.0, 1e12)))
    assert found.crossover_rad_s == pytest.approx(1e12, rel=1e-9)
    assert found.phase_margin_deg == pytest.approx(90.0, abs=1e-7)


def test_an_undamped_plant_has_finite_crossovers_and_no_warning() -> None:
    controller, plant = FoPi(0.1, 0.05, 0.5), Plant((1.0,), (1.0, 0.0, 1.0))
    omega = np.array(margins(controller, plant).gain_crossovers_rad_s)
    assert len(omega) == 3
    np.testing.assert_allclose(np.abs(response(controller, plant, omega)), 1.0, rtol=1e-10)


def test_a_batch_gives_each_loop_what_it_gets_alone() -> None:
    rng = np.random.default_rng(51)
    tau, delay = rng.uniform(0.5, 5.0, 40), rng.choice([0.0, 0.3, 2.0], 40)
    plants = Plants(np.ones((40, 1)), np.stack([tau, np.ones(40)], axis=1), delay)
    loops = Loops(rng.uniform(0.1, 3.0, 40), rng.uniform(0.1, 3.0, 40), rng.uniform(0.3, 1.5, 40), plants)
    for search in (gain_crossovers, phase_crossovers):
        together = search(loops)
        assert np.all(np.diff(together.row) >= 0)
        for row in range(40):
            alone = search(loops.take(np.array([row])))
            np.testing.assert_allclose(together.omega_rad_s[together.row == row], alone.omega_rad_s, rtol=1e-12)


def test_gain_crossovers_of_another_level_meet_that_level() -> None:
    loops = loops_of(FoPi(0.5, 0.6, 0.55), Plant((1.0,), (2.35, 1.0)))
    for level in (-20.0, -1.0, 0.5, 10.0):
        found = gain_crossovers(loops, np.array([level]))
        np.testing.assert_allclose(np.log(found.gain), level, atol=1e-10)
        assert len(found.row) == 1

"""Crossovers of continuous loops against `control.stability_margins`, brute-force scans and closed forms."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fopi_tune.core.bode_form import Complex
from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import Crossings, gain_crossovers, phase_crossovers
from fopi_tune.core.loops import Loops, Plants
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


# --- the phase, and angles from -1 -----------------------------------------------------------------------------------


def test_the_unwrapped_phase_of_an_unstable_plant_starts_at_minus_180_deg() -> None:
    # L(j sqrt 3) = 2/(j sqrt 3 - 1): -180 + 60 deg.
    found = gain_crossovers(loops_of(FoPi(2.0, 0.0, 1.0), Plant((1.0,), (1.0, -1.0))))
    np.testing.assert_allclose(found.omega_rad_s, [math.sqrt(3.0)], rtol=1e-12)
    np.testing.assert_allclose(np.degrees(found.phase_rad), [-120.0], rtol=1e-12)


def test_two_unstable_poles_start_at_minus_360_deg() -> None:
    # 4 (s + 1)/(s - 1)^2: |L| = 1 at sqrt 15
    found = gain_crossovers(loops_of(FoPi(4.0, 0.0, 1.0), Plant((1.0, 1.0), (1.0, -2.0, 1.0))))
    np.testing.assert_allclose(found.phase_rad, [3.0 * math.atan(math.sqrt(15.0)) - 2.0 * math.pi], rtol=1e-12)


@pytest.mark.parametrize(
    ("phase_deg", "angle_deg", "lag_deg"),
    [
        (-90.0, 90.0, 90.0),
        (-150.0, 30.0, 30.0),
        (-210.0, -30.0, 330.0),
        (-330.0, -150.0, 210.0),
        (-360.0, 180.0, 180.0),
        (0.0, 180.0, 180.0),
        (30.0, -150.0, 210.0),
        (170.0, -10.0, 350.0),
        (-510.0, 30.0, 30.0),
        (-3630.0, 150.0, 150.0),
    ],
)
def test_angle_and_lag_from_minus_one_do_not_depend_on_whole_turns(
    phase_deg: float, angle_deg: float, lag_deg: float
) -> None:
    one, phase = np.ones(1), np.radians([phase_deg])
    found = Crossings(np.zeros(1, dtype=np.intp), one, 2.0 * one, one, phase, one)
    # a turn of -3630 deg is rounded to 1e-14 rad
    np.testing.assert_allclose(np.degrees(found.angle_from_minus_one_rad), [angle_deg], atol=1e-11)
    np.testing.assert_allclose(np.degrees(found.phase_margin_rad), [abs(angle_deg)], atol=1e-11)
    np.testing.assert_allclose(found.delay_margin_s, np.radians([lag_deg]) / 2.0, atol=1e-13)
    # e^{-j lag} takes L to -1, as e^{-j angle} does
    for turn in (found.angle_from_minus_one_rad, 2.0 * found.delay_margin_s):
        np.testing.assert_allclose(np.exp(1j * (phase - turn)), [-1.0], atol=1e-13)


@pytest.mark.parametrize("kp", [1.0, -1.0, 1.0 - 1e-10])
def test_a_static_gain_of_one_is_approached_but_not_crossed(kp: float) -> None:
    assert len(gain_crossovers(loops_of(FoPi(kp, 0.0, 1.0), LAG)).row) == 0


def test_a_phase_that_lies_on_minus_180_deg_does_not_cross_it() -> None:
    assert len(phase_crossovers(loops_of(FoPi(1.0, 0.0, 1.0), Plant((1.0,), (1.0, 0.0, 0.0)))).row) == 0


@pytest.mark.parametrize("seed", range(2))
def test_a_phase_that_touches_minus_180_deg_is_found(seed: int) -> None:
    # (s^2 + 2 a p s + p^2)/(s (s^2 + 2 b q s + q^2)), 4 a b p q = (p - q)^2: Im L is a multiple of (omega^2 - p q)^2
    rng = np.random.default_rng(seed)
    for _ in range(100):
        q, ratio = 10.0 ** rng.uniform(-2, 2), 10.0 ** rng.uniform(0.1, 1.0)
        p, product = q * ratio, (ratio - 1.0) ** 2 / (4.0 * ratio)
        a = math.sqrt(product) * math.exp(rng.uniform(-1, 1))
        plant = Plant((1.0, 2.0 * a * p, p * p), (1.0, 2.0 * product / a * q, q * q))
        found = phase_crossovers(loops_of(FoPi(0.0, 1.0, 1.0), plant))
        # rounding of the coefficients decides between a touch and a pair, which is then 1e-8 apart
        assert len(found.row) >= 1
        np.testing.assert_allclose(found.omega_rad_s, math.sqrt(p * q), rtol=1e-6)


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
        turn = np.mod(np.degrees(gain.angle_from_minus_one_rad) - np.asarray(pm)[order] + 180.0, 360.0) - 180.0
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


@pytest.mark.parametrize("delay", [0.01, 1.0, 100.0, 1e5])
def test_a_dead_time_far_slower_than_the_crossover_loses_no_low_phase_crossing(delay: float) -> None:
    # k/s: crossings at w L = pi/2 + 2 pi i, all those with |L| > 1 are needed for the reduction margin.
    found = phase_crossovers(loops_of(FoPi(10.0 / delay, 0.0, 1.0), Plant((1.0,), (1.0, 0.0), delay)))
    expected = (0.5 + 2.0 * np.arange(len(found.row))) * math.pi / delay
    assert len(found.row) >= 3
    np.testing.assert_allclose(found.omega_rad_s, expected, rtol=1e-12)


@pytest.mark.parametrize("delay", [30.0, 100.0, 300.0])
def test_a_gain_that_rises_above_its_limit_late_has_its_largest_crossing_listed(delay: float) -> None:
    # 0.5 s/(s + 0.3) (s + 1)^2/(s^2 + 1.6 s + 1): 0.6 at 1 rad/s, after many turns below the limit of 0.5
    controller = FoPi(0.5, 0.0, 1.0)
    plant = Plant((1.0, 2.0, 1.0, 0.0), tuple(np.polymul([1.0, 0.3], [1.0, 1.6, 1.0]).tolist()), delay)
    found = phase_crossovers(loops_of(controller, plant))
    omega = np.linspace(0.01, 20.0, 2_000_001)
    value: Complex = response(controller, plant, omega)
    at = np.flatnonzero((value.imag[1:] > 0.0) != (value.imag[:-1] > 0.0))
    largest = np.abs(value[at][value[at].real < 0.0]).max()
    assert largest > 0.58
    # |L| changes by less than a part in 1e5 from point to point
    assert found.gain.max() == pytest.approx(largest, rel=1e-5)


def test_a_gain_that_rises_above_its_limit_and_falls_slowly_has_its_largest_crossing_listed() -> None:
    # the fractional integral leaves an excess of omega^-0.62 over the limit: ten million turns, few of them listed
    controller = FoPi(2.1765032311961443, 0.1228023298257233, 0.6239263227981185)
    numerator = (0.3955274214270597, 0.20598367926985037, 0.02522263704676973)
    plant = Plant(numerator, (1.0, 6.29181562258844, 1.6791750989540666), 0.4097789597311663)
    found = phase_crossovers(loops_of(controller, plant))
    omega = np.linspace(1.0, 2000.0, 4_000_001)
    value: Complex = response(controller, plant, omega)
    at = np.flatnonzero((value.imag[1:] > 0.0) != (value.imag[:-1] > 0.0))
    largest = np.abs(value[at][value[at].real < 0.0]).max()
    # |L| changes by less than a part in 1e6 from point to point near its largest value
    assert found.gain.max() == pytest.approx(largest, rel=1e-6)
    assert largest > controller.kp * numerator[0] * 1.0005
    assert len(found.row) < 200


def test_fifty_thousand_turns_below_the_crossover_are_listed() -> None:
    loops = loops_of(FoPi(30.0, 1e-3, 0.5), Plant((1.0,), (1.0, 1.0), 1e4))
    found, last = phase_crossovers(loops), gain_crossovers(loops).phase_rad[-1]
    assert np.sum(found.gain > 1.0) == math.floor((-last + math.pi) / (2.0 * math.pi))


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


@pytest.mark.parametrize(
    "plant",
    [
        Plant((1.0, 2.0), (1.0, 2.0)),
        Plant((1.0, 2.0, 3.0), (1.0, 2.0, 3.0), 0.1),
        Plant((1.0, -2.0), (1.0, 2.0)),
    ],
    ids=["cancelled", "cancelled and late", "all-pass"],
)
def test_a_loop_that_lies_on_the_unit_circle_everywhere_is_refused_with_that_reason(plant: Plant) -> None:
    with pytest.raises(DomainError, match=r"\|L\| = 1 over a whole range of frequencies"):
        gain_crossovers(loops_of(FoPi(1.0, 0.0, 1.0), plant))

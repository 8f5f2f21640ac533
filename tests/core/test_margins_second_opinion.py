"""Margins against `control`, dense curves, and what they promise: that a loop moved to its margin stops being stable.

`control.stability_margins` finds crossings as roots of polynomials.  In continuous time it agrees.  On samples its
polynomials in z lose the digits of crossings far below Nyquist's frequency, and it takes roots up to 5 % off the unit
circle for crossings; its own crossings are therefore held against |L| = 1 and arg L = -180 deg first.  It leaves out
the limit at the upper end of the axis.  Where it disagrees, the dense curve of `oracles.nyquist` decides.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
from cases.random_loops import random_loop, random_sampled
from numpy.typing import NDArray
from oracles import sampled_loops as sampled
from oracles.nyquist import DenseMargins, Loop, TooLongError, closed_loop_roots, dense_margins, unstable_poles

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.margins import Margins, margins, margins_of
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.plant import Plant
from fopi_tune.core.sampled_loops import SampledLoops

Array = NDArray[np.float64]
#: phase margin (deg), delay margin (s), gain margin and reduction margin (factors)
Four = tuple[float, float, float, float]
#: relative; polynomial roots of order 12 keep eight digits or more
CONTROL = 1e-6
#: relative; the dense curve is bisected to rounding, which a flat |L| or phase enlarges
DENSE = 1e-7
#: relative distance on both sides of a margin
BESIDE = 1e-6


def few_or_many(few: int, many: int) -> Any:
    """Run a test with a few loops, and behind `-m long` with many others."""
    cases = [pytest.param(1, few, id="few"), pytest.param(2, many, id="many", marks=pytest.mark.long)]
    return pytest.mark.parametrize(("seed", "number"), cases)


def four(found: Margins) -> Four:
    assert found.phase_margin_deg is not None
    assert found.delay_margin_s is not None
    assert found.gain_margin_db is not None
    assert found.gain_reduction_margin_db is not None
    gain = 10.0 ** (found.gain_margin_db / 20.0), 10.0 ** (found.gain_reduction_margin_db / 20.0)
    return found.phase_margin_deg, found.delay_margin_s, *gain


def four_of_curve(found: DenseMargins, stays_large: bool) -> Four:
    lag = 0.0 if stays_large else found.delay_margin_s
    return found.phase_margin_deg, lag, found.gain_margin, found.reduction_margin


def four_of_control(loop: Any, limits: tuple[float, ...], stays_large: bool, curve: Callable[[Array], Any]) -> Four:
    """Reduced by our definitions: the smallest |PM|, the shortest lag, the factors next to 1."""
    import control

    with warnings.catch_warnings():
        # its own polynomial arithmetic complains at times; the answer is compared nevertheless
        warnings.simplefilter("ignore")
        method = "frd" if isinstance(loop, control.FrequencyResponseData) else "poly"
        parts = control.stability_margins(loop, returnall=True, method=method)
    factors, angles, _, at_phase, at_gain, _ = (np.atleast_1d(np.asarray(part, dtype=float)) for part in parts)
    inside = at_gain > 0.0
    inside[inside] = np.abs(np.log(np.abs(curve(at_gain[inside])))) < 1e-3
    angles, at_gain = angles[inside], at_gain[inside]
    lags = np.radians(np.mod(angles, 360.0)) / at_gain
    real = np.isfinite(factors) & (factors > 0.0) & (at_phase > 0.0)
    real[real] = np.abs(np.angle(-curve(at_phase[real]))) < 1e-3
    every = np.concatenate([factors[real], [-1.0 / value for value in limits if value < 0.0]])
    return (
        float(np.abs(angles).min(initial=math.inf)),
        0.0 if stays_large else float(lags.min(initial=math.inf)),
        float(every[every > 1.0].min(initial=math.inf)),
        float(every[every < 1.0].max(initial=0.0)),
    )


def largest_difference(one: Four, other: Four) -> float:
    """Relative; infinite where only one of them is.  A grid ends before what a gain margin of 1e8 is about."""
    ends = [(*values[:2], values[2] if values[2] < 1e8 else math.inf, values[3]) for values in (one, other)]
    pairs = [(a, b) for a, b in zip(*ends, strict=True) if a != b]
    return max((abs(a - b) / max(abs(a), abs(b)) if math.isfinite(a + b) else math.inf for a, b in pairs), default=0.0)


def curve_of(loop: Loop) -> DenseMargins:
    ends = (loop.at_rest, -abs(loop.at_infinity) if loop.dead_time_s else loop.at_infinity)
    return dense_margins(loop.curve, loop.grid(), tuple(end for end in ends if end))


def stable_pis(seed: int, number: int) -> Iterator[Loop]:
    """Stable loops with a PI and no dead time, by the roots of their closed-loop polynomials."""
    rng = np.random.default_rng(seed)
    while number:
        loop = random_loop(rng, 1.0)
        if closed_loop_roots(loop).real.max(initial=-1.0) < -1e-6:
            number -= 1
            yield loop


@cache
def stable_loops(seed: int, number: int) -> list[Loop]:
    """Stable loops of any order, three quarters with a dead time, by their winding number."""
    rng, found = np.random.default_rng(seed), list[Loop]()
    while len(found) < number:
        alpha = 1.0 if rng.random() < 0.25 else float(rng.uniform(0.2, 1.9))
        loop = random_loop(rng, alpha, 10.0 ** rng.uniform(-1.5, 0.3) if rng.random() < 0.75 else 0.0)
        try:
            if unstable_poles(loop) != 0:
                continue
            loop.grid()
        except TooLongError:
            continue
        found.append(loop)
    return found


# --- values --------------------------------------------------------------------------------------------------------


@few_or_many(100, 5000)
def test_margins_of_an_ordinary_pi_are_those_of_control(seed: int, number: int) -> None:
    import control

    kinds = np.zeros(5, dtype=int)
    disagreed = 0
    for loop in stable_pis(seed, number):
        found = margins(loop.controller, loop.plant)
        assert found.stable, loop
        kp, ki = loop.controller.kp, loop.controller.ki
        top = np.polymul(loop.plant.numerator, [kp, ki] if ki else [kp])
        bottom = np.polymul(loop.plant.denominator, [1.0, 0.0] if ki else [1.0])
        limits = tuple(end for end in (loop.at_rest, loop.at_infinity) if end)
        large = abs(loop.at_infinity) >= 1.0
        opinion = four_of_control(control.TransferFunction(top, bottom), limits, large, loop.curve)
        if largest_difference(four(found), opinion) > CONTROL:
            disagreed += 1
            assert largest_difference(four(found), four_of_curve(curve_of(loop), large)) < DENSE, loop
        crossovers = len(found.gain_crossovers_rad_s)
        resonant = np.any((poles := loop.roots[1]).imag > 10.0 * np.abs(poles.real))
        unstable = np.any(poles.real > 0.0)
        kinds += np.array([crossovers == 0, crossovers > 1, resonant, unstable, four(found)[3] > 0.0])
    assert disagreed <= 0.01 * number
    # without crossovers, with several, resonances, poles on the right, and gains that may not be reduced
    assert np.all(kinds > 0.03 * number), kinds


@few_or_many(20, 1500)
def test_margins_of_fractional_loops_with_dead_time_are_those_of_a_dense_curve(seed: int, number: int) -> None:
    delayed = 0
    for loop in stable_loops(seed, number):
        found = margins(loop.controller, loop.plant)
        assert found.stable, loop
        wanted = four_of_curve(curve_of(loop), abs(loop.at_infinity) >= 1.0)
        assert largest_difference(four(found), wanted) < DENSE, (loop, four(found), wanted)
        delayed += loop.dead_time_s > 0.0
    assert delayed > 0.4 * number


@few_or_many(4, 25)
def test_margins_of_loops_with_dead_time_are_those_of_control_from_frequency_data(seed: int, number: int) -> None:
    """`control` interpolates the response by splines through these points."""
    import control

    for loop in stable_loops(seed, number):
        omega = loop.grid(200)
        omega = omega[(omega > 1e-8) & (omega < 1e8)]
        omega = omega[np.diff(omega, prepend=0.0) > 1e-6 * omega]
        data = control.FRD(loop.curve(omega), omega, smooth=True)
        ends = (loop.at_rest, -abs(loop.at_infinity) if loop.dead_time_s else loop.at_infinity)
        limits, large = tuple(end for end in ends if end), abs(loop.at_infinity) >= 1.0
        found = four(margins(loop.controller, loop.plant))
        if largest_difference(found, four_of_control(data, limits, large, loop.curve)) > 1e-3:
            # it takes no crossing beyond its points
            assert largest_difference(found, four_of_curve(curve_of(loop), large)) < DENSE, loop


def sampled_grid(loop: sampled.Loop, plant: Plant) -> Array:
    """Up to Nyquist's frequency, dense at its end and at resonances."""
    end, grid = loop.nyquist, [np.geomspace(1e-8, 1.0 - 1e-9, 2500), np.linspace(1e-3, 1.0, 1000, endpoint=False)]
    grid.append(1.0 - np.geomspace(1e-9, 0.1, 200))
    for root in np.concatenate([np.roots(plant.numerator), np.roots(plant.denominator)]):
        if root.imag > 0.0:
            near = root.imag + abs(root.real) * np.sinh(np.linspace(-9.0, 9.0, 121))
            # frequencies above Nyquist's are folded back
            folded = np.abs(np.mod(near / end + 1.0, 2.0) - 1.0)
            grid.append(folded[(folded > 1e-8) & (folded < 1.0 - 1e-9)])
    return end * np.unique(np.concatenate(grid))


@cache
def stable_sampled_loops(seed: int, number: int, proper: bool) -> list[tuple[Plant, Sections, float]]:
    """Stable by the eigenvalues of their state space."""
    rng, found = np.random.default_rng(seed), list[tuple[Plant, Sections, float]]()
    while len(found) < number:
        plant, sections, delay = random_sampled(rng, proper)
        if sampled.sizes(sampled.sample(plant, sections.sample_time_s, delay), sections).max() < 1.0 - 1e-6:
            found.append((plant, sections, delay))
    return found


def sampled_margins(plant: Plant, sections: Sections, delay: float) -> Margins:
    implementation = Implementation(sections, delay)
    return margins_of(SampledLoops.implemented(FoPi(1.0, 1.0, 1.0), implementation, Plants.of(plant)))


def sampled_limits(plant: Plant, sections: Sections, loop: sampled.Loop) -> tuple[float, ...]:
    """L(-1), and L(1) where it is finite."""
    ends = [float(loop.gain(np.array([loop.nyquist]))[0].real)]
    if 1.0 not in sections.poles and plant.denominator[-1] != 0.0:
        rest = sections.direct + sum(r / (1.0 - p) for r, p in zip(sections.residues, sections.poles, strict=True))
        ends.append(rest * plant.numerator[-1] / plant.denominator[-1])
    return tuple(ends)


@few_or_many(6, 500)
def test_margins_on_samples_are_those_of_a_dense_curve(seed: int, number: int) -> None:
    for plant, sections, delay in stable_sampled_loops(seed, number, proper=True):
        loop = sampled.Loop.of(plant, Implementation(sections, delay))
        limits = sampled_limits(plant, sections, loop)
        found = sampled_margins(plant, sections, delay)
        assert found.stable
        curve = dense_margins(loop.gain, sampled_grid(loop, plant), limits)
        difference = largest_difference(four(found), four_of_curve(curve, abs(limits[0]) >= 1.0))
        assert difference < DENSE, (plant, sections, delay)


def discrete_transfer_function(plant: Plant, sections: Sections, delay: float) -> Any:
    """L(z) of a plant without direct path, by SciPy's hold."""
    import control
    from scipy.signal import cont2discrete

    held: Any = cont2discrete((plant.numerator, plant.denominator), sections.sample_time_s, method="zoh")
    below = np.real(np.poly(sections.poles)) if sections.poles else np.ones(1)
    above = sections.direct * below
    for k, residue in enumerate(sections.residues):
        above = np.polyadd(above, residue * np.real(np.poly(np.delete(sections.poles, k))))
    top = np.polymul(np.trim_zeros(np.ravel(held[0]), "f"), above)
    return control.TransferFunction(
        top, np.polymul(np.append(np.ravel(held[1]), np.zeros(int(delay))), below), sections.sample_time_s
    )


@few_or_many(20, 500)
def test_margins_on_samples_are_those_of_control_or_of_a_dense_curve(seed: int, number: int) -> None:
    agreed = 0
    for plant, sections, delay in stable_sampled_loops(seed, number, proper=False):
        loop = sampled.Loop.of(plant, Implementation(sections, delay))
        limits = sampled_limits(plant, sections, loop)
        found, large = four(sampled_margins(plant, sections, delay)), abs(limits[0]) >= 1.0
        opinion = four_of_control(discrete_transfer_function(plant, sections, delay), limits, large, loop.gain)
        if largest_difference(found, opinion) <= CONTROL:
            agreed += 1
        else:
            curve = dense_margins(loop.gain, sampled_grid(loop, plant), limits)
            assert largest_difference(found, four_of_curve(curve, large)) < DENSE, (plant, sections, delay)
    assert agreed > 0.5 * number


# --- what a margin promises ------------------------------------------------------------------------------------------


def flips_of(loop: Loop, found: Margins) -> Iterator[tuple[Loop, Loop]]:
    """The loop just inside each of its margins, and just beyond."""
    _, lag, gain, reduction = four(found)
    if 0.0 < lag < math.inf:
        yield loop.delayed(lag * (1.0 - BESIDE)), loop.delayed(lag * (1.0 + BESIDE))
    if gain < math.inf:
        yield loop.scaled(gain * (1.0 - BESIDE)), loop.scaled(gain * (1.0 + BESIDE))
    if reduction > 0.0:
        yield loop.scaled(reduction * (1.0 + BESIDE)), loop.scaled(reduction * (1.0 - BESIDE))


@few_or_many(20, 1500)
def test_a_loop_moved_across_its_margin_becomes_unstable(seed: int, number: int) -> None:
    """An independent count says stable inside, and not beyond; curves that are too long are left out."""
    flipped = 0
    for loop in stable_loops(seed, number):
        for inside, beyond in flips_of(loop, margins(loop.controller, loop.plant)):
            try:
                counts = unstable_poles(inside), unstable_poles(beyond)
            except TooLongError:
                continue
            assert counts[0] == 0 < counts[1], (loop, inside, beyond, counts)
            flipped += 1
    assert flipped >= number


@few_or_many(100, 2000)
def test_a_pi_scaled_across_its_gain_margins_becomes_unstable(seed: int, number: int) -> None:
    """With a PI and no dead time the closed loop's polynomial tells, also what a gain at its margin does."""
    flipped = 0
    for loop in stable_pis(seed, number):
        _, _, gain, reduction = four(margins(loop.controller, loop.plant))
        for factor, outward in ((gain, 1.0), (reduction, -1.0)):
            # with L -> -1 the polynomial loses its degree, and a root passes through infinity
            if not 0.0 < factor < math.inf or abs(factor * loop.at_infinity + 1.0) < 1e-3:
                continue
            worst = [
                float(closed_loop_roots(loop.scaled(factor * (1.0 + side * 1e-4 * outward))).real.max())
                for side in (-1.0, 1.0)
            ]
            assert worst[0] < 0.0 < worst[1], (loop, factor)
            flipped += 1
    assert flipped >= 0.25 * number


@few_or_many(20, 500)
def test_a_loop_on_samples_scaled_across_its_gain_margins_becomes_unstable(seed: int, number: int) -> None:
    flipped = 0
    for plant, sections, delay in stable_sampled_loops(seed, number, proper=True):
        _, _, gain, reduction = four(sampled_margins(plant, sections, delay))
        held = sampled.sample(plant, sections.sample_time_s, delay)
        for factor, outward in ((gain, 1.0), (reduction, -1.0)):
            if 0.0 < factor < math.inf:
                inside, beyond = (
                    float(sampled.sizes(held, sampled.scaled(sections, factor * (1.0 + side * 1e-4 * outward))).max())
                    for side in (-1.0, 1.0)
                )
                assert inside < 1.0 < beyond, (plant, sections, delay, factor)
                flipped += 1
    assert flipped >= number


@few_or_many(20, 500)
def test_whole_samples_within_the_delay_margin_are_borne(seed: int, number: int) -> None:
    """A whole sample more is the rotation e^{-j omega Ts}; with |L(-1)| >= 1 not one of them is."""
    borne = refused = 0
    for plant, sections, delay in stable_sampled_loops(seed, number, proper=True):
        found = sampled_margins(plant, sections, delay)
        assert found.delay_margin_s is not None
        ts = sections.sample_time_s
        if found.delay_margin_s == 0.0:
            held = sampled.sample(plant, ts, delay + 1.0)
            assert sampled.sizes(held, sections).max() >= 1.0, (plant, sections, delay)
            refused += 1
        # so many are less than the margin
        whole = min(math.ceil(min(found.delay_margin_s / ts, 1e3) * (1.0 - 1e-9)) - 1, 8)
        for more in range(1, whole + 1):
            assert sampled.sizes(sampled.sample(plant, ts, delay + more), sections).max() < 1.0
            borne += 1
    assert borne > number
    assert refused >= number // 250


def assert_rotation_reaches_minus_one(found: Margins, curve: Callable[[Array], Any], crossovers: Array) -> None:
    """e^{-j PM} or e^{+j PM} takes L to -1, and nothing smaller does: |1 + L| >= 2 sin(PM/2) wherever |L| = 1."""
    assert found.phase_margin_deg is not None
    if not found.gain_crossovers_rad_s:
        assert found.phase_margin_deg == math.inf
        return
    phi = math.radians(found.phase_margin_deg)
    assert found.phase_margin_rad_s is not None
    value = complex(curve(np.array([found.phase_margin_rad_s]))[0])
    nearest = min(abs(1.0 + value * np.exp(side * 1j * phi)) for side in (-1.0, 1.0))
    # |L| and its phase are 1 and known to the digits that a steep resonance leaves of omega
    assert nearest == pytest.approx(0.0, abs=1e-9)
    distance = np.abs(1.0 + curve(crossovers))
    assert float(distance.min()) == pytest.approx(2.0 * math.sin(0.5 * phi), rel=1e-7)


@few_or_many(20, 1500)
def test_the_rotation_by_the_phase_margin_and_none_smaller_reaches_minus_one(seed: int, number: int) -> None:
    for loop in stable_loops(seed, number):
        crossovers = curve_of(loop).crossovers_rad_s
        assert_rotation_reaches_minus_one(margins(loop.controller, loop.plant), loop.curve, crossovers)


@few_or_many(20, 500)
def test_on_samples_the_rotation_by_the_phase_margin_and_none_smaller_reaches_minus_one(seed: int, number: int) -> None:
    for plant, sections, delay in stable_sampled_loops(seed, number, proper=True):
        loop = sampled.Loop.of(plant, Implementation(sections, delay))
        found = sampled_margins(plant, sections, delay)
        omega = np.array(found.gain_crossovers_rad_s)
        assert_rotation_reaches_minus_one(found, loop.gain, omega)
        lag = four(found)[1]
        if 0.0 < lag < math.inf:
            assert found.delay_margin_rad_s is not None
            turned = loop.gain(np.array([found.delay_margin_rad_s])) * np.exp(-1j * found.delay_margin_rad_s * lag)
            np.testing.assert_allclose(turned, -1.0, atol=1e-9)

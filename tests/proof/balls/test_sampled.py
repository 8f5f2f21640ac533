"""The loop on samples in ball arithmetic: what the balls say of a box holds at every point of it.

The points' values come from `oracles.sampled_loops` (state space in floating point) and its difference quotients.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from cases.parametric_plants import family_of
from cases.plants import lag, pole, spec_of, transfer_function
from flint import acb, arb, ctx
from oracles import sampled_loops as oracle

import fopi_tune as ft
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.peaks import Response
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof import certify, verify
from fopi_tune.proof.balls.argument_principle import count_right_half_plane_zeros
from fopi_tune.proof.balls.sampled import SampledBallLoop
from fopi_tune.proof.balls.sampled_roots import count_unstable_roots
from fopi_tune.proof.claims.bound import Bound
from fopi_tune.proof.claims.branch_and_bound import search
from fopi_tune.proof.claims.lag import LagBound, closed_form
from fopi_tune.proof.claims.poles import is_structurally_unstable
from fopi_tune.proof.documents import from_document, to_document
from fopi_tune.spec.model import Relation, Requirement

#: relative; the oracle's solve next to z = 1, and 1 + L where it cancels
ROUNDING = 1e-8
#: relative; second-order differences with steps of 1e-5 and the rounding they enlarge
DIFFERENCE = 1e-4
TS = 0.2
GAINS = ft.FoPi(0.4, 0.3, 0.9)
SECTIONS = Sections(TS, 0.5, (1.0, 0.97, 0.6, -0.4), (0.04, 0.02, -0.05, 0.03))

#: family, and the computing delay in samples
CASES: dict[str, tuple[PlantFamily, float]] = {
    "lag": (lag((1.0, 0.8, 1.2), (2.0, 1.5, 2.5)), 0.0),
    "lag late by a part": (lag(1.0, (2.0, 1.5, 2.5), 0.13), 0.5),
    "lag late by anything": (lag(1.0, (2.0, 1.5, 2.5), (0.4, 0.1, 0.7)), 1.0),
    "pole through 0": (pole((1.0, 0.8, 1.2), (0.0, -0.2, 0.2), 0.05), 0.0),
    "slow pole late by a part": (pole(4.39, (0.1746, 0.15, 0.2), 0.07), 0.0),
    "poles of any speed": (pole(1.0, (4.0, 0.1, 60.0)), 1.0),
    "unstable pole": (pole(1.0, (-0.2, -0.3, -0.1)), 2.0),
    "second order": (transfer_function([1.0], [1.0, (1.2, 0.9, 1.5), (1.5, 1.0, 2.0)], (0.3, 0.15, 0.5)), 0.0),
    "third order": (transfer_function([(-0.3, -0.4, -0.2), 1.0], [1.0, 3.0, (3.0, 2.5, 3.5), 1.0], 0.07), 0.0),
    "biproper": (transfer_function([(0.3, 0.2, 0.4), 1.0], [1.0, (1.0, 0.8, 1.2)], 0.25), 0.0),
    "integrator and lag": (transfer_function([1.0], [1.0, (1.0, 0.5, 1.5), 0.0]), 0.0),
    "linked, late by a parameter": (
        family_of({"T": (1.0, 1.4), "k": (0.8, 1.2)}, ["k / T"], [1.0, "1 / T + k", "k / T"], dead_time_s="T"),
        0.5,
    ),
}


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


def holds(ball: acb | arb, value: complex, tolerance: float) -> bool:
    """Whether a value lies in a ball, but for the value's own error."""
    around = tolerance * (abs(value) + 1e-12)
    parts = [(ball.real, value.real), (ball.imag, value.imag)] if isinstance(ball, acb) else [(ball, value.real)]
    return all(not part.is_finite() or part.overlaps(arb(wanted, around)) for part, wanted in parts)


def value_at(
    family: PlantFamily, implementation: Implementation, u: float, theta: np.ndarray
) -> tuple[complex, complex]:
    """L and C at one place."""
    loop = oracle.Loop.of(family.member(theta), implementation)
    omega = np.array([2.0 * math.atan(math.exp(u)) / implementation.sample_time_s])
    return complex(loop.gain(omega)[0]), complex(oracle.controller(implementation.sections, omega)[0])


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", CASES)
def test_values_and_derivatives_lie_in_the_balls_of_every_box(name: str) -> None:
    family, delay = CASES[name]
    implementation = Implementation(SECTIONS, delay)
    loop = SampledBallLoop(GAINS, family, implementation)
    rng, finite = np.random.default_rng(5), 0
    low, high = family.low, family.high
    for _ in range(25):
        width = float(10.0 ** rng.uniform(-4.0, 0.0))
        start = low + rng.uniform(0.0, 1.0 - width, size=len(low)) * (high - low)
        sides = tuple(zip(start.tolist(), (start + width * (high - low)).tolist(), strict=True))
        u = float(rng.uniform(-6.0, 3.0))
        over = loop.over(((u, u + width), *sides))
        finite += bool(over.gain.is_finite())
        for _ in range(3):
            at = u + width * float(rng.uniform())
            theta = start + rng.uniform(size=len(low)) * width * (high - low)
            gain, controller = value_at(family, implementation, at, theta)
            assert holds(over.gain, gain, ROUNDING)
            assert holds(over.sensitivity, 1.0 / (1.0 + gain), ROUNDING)
            assert holds(over.complementary, gain / (1.0 + gain), ROUNDING)
            assert holds(over.control_sensitivity, controller / (1.0 + gain), ROUNDING)
            h = 1e-5
            ends = [value_at(family, implementation, at + sign * h, theta)[0] for sign in (1.0, -1.0)]
            assert holds(over.log_slope, np.log(ends[0] / ends[1]) / (2.0 * h), DIFFERENCE)
            for axis in range(len(low)):
                step = h * (high[axis] - low[axis]) * np.eye(len(low))[axis]
                ends = [value_at(family, implementation, at, theta + sign * step)[0] for sign in (1.0, -1.0)]
                slope = np.log(ends[0] / ends[1]) / (2.0 * float(step[axis]))
                # a kink within the step is between the one-sided slopes, which the balls hold both
                assert holds(over.log_gradient[axis], slope, DIFFERENCE)
    assert finite >= 10


def phase_slopes(family: PlantFamily, implementation: Implementation, u: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """d arg L/d ln omega of one plant at places u, by differences of the fourth order."""
    step = 2e-3
    places = u[:, None] + step * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    omega = 2.0 * np.arctan(np.exp(places)) / implementation.sample_time_s
    gain = oracle.Loop.of(family.member(theta), implementation).gain(omega.ravel()).reshape(omega.shape)
    turns = np.angle(gain / gain[:, 2:3])
    along = (turns[:, 0] - 8.0 * turns[:, 1] + 8.0 * turns[:, 3] - turns[:, 4]) / (12.0 * step)
    nu = np.exp(u)
    return along / (nu / (1.0 + nu * nu) / np.arctan(nu))


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", CASES)
def test_the_phase_slope_and_its_derivatives_are_differences_of_the_loop_on_samples(name: str) -> None:
    family, delay = CASES[name]
    implementation = Implementation(SECTIONS, delay)
    loop = SampledBallLoop(GAINS, family, implementation)
    rng = np.random.default_rng(7)
    low, high = family.low, family.high
    h = 5e-4
    for _ in range(8):
        u, theta = float(rng.uniform(-4.0, 1.5)), low + rng.uniform(0.1, 0.9, size=len(low)) * (high - low)
        # over a box without a width the derivatives along the plants are left out
        at = loop.enclosure((u, u), loop.plant([arb(v) for v in theta.tolist()]))
        before, here, after = phase_slopes(family, implementation, u + h * np.array([-1.0, 0.0, 1.0]), theta)
        size = 1.0 + abs(here)
        # the difference quotients lose about 1e-11 to rounding; those of second order another h^2 of the value
        assert abs(float(at.phase_slope.mid()) - here) < 1e-7 * size
        along, *across = at.phase_slope_derivatives
        assert abs(float(along.mid()) - (after - before) / (2.0 * h)) < 2e-5 * size
        for axis, derivative in enumerate(across):
            step = 1e-4 * (high[axis] - low[axis]) * np.eye(len(low))[axis]
            ends = [phase_slopes(family, implementation, np.array([u]), theta + sign * step)[0] for sign in (1.0, -1.0)]
            change = ends[0] - ends[1]
            assert (derivative * 2.0 * float(step[axis])).overlaps(arb(change, 1e-3 * abs(change) + 1e-9 * size)), axis


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", CASES)
def test_tails_hold_every_value_up_to_both_ends(name: str) -> None:
    family, delay = CASES[name]
    implementation = Implementation(SECTIONS, delay)
    loop = SampledBallLoop(GAINS, family, implementation)
    rng = np.random.default_rng(6)
    for tail in ((-math.inf, -5.0), (3.0, math.inf)):
        for _ in range(10):
            theta = family.low + rng.uniform(size=len(family.low)) * (family.high - family.low)
            over = loop.over((tail, *((float(v), float(v)) for v in theta)))
            for distance in (0.0, 1.0, 5.0):
                u = tail[1] - distance if tail[0] == -math.inf else tail[0] + distance
                gain, controller = value_at(family, implementation, u, theta)
                assert holds(over.gain, gain, ROUNDING)
                assert holds(over.sensitivity, 1.0 / (1.0 + gain), ROUNDING)
                assert holds(over.control_sensitivity, controller / (1.0 + gain), ROUNDING)


# -- the lag in closed form -------------------------------------------------------------------------------------------


def worst_sensitivity(sections: Sections, low: float, high: float, omega: float) -> float:
    """max |S| over the time constants at one frequency, by S = (v + m)/(v + m G), m = 1 - e^{-Ts/tau}.

    With v = z - 1 and G = 1 + C, |S|^2 = (|v|^2 + 2m Re v + m^2)/(|v|^2 + 2m Re(G conj v) + m^2 |G|^2).  It is a
    quotient of quadratics in m: stationary where their Wronskian, a quadratic, is 0.
    """
    z = np.exp(1j * omega * TS)
    v, g = z - 1.0, 1.0 + complex(oracle.controller(sections, np.array([omega]))[0])
    top = np.array([1.0, 2.0 * v.real, abs(v) ** 2])
    bottom = np.array([abs(g) ** 2, 2.0 * (g * np.conj(v)).real, abs(v) ** 2])
    ends = [-math.expm1(-TS / high), -math.expm1(-TS / low)]
    wronskian = np.polysub(np.polymul(np.polyder(top), bottom), np.polymul(top, np.polyder(bottom)))
    inside = [x.real for x in np.roots(wronskian) if abs(x.imag) < 1e-9 and ends[0] < x.real < ends[1]]
    return math.sqrt(max(np.polyval(top, m) / np.polyval(bottom, m) for m in (*ends, *inside)))


@pytest.mark.thinned(3)
@pytest.mark.parametrize("residue", [0.04, 0.4, 2.0])
def test_the_closed_form_tells_levels_around_the_worst_sensitivity_apart(residue: float) -> None:
    """Also for loops that are not stable: |S| has a bound whenever no plant has a pole on the circle."""
    family = lag(1.0, (2.0, 1.5, 3.0))
    sections = Sections(TS, 0.5, (1.0, 0.6), (residue, -0.05))
    omega = np.linspace(1e-3, math.pi / TS, 60_001)
    coarse = np.array([worst_sensitivity(sections, 1.5, 3.0, x) for x in omega[::100]])
    k = int(np.argmax(coarse)) * 100
    near = np.linspace(omega[max(k - 100, 0)], omega[min(k + 100, len(omega) - 1)], 4001)
    worst = math.log(max(worst_sensitivity(sections, 1.5, 3.0, x) for x in near))
    loop = SampledBallLoop(GAINS, family, Implementation(sections))
    for offset, shown in ((1e-5, True), (-1e-5, False)):
        domain = ((-math.inf, math.inf), (1.5, 3.0))
        general = Bound(loop, Response.SENSITIVITY, worst + offset, True, domain, -2.0)
        form = closed_form(general)
        assert isinstance(form, LagBound)
        assert search(form, 4000).shown is shown
        assert search(general, 8000).shown is shown


# -- poles ------------------------------------------------------------------------------------------------------------


def test_roots_and_arguments_are_counted_as_eigenvalues_are() -> None:
    rng, unstable = np.random.default_rng(8), 0
    names = list(CASES)
    for k in range(120):
        family, delay = CASES[names[k % len(names)]]
        factor = float(10.0 ** rng.uniform(-1.0, 1.2))
        sections = oracle.scaled(SECTIONS, factor)
        theta = family.low + rng.uniform(size=len(family.low)) * (family.high - family.low)
        sizes = oracle.sizes(oracle.sample(family.member(theta), TS, delay), sections)
        assert np.all(np.abs(sizes - 1.0) > 1e-7)
        loop = SampledBallLoop(GAINS, family, Implementation(sections, delay))
        count = int((sizes > 1.0).sum())
        assert count_unstable_roots(loop, theta.tolist()) == count
        assert (
            count_right_half_plane_zeros(loop, loop.plant([arb(v) for v in theta.tolist()]), loop.has_integrator)
            == count
        )
        unstable += count > 0
    assert 15 < unstable < 105


@pytest.mark.parametrize("late", [50, 150, 400])
def test_long_delays_are_counted_too(late: int) -> None:
    for factor in (0.02, 0.3):
        sections = oracle.scaled(SECTIONS, factor)
        family = lag(1.0, (2.0, 1.5, 2.5))
        loop = SampledBallLoop(GAINS, family, Implementation(sections, float(late)))
        sizes = oracle.sizes(oracle.sample(family.member(np.array([2.0])), TS, float(late)), sections)
        assert count_unstable_roots(loop, (2.0,)) == (sizes > 1.0).sum()


def test_an_integral_is_cancelled_only_where_the_filter_has_one() -> None:
    family = transfer_function([1.0, 0.0], [1.0, 1.0])
    loops = [
        SampledBallLoop(GAINS, family, Implementation(Sections(TS, 0.5, poles, (0.1,)))) for poles in ((1.0,), (0.9,))
    ]
    assert [is_structurally_unstable(loop, ()) for loop in loops] == [True, False]
    assert [count_unstable_roots(loop, ()) for loop in loops] == [None, 0]


@pytest.mark.parametrize(
    ("poles", "said"),
    [((1.0, 0.5), True), ((1.0, 1.0 - 2.0**-53), True), ((0.5, 1.0), False), ((1.0, -1.0), False), ((1.0, 1.5), False)],
)
def test_the_filters_own_poles_are_compared_exactly(poles: tuple[float, float], said: bool) -> None:
    """Only the first may be 1; a pole one rounding inside the circle is inside."""
    implementation = Implementation(Sections(TS, 0.5, (1.0, 0.5), (0.04, 0.02)))
    spec = spec_of(lag(1.0, 2.0), Requirement("sensitivity_db", Relation.AT_MOST, (6.0,)))
    document = to_document(certify(spec, verify(spec, GAINS, implementation=implementation), {}, implementation))
    document["implementation"]["poles"] = list(poles)
    if said:
        assert from_document(document).case.implementation is not None
    else:
        with pytest.raises(ft.CertificateError, match="stable sum"):
            from_document(document)

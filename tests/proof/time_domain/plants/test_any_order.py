"""Both forms of plants are the same plants, and that of any order has the derivatives of differences."""

from __future__ import annotations

import numpy as np
import pytest
from cases.parametric_plants import family_of
from cases.plants import lag, transfer_function
from flint import ctx

from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Box
from fopi_tune.proof.time_domain.models import Model
from fopi_tune.proof.time_domain.plants.held import HeldPlants, Polynomial
from fopi_tune.proof.time_domain.plants.hold import hold_plants

RESONANT = transfer_function([(0.5, 1.5), 1.0], [1.0, (0.4, 0.8), (1.8, 2.2)], (0.02, 0.08))


def held(family: PlantFamily, box: Box) -> HeldPlants:
    with ctx.workprec(128):
        found = hold_plants(family, box, 0.1, 0.3, (0.0, True), True)
    assert found is not None
    return found


def at_point(family: PlantFamily, point: tuple[float, ...]) -> HeldPlants:
    return held(family, tuple((value, value) for value in point))


def coefficients(polynomial: Polynomial, count: int = 8) -> np.ndarray:
    return polynomial.centre[0].series(count)


def test_a_pole_that_cancels_gives_the_plant_of_first_order() -> None:
    """(s + 3)/((s + 3)(1.5 s + 1)) and 1/(1.5 s + 1): N D' = N' D."""
    one = at_point(lag(1.0, (1.0, 2.0), 0.07), (1.5,))
    two = at_point(transfer_function([1.0, 3.0], [1.5, (5.0, 6.0), 3.0], 0.07), (5.5,))
    assert (one.order, two.order) == (1, 2)
    for first, second in ((one.control, two.control), (one.load, two.load)):
        assert first is not None
        assert second is not None
        left = np.convolve(coefficients(first), coefficients(two.denominator))
        right = np.convolve(coefficients(second), coefficients(one.denominator))
        assert left == pytest.approx(right, abs=1e-15)


def test_a_direct_path_has_the_input_of_before() -> None:
    """(s + 2)/(s + 1) = 1 + 1/(s + 1), without delay: x D + N of the lag."""
    with ctx.workprec(128):
        both = hold_plants(transfer_function([1.0, 2.0], [1.0, 1.0]), (), 0.1, 0.0, (0.0, True), False)
        alone = hold_plants(lag(1.0, 1.0), (), 0.1, 0.0, (0.0, True), False)
    assert both is not None
    assert alone is not None
    whole = coefficients(alone.control) + np.concatenate([[0.0], coefficients(alone.denominator)[:-1]])
    assert coefficients(both.control) == pytest.approx(whole, abs=1e-15)


def test_models_hold_every_plant_of_a_box() -> None:
    middle = np.array([1.0, 0.6, 2.0, 0.05])
    radii = np.array([0.1, 0.05, 0.05, 0.01])
    box = tuple(zip((middle - radii).tolist(), (middle + radii).tolist(), strict=True))
    wide, rng = held(RESONANT, box), np.random.default_rng(2)
    shares = [2.0 * rng.random(4) - 1.0 for _ in range(20)]
    for share in shares:
        exact = at_point(RESONANT, tuple(np.clip(middle + share * radii, *np.array(box).T).tolist()))
        for part, true in ((wide.denominator, exact.denominator), (wide.control, exact.control)):
            for (basis, model), (other, value) in zip(part.terms, true.terms, strict=True):
                assert np.array_equal(basis.values, other.values)
                assert_holds(model, share * radii, float(value.values[0]))


def test_models_hold_every_linked_plant_of_a_box() -> None:
    ranges = {"L": (0.02, 0.08), "k": (1.8, 2.2), "w": (0.9, 1.1)}
    family = family_of(ranges, ["k * w**2"], [1, "w / 2", "w**2"], dead_time_s="L")
    middle, radii = np.array([0.05, 2.0, 1.0]), np.array([0.01, 0.1, 0.05])
    box = tuple(zip((middle - radii).tolist(), (middle + radii).tolist(), strict=True))
    wide, rng = held(family, box), np.random.default_rng(2)
    for _ in range(20):
        share = 2.0 * rng.random(3) - 1.0
        exact = at_point(family, tuple(np.clip(middle + share * radii, *np.array(box).T).tolist()))
        for part, true in ((wide.denominator, exact.denominator), (wide.control, exact.control)):
            for (_, model), (_, value) in zip(part.terms, true.terms, strict=True):
                assert_holds(model, share * radii, float(value.values[0]))


def assert_holds(model: Model, shift: np.ndarray, value: float) -> None:
    pairs = [shift[j] * shift[i] for j in range(len(shift)) for i in range(j + 1)]
    near = model.values[0] + shift @ model.slopes[:, 0] + np.array(pairs) @ model.pairs[:, 0]
    assert abs(near - value) <= model.rest[0] * (1.0 + 1e-9) + 1e-15
    assert model.rest[0] <= 0.2 * model.linear[0] + 1e-15


def test_a_pole_far_beyond_the_sampling_is_one_that_is_not_there() -> None:
    """1/((1e-3 s + 1)(1.5 s + 1)) sampled every 0.1 s: e^-100 is left of the fast pole."""
    fast = at_point(transfer_function([1.0], [1.5e-3, (1.4, 1.6), 1.0], 0.07), (1.501,))
    whole = coefficients(fast.denominator)
    assert whole[:4] == pytest.approx([1.0, -np.exp(-0.1 / 1.5), 0.0, 0.0], abs=1e-12)
    assert all(model.rest[0] < 1e-14 for _, model in (*fast.denominator.terms, *fast.control.terms))

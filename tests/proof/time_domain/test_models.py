"""Models hold the numbers that they stand for, through sums, products and Taylor's formula."""

from __future__ import annotations

import numpy as np
from flint import arb, ctx

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.time_domain.jets import Jet, pairs_of
from fopi_tune.proof.time_domain.models import Model, delayed, number_model

RADII = np.array([0.1, 0.3])
RNG = np.random.default_rng(3)
SHIFTS = (2.0 * RNG.random((200, 2)) - 1.0) * RADII


def some(count: int = 5) -> Model:
    p = len(RADII)
    return Model(
        RNG.standard_normal(count), RNG.standard_normal((p, count)), RNG.standard_normal((3, count)),
        0.01 * RNG.random(count), RADII,
    )  # fmt: skip


def at(model: Model, shift: Array, share: float) -> Array:
    """A function that the model allows."""
    pairs = np.array([shift[j] * shift[i] for j, i in pairs_of(2)])
    return model.values + shift @ model.slopes + pairs @ model.pairs + share * model.rest


def assert_holds(model: Model, shift: Array, values: Array) -> None:
    without = at(model, shift, 0.0)
    assert np.all(np.abs(values - without) <= model.rest + 1e-15)
    assert np.all((model.low <= values) & (values <= model.high))


def test_sums_products_and_delays() -> None:
    one, two, factor = some(), some(), some(1)
    for shift, share in zip(SHIFTS, np.linspace(-1.0, 1.0, len(SHIFTS)), strict=True):
        a, b, c = at(one, shift, share), at(two, shift, -share), at(factor, shift, share)
        assert_holds(one + two, shift, a + b)
        assert_holds(one - two, shift, a - b)
        assert_holds(one * two, shift, a * b)
        assert_holds(factor * one, shift, c * a)
        assert_holds(one.times(np.array([-2.0])), shift, -2.0 * a)
        assert_holds(one.total(), shift, np.array([a.sum()]))
        assert_holds(delayed(one, 2), shift, np.concatenate([np.zeros(2), a[:3]]))
    assert np.all(delayed(one, 9).values == 0.0)


def test_the_range_of_one_number_is_sharp() -> None:
    # 1 + x - 2 x^2 on [-0.5, 0.5] turns at x = 1/4
    model = Model(np.array([1.0]), np.array([[1.0]]), np.array([[-2.0]]), np.zeros(1), np.array([0.5]))
    assert model.high[0] == np.float64(1.125).round(12) or abs(model.high[0] - 1.125) < 1e-12
    assert abs(model.low[0] - 0.0) < 1e-12


def test_numbers_by_taylors_formula() -> None:
    with ctx.workprec(128):
        centre = (arb(1.5), arb(-0.4))

        def jets(spread: bool) -> list[Jet]:
            balls = [c + (arb(0, float(r)) if spread else 0) for c, r in zip(centre, RADII, strict=True)]
            unit = [(arb(1), arb(0)), (arb(0), arb(1))]
            return [Jet(ball, unit[k], (arb(0),) * 3) for k, ball in enumerate(balls)]

        def function(x: Jet, y: Jet) -> Jet:
            return (x * y).exp() / (1 + x) - 2 * y

        model = number_model(function(*jets(True)), function(*jets(False)), RADII)
    for shift in SHIFTS:
        x, y = 1.5 + shift[0], -0.4 + shift[1]
        assert_holds(model, shift, np.array([np.exp(x * y) / (1.0 + x) - 2.0 * y]))
    assert model.rest[0] < 0.1 * model.linear[0]

"""Families of fractional plants: their numbers, and whole orders as transfer functions."""

from __future__ import annotations

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.fractional_plants.family import FractionalFamily, fractional_part
from fopi_tune.core.fractional_plants.orders import MOST_ORDER, Orders
from fopi_tune.core.fractional_plants.plants import FractionalPlant
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.margins import margins_of
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.errors import DomainError

EXACT, BETWEEN = Uncertain.exactly, Uncertain.between


def test_terms_come_by_falling_order_and_keep_the_names_that_they_are_written_with() -> None:
    family = FractionalFamily.of([(BETWEEN(1.0, 3.0), 0.0)], [(EXACT(1.0), 0.0), (BETWEEN(4.0, 6.0), 0.7)], EXACT(0.2))
    assert family.uncertain_names == ("numerator[0].coefficient", "denominator[1].coefficient")
    top, bottom, dead_time = family.tables(np.array([[1.5, 5.5]]))
    assert (top.tolist(), bottom.tolist(), dead_time.tolist()) == ([[1.5]], [[5.5, 1.0]], [0.2])
    assert family.orders == Orders((0.0,), (0.7, 0.0))
    plant = family.member(np.array([1.5, 5.5]))
    assert isinstance(plant, FractionalPlant)
    assert (plant.top, plant.bottom, plant.orders) == ((1.5,), (5.5, 1.0), family.orders)
    assert plant == family.member(np.array([1.5, 5.5]))
    assert plant != family.member(np.array([1.6, 5.5]))
    assert family.problem("denominator[1].coefficient", BETWEEN(-1.0, 1.0)) is not None
    assert family.problem("denominator[0].coefficient", BETWEEN(-1.0, 1.0)) is None


def test_whole_orders_are_a_transfer_function() -> None:
    # 1.0263/(s (0.71 s + 1)), the terms in another order
    gain = BETWEEN(0.9, 1.1)
    family = FractionalFamily.of([(gain, 0.0)], [(EXACT(1.0), 1.0), (EXACT(0.71), 2.0)], EXACT(0.1))
    numbers = {"numerator[0]": gain, "denominator[0]": EXACT(0.71), "denominator[1]": EXACT(1.0)}
    same = PlantFamily("transfer_function", {**numbers, "denominator[2]": EXACT(0.0), "dead_time_s": EXACT(0.1)})
    assert fractional_part(family) is None
    points = family.corners()
    for one, other in zip(family.coefficients(points), same.coefficients(points), strict=True):
        np.testing.assert_array_equal(one, other)
    assert family.member(family.nominal_point) == same.member(same.nominal_point)
    gains = FoPi(1.2, 0.4, 0.8)
    found, wanted = (margins_of(Loops.of(gains, Plants.members(each, points[:1]))) for each in (family, same))
    assert found == wanted


def test_whether_a_plant_is_strictly_proper_is_decided_by_the_orders_of_terms_that_are_there() -> None:
    bottom = [(EXACT(1.0), 0.5), (EXACT(1.0), 0.0)]
    assert FractionalFamily.of([(EXACT(1.0), 0.4)], bottom, EXACT(0.0)).is_strictly_proper
    assert not FractionalFamily.of([(BETWEEN(0.0, 1.0), 0.5)], bottom, EXACT(0.0)).is_strictly_proper
    assert FractionalFamily.of([(EXACT(0.0), 0.5), (EXACT(1.0), 0.0)], bottom, EXACT(0.0)).is_strictly_proper


@pytest.mark.parametrize(
    ("top", "bottom", "complaint"),
    [
        ((0.0,), (0.5, 0.5), "fall"),
        ((1.0,), (0.5,), "proper"),
        ((-0.5,), (0.5,), "outside"),
        ((0.0,), (MOST_ORDER + 0.1,), "outside"),
        ((), (0.5,), "terms"),
    ],
)
def test_orders_that_make_no_plant_are_refused(
    top: tuple[float, ...], bottom: tuple[float, ...], complaint: str
) -> None:
    with pytest.raises(DomainError, match=complaint):
        Orders(top, bottom)


def test_a_plant_without_a_numerator_or_without_orders_is_refused() -> None:
    with pytest.raises(DomainError, match="numerator"):
        FractionalPlant((0.0,), (1.0, 1.0), 0.0, Orders((0.0,), (0.5, 0.0)))
    with pytest.raises(DomainError, match="order"):
        FractionalPlant((1.0,), (1.0, 1.0), 0.0, Orders((0.0,), (0.5,)))
    with pytest.raises(DomainError, match="negative"):
        FractionalPlant((1.0,), (1.0, 1.0), -1.0, Orders((0.0,), (0.5, 0.0)))

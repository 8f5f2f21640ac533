"""Families by named parameters: linked coefficients over the parameters' box."""

from __future__ import annotations

import numpy as np
import pytest
from cases.parametric_plants import RANGES, family_of

from fopi_tune.core.parametric.family import EXPRESSIONS, ParametricFamily
from fopi_tune.core.plant import JointFamily, Uncertain
from fopi_tune.errors import DomainError


def benchmark() -> ParametricFamily:
    return family_of(RANGES, ["k"], [[1, "a"], [1, "b"]])


def test_a_member_is_the_plant_of_its_parameters() -> None:
    plant = benchmark().member(np.array([3.0, 21.0, 2.0]))
    assert (plant.numerator, plant.denominator) == ((2.0,), (1.0, 24.0, 63.0))
    assert benchmark().uncertain_names == ("a", "b", "k")
    assert benchmark().describe(np.array([3.0, 21.0, 2.0])) == {"k": 2.0, "a": 3.0, "b": 21.0}


def test_terms_and_powers_give_the_coefficients() -> None:
    family = family_of({**RANGES, "d": (0.1, 0.3)}, ["k * a", "b"], [1, "a + b - 1", "a ** 2 * b"], dead_time_s="d")
    points = np.random.default_rng(1).uniform(family.low, family.high, (7, 4))
    monomials = np.prod(points[:, None, :] ** family.powers, axis=2)
    for terms, known in zip(family.terms(), family.coefficients(points), strict=True):
        assert np.allclose(monomials @ terms, known, rtol=1e-14)


def test_the_dead_time_is_a_number_or_one_parameter() -> None:
    exact = family_of(RANGES, ["k"], [1, "a", "b"], dead_time_s=0.25)
    assert (exact.dead_time, exact.dead_time_axis) == (Uncertain.exactly(0.25), None)
    shared = family_of(RANGES, ["k"], [1, "a", "b"], dead_time_s="a")
    assert (shared.dead_time, shared.dead_time_axis) == (Uncertain.between(1.0, 5.0), 0)
    twice = shared.dead_time_s + shared.dead_time_s
    with pytest.raises(DomainError, match="dead_time_s"):
        ParametricFamily(EXPRESSIONS, shared.parameters, shared.numerator, shared.denominator, twice)


def test_a_leading_zero_of_the_numerator_leaves_a_strictly_proper_plant() -> None:
    assert family_of(RANGES, ["a - a", "k"], ["b", "a"]).is_strictly_proper
    assert not family_of(RANGES, ["a - 1", "k"], ["b", "a"]).is_strictly_proper


def test_squares_are_not_affine_and_products_of_different_parameters_are() -> None:
    assert benchmark().is_affine_in_each_number
    assert not family_of(RANGES, ["k"], ["b", "a * a"]).is_affine_in_each_number


def test_points_outside_that_have_no_plant_are_refused() -> None:
    family = family_of({"m": (1.0, 2.0), "k": (1.0, 2.0), "d": (0.0, 1.0)}, ["k"], ["m", 1], dead_time_s="d")
    # d, k, m
    rows = ([0.5, 1.5, 1.5], [3, 3, 3], [0.5, 1, -1], [0.5, 1, 0], [0.5, 0, 1], [-1, 1, 1])
    points = np.array(rows, dtype=float)
    assert family.refused(points).tolist() == [False, False, True, True, True, True]
    assert [family.why_refused(point) is None for point in points] == [True, True, False, False, False, False]
    joint = JointFamily.of({"one": family, "other": family})
    assert joint.refused(np.hstack([points[:3], points[[0, 0, 0]]])).tolist() == [False, False, True]
    assert str(joint.why_refused(np.hstack([points[0], points[5]]))).startswith("other: dead_time_s = -1.0")


def test_an_improper_plant_is_refused() -> None:
    family = benchmark()
    with pytest.raises(DomainError, match="proper"):
        ParametricFamily.of(family.parameters, family.denominator, family.numerator, family.dead_time_s)

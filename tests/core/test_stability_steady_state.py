"""The steady-state error against the response at a frequency so low that it has settled."""

from __future__ import annotations

import numpy as np
import pytest
from cases.parametric_plants import family_of
from cases.plants import transfer_function

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.core.stability import largest_steady_state_error, steady_state_errors


@pytest.mark.parametrize(
    ("gains", "numerator", "denominator", "error"),
    [
        (FoPi(2.0, 0.0, 1.0), [3.0], [1.0, 1.0], 1.0 / 7.0),
        (FoPi(2.0, 0.1, 0.7), [3.0], [1.0, 1.0], 0.0),
        (FoPi(2.0, 0.0, 1.0), [3.0], [1.0, 0.0], 0.0),
        (FoPi(2.0, 0.0, 1.0), [3.0, 0.0], [1.0, 2.0, 1.0], 1.0),
        (FoPi(-0.2, 0.0, 1.0), [3.0], [1.0, 1.0], 2.5),
    ],
)
def test_the_error_is_that_of_the_final_value(
    gains: FoPi, numerator: list[float], denominator: list[float], error: float
) -> None:
    plants = Plants.of(transfer_function(numerator, denominator).member(np.zeros(0)))
    loops = Loops.of(gains, plants)
    assert steady_state_errors(loops)[0] == pytest.approx(error, abs=1e-12)
    s = 1e-12j
    loop = (gains.kp + gains.ki * s**-gains.alpha) * np.polyval(numerator, s) / np.polyval(denominator, s)
    assert abs(1.0 / (1.0 + loop)) == pytest.approx(error, abs=1e-6)


def test_the_largest_of_a_linked_family_lies_inside_its_box() -> None:
    # |S(0)| = d/(d + 2), d = 0.5 - 0.4 (a - 1.3)^2
    family = family_of({"a": (1.0, 2.0)}, [1], [1, "0.5 - 0.4*(a - 1.3)**2"])
    found = largest_steady_state_error(family, FoPi(2.0, 0.0, 1.0))
    assert found == pytest.approx(0.5 / 2.5, abs=1e-9)
    corners = steady_state_errors(Loops.of(FoPi(2.0, 0.0, 1.0), Plants.members(family, family.corners())))
    assert corners.max() < 0.19 or found > corners.max()


def test_the_largest_of_a_family_is_that_of_a_dense_sample() -> None:
    family = PlantFamily(
        "lag",
        {
            "static_gain": Uncertain(1.0, 0.5, 2.0),
            "time_constant_s": Uncertain(2.0, 1.0, 3.0),
            "dead_time_s": Uncertain(0.0, 0.0, 0.0),
        },
    )
    found = largest_steady_state_error(family, FoPi(3.0, 0.0, 1.0))
    assert found == pytest.approx(np.max(1.0 / (1.0 + 3.0 * np.linspace(0.5, 2.0, 1001))))

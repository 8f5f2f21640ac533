"""Lists of plants: places in them, coefficients of members of any degree, and what has no box."""

from __future__ import annotations

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.families.plant_list import PlantList, PlantMember, members_of, named_place
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.parameter_table import impossible, outside_box, why_impossible
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import is_stable, largest_steady_state_error
from fopi_tune.errors import DomainError

LAG = PlantFamily(
    "lag",
    {
        "static_gain": Uncertain(1.0, 0.5, 2.0),
        "time_constant_s": Uncertain.exactly(2.0),
        "dead_time_s": Uncertain.between(0.25, 0.75),
    },
)
SECOND = PlantFamily(
    "transfer_function",
    {
        "numerator[0]": Uncertain.exactly(3.0),
        "denominator[0]": Uncertain.exactly(0.5),
        "denominator[1]": Uncertain.between(1.0, 2.0),
        "denominator[2]": Uncertain.exactly(1.0),
        "dead_time_s": Uncertain.exactly(0.0),
    },
)
BOTH = PlantList.of([PlantMember("slow", LAG), PlantMember("plant 2", SECOND, 2.0)])
#: of both members, in no order
PLACES = np.vstack([
    BOTH.place(1, np.array([[1.0], [2.0]])), BOTH.place(0, np.array([[0.5, 0.5], [2.0, 0.25]])),
    BOTH.place(1, np.array([[1.5]])),
])  # fmt: skip
GAINS = FoPi(0.6, 0.4, 0.9)


def alone(place: np.ndarray) -> Plants:
    """The plant at a place of the list, by its own family."""
    return Plants.of(BOTH.member(place))


def test_the_nominal_plant_is_that_of_the_first_member() -> None:
    assert BOTH.member(BOTH.nominal_point) == LAG.member(LAG.nominal_point)
    assert named_place(BOTH, BOTH.nominal_point) == "slow"


def test_members_of_any_degree_are_in_one_batch_of_plants_as_they_are_alone() -> None:
    batch = Plants.members(BOTH, PLACES)
    omega = np.array([0.01, 0.3, 4.0, 60.0])
    for row, place in enumerate(PLACES):
        expected = alone(place)
        rows = np.zeros(len(omega), dtype=np.intp)
        same = batch.response(rows + row, omega) * np.exp(-1j * omega * batch.dead_time_s[row])
        delayed = np.exp(-1j * omega * expected.dead_time_s[0])
        np.testing.assert_allclose(same, expected.response(rows, omega) * delayed, rtol=1e-14)
        u = np.log(omega)
        ours = Loops.of(GAINS, batch).log_response(rows + row, u)
        np.testing.assert_allclose(ours, Loops.of(GAINS, expected).log_response(rows, u), rtol=1e-12)


def test_members_of_any_degree_are_sampled_as_they_are_alone() -> None:
    implementation = Implementation(Sections(0.1, 0.6, (1.0,), (0.04,)), 0.3)
    batch = SampledLoops.implemented(GAINS, implementation, Plants.members(BOTH, PLACES))
    u = np.log(np.tan(0.05 * np.array([0.01, 0.3, 4.0, 30.0])))
    for row, place in enumerate(PLACES):
        own = SampledLoops.implemented(GAINS, implementation, alone(place))
        rows = np.zeros(len(u), dtype=np.intp)
        np.testing.assert_allclose(batch.log_response(rows + row, u), own.log_response(rows, u), rtol=1e-12)
    np.testing.assert_array_equal(
        is_stable(batch), [is_stable(SampledLoops.implemented(GAINS, implementation, alone(p)))[0] for p in PLACES]
    )


def test_a_place_is_described_by_its_own_members_numbers() -> None:
    assert BOTH.describe(PLACES[0]) == {"denominator[1]": 1.0}
    assert BOTH.describe(PLACES[2]) == {"static_gain": 0.5, "dead_time_s": 0.5}
    assert [named_place(BOTH, place) for place in PLACES] == ["plant 2", "plant 2", "slow", "slow", "plant 2"]
    assert named_place(LAG, LAG.nominal_point) == ""
    assert [member.name for member in members_of(LAG)] == [""]


def test_places_outside_of_a_members_box_are_told() -> None:
    outside = np.vstack([BOTH.place(0, np.array([[3.0, 0.5]])), BOTH.place(1, np.array([[2.5]])), PLACES[:1]])
    np.testing.assert_array_equal(outside_box(outside, BOTH), [True, True, False])
    no_plant = BOTH.place(0, np.array([[0.0, 0.5], [1.0, -0.5]]))
    np.testing.assert_array_equal(impossible(np.vstack([no_plant, PLACES]), BOTH), [True, True] + [False] * 5)
    assert "dead_time_s = -0.5" in str(why_impossible(no_plant[1], BOTH))
    assert why_impossible(PLACES[0], BOTH) is None


def test_corners_are_those_of_every_member_the_nominal_plant_first() -> None:
    corners = BOTH.corners()
    np.testing.assert_array_equal(corners[0], BOTH.nominal_point)
    assert [int((corners[:, 0] == k).sum()) for k in (0, 1)] == [5, 3]


def test_the_steady_state_error_is_the_largest_of_any_member() -> None:
    gains = FoPi(0.8, 0.0, 1.0)
    assert largest_steady_state_error(BOTH, gains) == pytest.approx(1.0 / (1.0 + 0.8 * 0.5), rel=1e-12)
    turned = PlantList.of(BOTH.members[::-1])
    assert largest_steady_state_error(turned, gains) == largest_steady_state_error(BOTH, gains)


def test_a_list_has_no_box_and_says_so() -> None:
    for ask in (
        lambda: BOTH.low, lambda: BOTH.high, lambda: BOTH.uncertain_names, lambda: BOTH.assemble({}),
        lambda: BOTH.problem("static_gain", Uncertain.exactly(1.0)), lambda: BOTH.dead_time_axis,
    ):  # fmt: skip
        with pytest.raises(DomainError, match="no common box"):
            ask()
    assert (BOTH.dead_time.min, BOTH.dead_time.max) == (0.0, 0.75)


@pytest.mark.parametrize("members", [[], [PlantMember("a", LAG), PlantMember("a", SECOND)]])
def test_a_list_needs_members_with_names_of_their_own(members: list[PlantMember]) -> None:
    with pytest.raises(DomainError, match="a name of its own"):
        PlantList.of(members)


def test_one_plant_is_a_list_of_one_without_uncertain_numbers() -> None:
    exact = PlantFamily("lag", {**LAG.parameters, "static_gain": Uncertain.exactly(1.0)})
    fixed = PlantFamily("lag", {**exact.parameters, "dead_time_s": Uncertain.exactly(0.5)})
    assert PlantList.of([PlantMember("a", fixed)]).has_one_plant
    assert not PlantList.of([PlantMember("a", exact)]).has_one_plant
    assert not PlantList.of([PlantMember("a", fixed), PlantMember("b", fixed)]).has_one_plant

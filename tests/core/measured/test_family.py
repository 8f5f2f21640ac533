"""Families of measured responses: members, standard deviations, and what they refuse."""

from __future__ import annotations

import numpy as np
import pytest
from cases.measured import LAG, TWO, curve

from fopi_tune.core.families.plant_list import named_place
from fopi_tune.core.loops import Plants
from fopi_tune.core.measured.family import MeasuredFamily, MeasuredMember, members_within
from fopi_tune.errors import DomainError


def test_a_standard_deviation_makes_eight_members_two_sigma_away() -> None:
    plain = curve(LAG, 0.1, 10.0, 41)
    gain, phase = np.linspace(0.01, 0.05, 41), np.full(41, 0.02)
    members = members_within("a.csv", plain, gain, phase)
    assert len(members) == 9
    assert members[0].name == "a.csv"
    assert members[1].name == "a.csv 2 sigma +gain"
    assert members[6].name == "a.csv 2 sigma -gain -phase"
    away = [
        ((each.table.log_gain - plain.log_gain) / gain) ** 2 + ((each.table.phase_rad - plain.phase_rad) / phase) ** 2
        for each in members[1:]
    ]
    np.testing.assert_allclose(away, 4.0, rtol=1e-9)
    np.testing.assert_allclose(sum(each.table.log_gain for each in members), 9.0 * plain.log_gain, atol=1e-12)


def test_the_band_is_what_all_members_have() -> None:
    members = [MeasuredMember.of("a", curve(LAG, 0.1, 10.0, 41)), MeasuredMember.of("b", curve(TWO, 0.3, 30.0, 41))]
    family = MeasuredFamily.of(members, 0)
    assert family.band_rad_s == pytest.approx((0.3, 10.0))
    assert not family.has_one_plant
    assert named_place(family, np.array([1.0])) == "b"
    assert family.interpolation_error.phase_deg == max(m.table.interpolation_error.phase_deg for m in members)


def test_members_without_a_common_band_are_refused() -> None:
    members = [MeasuredMember.of("a", curve(LAG, 0.1, 1.0, 41)), MeasuredMember.of("b", curve(TWO, 2.0, 30.0, 41))]
    with pytest.raises(DomainError, match="no band of frequencies in common"):
        MeasuredFamily.of(members, 0)
    with pytest.raises(DomainError, match="at least one"):
        MeasuredFamily.of([], 0)


def test_equal_numbers_have_equal_digests_and_others_another() -> None:
    assert MeasuredMember.of("a", curve(LAG)) == MeasuredMember.of("a", curve(LAG))
    assert MeasuredMember.of("a", curve(LAG)) != MeasuredMember.of("a", curve(TWO))


def test_what_needs_a_transfer_function_is_refused() -> None:
    family = MeasuredFamily.of([MeasuredMember.of("", curve(LAG))], 0)
    for asked in (
        lambda: Plants.members(family, family.corners()), lambda: family.member(family.nominal_point),
        lambda: family.assemble({}), lambda: family.problem("gain", family.dead_time),
    ):  # fmt: skip
        with pytest.raises(DomainError, match="has no transfer function"):
            asked()

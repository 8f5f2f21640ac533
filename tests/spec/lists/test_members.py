"""The specs of a list's members: one family each, what is about the nominal plant with the first alone."""

from __future__ import annotations

import pytest
from cases.plant_lists import mismatch

from fopi_tune.core.families.plant_list import members_of
from fopi_tune.errors import DomainError
from fopi_tune.quantities.objectives import default_horizon_s
from fopi_tune.spec import parse_spec
from fopi_tune.spec.lists.members import member_specs, refuse_list


def test_what_is_about_the_nominal_plant_is_about_the_first_member() -> None:
    spec = mismatch()
    members = member_specs(spec)
    assert [each.plant for each in members] == [member.family for member in members_of(spec.plant)]
    assert [[r.quantity for r in each.requirements] for each in members] == [
        ["sensitivity_db", "phase_margin_deg"], ["sensitivity_db"], ["sensitivity_db"],
    ]  # fmt: skip
    assert all(each.nominal_family == members[0].plant for each in members)


def test_all_members_have_the_time_of_the_lists_nominal_plant() -> None:
    spec = mismatch()
    horizons = [each.objective.horizon_s for each in member_specs(spec) if each.objective is not None]
    # ten times the first plant's time constant and dead time
    assert horizons == [pytest.approx(24.0, rel=1e-12)] * 3
    assert default_horizon_s(spec.plant) == pytest.approx(24.0, rel=1e-12)


def test_a_spec_of_one_plant_is_its_own_member() -> None:
    spec = parse_spec("schema: 1\nname: a\nplant: {model: lag, static_gain: 1, time_constant_s: 2}\n"
                      "objective: {maximize: ki}\n")  # fmt: skip
    assert member_specs(spec) == (spec,)
    refuse_list(spec, "the proof of the optimum")


def test_what_knows_one_plant_alone_refuses_a_list_by_name() -> None:
    with pytest.raises(DomainError, match="the proof of the optimum is for one plant in this version, not for a list"):
        refuse_list(mismatch(), "the proof of the optimum")

"""The plants that figures draw of a list: every member's grid as a band, lines that are named, no common slider."""

from __future__ import annotations

import json

import numpy as np
import pytest
from cases.plant_lists import MIXED_GAINS, mixed

import fopi_tune as ft
from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.errors import DomainError
from fopi_tune.report.comparison_page import comparison_files
from fopi_tune.report.documents import ResultDocuments, documents_of
from fopi_tune.report.figures.frequency import margins_along
from fopi_tune.report.figures.members import Members, members_of
from fopi_tune.report.figures.slider import slider_of
from fopi_tune.report.html import report_files
from fopi_tune.results.design import Design

pytestmark = pytest.mark.usefixtures("plain_figures")


@pytest.fixture(scope="module")
def design() -> Design:
    gains = f"controller: {{kp: {MIXED_GAINS.kp}, ki: {MIXED_GAINS.ki}, alpha: {MIXED_GAINS.alpha}}}\n"
    return ft.tune(mixed(gains), proof=False)


@pytest.fixture(scope="module")
def documents(design: Design) -> ResultDocuments:
    return documents_of(design.spec, json.loads(json.dumps(design.to_dict())))


@pytest.fixture(scope="module")
def members(documents: ResultDocuments) -> Members:
    found = members_of(documents)
    assert found is not None
    return found


def test_lines_are_the_nominal_plant_the_worst_ones_and_other_members(members: Members) -> None:
    labels = [member.label for member in members.named]
    assert labels[0] == "nominal: lag"
    assert any(label.startswith("worst: ") for label in labels)
    assert {label.split(": ")[-1] for label in labels[1:]} | {labels[0]} > {"exact"}
    assert len(members.named_loops) == len(labels)


def test_the_band_has_the_plants_of_every_member(members: Members) -> None:
    plants = members.documents.spec.plant
    assert isinstance(plants, PlantList)
    # grids of one, no and two uncertain numbers, each with its nominal plant
    assert len(members.family_loops) == 65 + 1 + 1 + 17 * 17 + 1
    largest = np.exp(-np.log(np.abs(1.0 + np.exp(members.family_log_loop)))).max()
    stated = members.documents.requirements[0].reported["achieved"]
    # the figure's frequencies miss a peak by little
    assert 20.0 * np.log10(largest) == pytest.approx(stated, abs=0.02)


def test_a_list_has_no_number_that_a_figure_goes_along(members: Members) -> None:
    assert slider_of(members) is None
    assert margins_along(members) is None


def test_the_page_names_the_member_at_worst_plants(documents: ResultDocuments) -> None:
    page = report_files(documents)["report.html"]
    assert isinstance(page, str)
    worst = documents.requirements[0].reported["worst"]["member"]
    assert f"for {worst}" in page


def test_a_comparison_tells_every_plant_of_a_list(documents: ResultDocuments) -> None:
    page = comparison_files([("one", documents), ("other", documents)])["compare.html"]
    assert isinstance(page, str)
    assert "exact: transfer_function" in page
    assert "linked: expressions" in page


@pytest.mark.parametrize("worst", [{"member": "truck"}, {"member": "exact"}, {"plant": {"a": 5.0, "k": 1.0}}])
def test_a_worst_plant_that_is_none_of_the_list_is_refused(design: Design, worst: dict[str, object]) -> None:
    document = json.loads(json.dumps(design.to_dict()))
    linked = {"omega_rad_s": 1.0, "plant": {"a": 0.9, "k": 1.0}, "member": "linked"}
    document["requirements"][0]["worst"] = linked
    documents_of(design.spec, document)
    document["requirements"][0]["worst"] = linked | worst
    with pytest.raises(DomainError, match="no plant"):
        documents_of(design.spec, document)

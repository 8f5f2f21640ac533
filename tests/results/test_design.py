"""Results: strict JSON, objects of python-control, frozen, and the names a library user sees."""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys
from typing import Any

import pytest
from cases import plants
from cases.project import CONTINUOUS, ROOT
from cases.shipped_designs import design_of

import fopi_tune as ft
from fopi_tune.report.text.design import design_text, requirement_phrase, scope_phrase
from fopi_tune.results.requirement_reports import RequirementReport
from fopi_tune.results.status import Relaxation
from fopi_tune.spec.model import Relation, Requirement, Scope


@pytest.fixture(scope="module")
def brake() -> ft.Design:
    return design_of("brake")


def refuse(word: str) -> None:
    raise AssertionError(f"{word} is no JSON")


def strict(document: dict[str, Any]) -> dict[str, Any]:
    return json.loads(json.dumps(document, allow_nan=False), parse_constant=refuse)


def test_a_design_is_strict_json_and_says_why_a_number_is_missing(brake: ft.Design) -> None:
    document = strict(brake.to_dict())
    margin = next(r for r in document["requirements"] if r["name"] == "gain_margin_db")
    assert (margin["achieved"], margin["outcome"], margin["met"]) == (None, "infinite", True)
    assert document["requirements"][4]["worst"] == {
        "omega_rad_s": pytest.approx(0.02),
        "plant": {"time_constant_s": pytest.approx(3.1)},
    }
    assert document["requirements"][4]["to_rad_s"] == 0.02
    assert document["stamp"]["versions"]["fopi-tune"] == ft.__version__
    assert document["stamp"]["spec_sha256"] == brake.spec.sha256


def test_a_design_without_gains_is_strict_json_and_readable(brake: ft.Design) -> None:
    design = dataclasses.replace(
        brake,
        status=ft.Status.INFEASIBLE,
        gains=None,
        objective=None,
        gap=None,
        requirements=tuple(RequirementReport(r.requirement, None, None) for r in brake.requirements),
        stability=None,
        nominal=None,
        certificate=None,
        clash=(Relaxation(0, None, None),),
        message="there is a formula",
    )
    document = strict(design.to_dict())
    assert (document["gains"], document["stability"], document["nominal"]) == (None, None, None)
    assert document["requirements"][0]["met"] is False
    assert document["clash"] == [
        {"requirement": 0, "name": "crossover_rad_s", "relation": "equals", "give": None, "new_limit": None}
    ]
    assert design_text(design).plain == (
        "brake: infeasible. No gains were found that meet all requirements.\n"
        "Why: there is a formula.\n\nThese clash:\n  crossover_rad_s = 0.3 (nominal plant)"
    )


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, None])
def test_no_number_that_is_none_reaches_the_json(brake: ft.Design, number: float | None) -> None:
    result = brake.requirements[0].result
    assert result is not None
    report = RequirementReport(brake.requirements[0].requirement, dataclasses.replace(result, score=number), number)
    design = dataclasses.replace(
        brake, objective=number, requirements=(report,), clash=(Relaxation(0, number, number),)
    )
    document = strict(design.to_dict())
    assert document["objective"] is None
    assert document["requirements"][0]["multiplier"] is None
    assert document["requirements"][0]["score"] is None
    assert document["clash"][0]["give"] is None


def test_a_check_is_strict_json_shaped_as_a_design(brake: ft.Design) -> None:
    check = ft.prove(CONTINUOUS / "brake.yaml", plants.PUBLISHED_BRAKE)
    document = strict(check.to_dict())
    assert document["status"] == "violated"
    assert document["tolerance"] == 1e-6
    assert document.keys() - {"tolerance"} < brake.to_dict().keys()


def test_equal_specs_give_equal_json(brake: ft.Design) -> None:
    assert ft.tune(CONTINUOUS / "brake.yaml").to_dict() == brake.to_dict()


def test_results_are_frozen(brake: ft.Design) -> None:
    check = ft.prove(brake.spec, plants.ROBUST_BRAKE)
    assert brake.stability is not None
    for thing in (brake, brake.gains, brake.requirements[0], brake.stability, brake.stamp, check, check.verification):
        assert dataclasses.is_dataclass(thing)
        field = dataclasses.fields(thing)[0].name
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(thing, field, None)


@pytest.mark.parametrize(
    ("relation", "limits", "band", "scope", "expected"),
    [
        (Relation.EQUALS, (0.3,), (0.0, math.inf), Scope.NOMINAL, ("x = 0.3", "nominal plant")),
        (Relation.AT_LEAST, (12.04,), (0.0, 0.02), Scope.FAMILY, ("x >= 12.04", "family, up to 0.02 rad/s")),
        (Relation.AT_MOST, (-3.0,), (5.0, math.inf), Scope.FAMILY, ("x <= -3", "family, from 5 rad/s on")),
        (Relation.BETWEEN, (1.0, 2.5), (1.0, 5.0), Scope.FAMILY, ("x in [1, 2.5]", "family, from 1 to 5 rad/s")),
        (Relation.AT_MOST, (1.0,), (2.0, 2.0), Scope.NOMINAL, ("x <= 1", "nominal plant, at 2 rad/s")),
    ],
)
def test_a_requirement_reads_as_a_formula(
    relation: Relation, limits: tuple[float, ...], band: tuple[float, float], scope: Scope, expected: tuple[str, str]
) -> None:
    requirement = Requirement("x", relation, limits, scope, *band)
    phrases = (requirement_phrase(requirement), scope_phrase(requirement).replace("\N{NO-BREAK SPACE}", " "))
    assert phrases == expected


def test_a_limit_that_is_just_missed_is_not_printed_as_reached(brake: ft.Design) -> None:
    spec = dataclasses.replace(brake.spec, requirements=brake.spec.requirements[2:3], objective=None)
    found = ft.prove(brake.spec, plants.ROBUST_BRAKE).verification.requirements[2]
    assert found.achieved is not None
    limit = round(found.achieved, 3) + 1e-3
    missed = dataclasses.replace(spec.requirements[0], limits=(limit,))
    design = ft.prove(dataclasses.replace(spec, requirements=(missed,)), plants.ROBUST_BRAKE)
    report = RequirementReport(missed, design.verification.requirements[0], None)
    text = design_text(dataclasses.replace(brake, requirements=(report,))).plain
    row = next(line for line in text.splitlines() if line.startswith("violated"))
    assert float(row.split()[4]) != limit
    assert float(row.split()[5]) > 1.0


def test_public_names_exist_and_importing_the_package_loads_nothing_heavy() -> None:
    assert all(hasattr(ft, name) for name in ft.__all__)
    assert set(ft.__all__) <= set(dir(ft))
    with pytest.raises(AttributeError, match="no attribute 'tunes'"):
        _ = ft.tunes  # pyright: ignore[reportAttributeAccessIssue]
    heavy = ("numpy", "casadi", "matplotlib", "scipy", "control", "rich", "ruamel")
    program = f"import fopi_tune, sys; print([m for m in {heavy!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "[]\n"

"""The design against a reference optimiser that shares nothing with it (brute_force.py), on shipped and unseen specs.

By default tuning is compared with stored results of the reference (design_references.py); `-m long` recomputes them.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
from cases.design_cases import CASES, INFEASIBLE, SLOW, SOLVED, UNBOUNDED, Case
from cases.design_references import REFERENCES
from cases.project import CONTINUOUS
from oracles.brute_force import brute_force
from oracles.brute_loops import Evaluation, Gains, Loops

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.spec.model import Objective, Sense

SPECS = sorted(CONTINUOUS.glob("*.yaml"))
#: the issue's bar on the objective, relative
OPTIMAL = 1e-4
#: natural units; the design keeps 1e-6, and these grids see less than a tenth of that between their points
MET = 1e-5


def chosen(cases: list[Case]) -> list:
    """Cases as parameters, those that take long only with `-m long`."""
    return [pytest.param(case, id=case.name, marks=pytest.mark.long if case.name in SLOW else ()) for case in cases]


@cache
def tuned(name: str) -> ft.Design:
    """The design of a case; several tests look at some of them, none at a proof."""
    return ft.tune(ft.parse_spec(next(case.text for case in CASES if case.name == name)), proof=False)


def own(gains: FoPi | None) -> Gains:
    assert gains is not None
    return Gains(gains.kp, gains.ki, gains.alpha)


def evaluated(design: ft.Design) -> Evaluation:
    return Loops(design.spec).evaluate(own(design.gains))


def minimised(objective: float | None, spec: ft.DesignSpec) -> float:
    """A design's objective as the reference counts it, the smaller the better."""
    assert objective is not None
    what: Objective | None = spec.objective
    return -objective if what is None or what.sense is Sense.MAXIMIZE else objective


def no_worse(found: float, reference: float) -> bool:
    # An objective of 0 (a peak of 0 dB) has no relative distance: 1e-6 of its unit is nothing to anybody.
    return found <= reference + OPTIMAL * abs(reference) + 1e-6


def check_solved(design: ft.Design, reference: float | None) -> None:
    assert design.status is ft.Status.SOLVED, design.message
    seen = evaluated(design)
    assert seen.unstable == 0
    assert seen.violation <= MET
    if reference is None:
        return
    objective = minimised(design.objective, design.spec)
    assert objective == pytest.approx(float(seen.objective.max()), rel=1e-5, abs=1e-5)  # the family's grid is finite
    assert no_worse(objective, reference), f"{objective} against the reference's {reference}"


@pytest.mark.thinned(slow=["lag_gain", "second_order"])
@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.stem)
def test_a_shipped_spec_is_solved_to_the_references_optimum(path: Path) -> None:
    check_solved(ft.tune(path, proof=False), REFERENCES[f"spec:{path.stem}"])


@pytest.mark.thinned(5)
@pytest.mark.parametrize("case", chosen(SOLVED))
def test_an_unseen_spec_is_solved_to_the_references_optimum(case: Case) -> None:
    check_solved(tuned(case.name), case.objective)


@pytest.mark.thinned(6, slow=["no_iso"])
@pytest.mark.parametrize("case", chosen(INFEASIBLE))
def test_an_infeasible_spec_says_which_requirements_clash(case: Case) -> None:
    design = tuned(case.name)
    assert design.status is ft.Status.INFEASIBLE, design.message
    assert design.message
    assert {give.requirement for give in design.clash} == case.clash


@pytest.mark.thinned(2)
@pytest.mark.parametrize("case", chosen(UNBOUNDED))
def test_an_unbounded_spec_is_called_so(case: Case) -> None:
    assert tuned(case.name).status is ft.Status.UNBOUNDED


@pytest.mark.parametrize("unit", ["hours", "microseconds"])
def test_another_unit_of_time_gives_the_same_design(unit: str) -> None:
    seconds, other = tuned("twin_seconds"), tuned(f"twin_{unit}")
    time = {"hours": 2.0e4, "microseconds": 1.0e-6}[unit]
    a, b = own(seconds.gains), own(other.gains)
    # Flat directions of an objective leave the gains freer than the objective itself.
    assert (b.kp, b.ki * time**b.alpha, b.alpha) == pytest.approx((a.kp, a.ki, a.alpha), rel=1e-6, abs=1e-6)
    assert other.objective == pytest.approx(seconds.objective, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "gain"), [pytest.param("gain_tiny", 1e-6, marks=pytest.mark.long), ("gain_huge", 1e6)]
)
def test_another_unit_of_the_plants_gain_gives_the_same_design(name: str, gain: float) -> None:
    one, other = tuned("gain_one"), tuned(name)
    assert one.objective is not None
    assert other.objective is not None
    assert other.objective * gain == pytest.approx(one.objective, rel=1e-5)
    a, b = own(one.gains), own(other.gains)
    # The objective is flat at its best: 1e-5 of it is a few 1e-3 of the gains.
    assert (b.kp * gain, b.ki * gain, b.alpha) == pytest.approx((a.kp, a.ki, a.alpha), rel=5e-3)


# --- the reference itself ------------------------------------------------------------------------------------------


@pytest.mark.thinned(slow=["brake"])
@pytest.mark.parametrize("name", ["throttle", "brake"])
def test_the_stored_references_of_closed_form_specs_are_what_a_scan_of_alpha_finds(name: str) -> None:
    spec = ft.load_spec(next(path for path in SPECS if path.stem == name))
    best = brute_force(spec, scan=60)
    assert best.feasible
    assert best.objective == pytest.approx(REFERENCES[f"spec:{name}"], rel=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("name", REFERENCES)
def test_brute_force_finds_nothing_better_than_a_stored_reference(name: str) -> None:
    best = brute_force(named(name), scan=250)
    assert best.feasible
    assert no_worse(REFERENCES[name], best.objective)


@pytest.mark.long
@pytest.mark.parametrize("case", INFEASIBLE, ids=lambda case: case.name)
def test_brute_force_finds_no_gains_for_an_infeasible_spec(case: Case) -> None:
    assert (
        brute_force(ft.parse_spec(case.text), scan=250).violation > 1e-3
    )  # neper or radian; no case is that close to feasible


def named(name: str) -> ft.DesignSpec:
    if name.startswith("spec:"):
        return ft.load_spec(next(path for path in SPECS if path.stem == name.removeprefix("spec:")))
    return ft.parse_spec(next(case.text for case in CASES if case.name == name))

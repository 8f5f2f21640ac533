"""Bounds of what gains can do on samples: of the shipped specs, of infeasible ones, against gains that are drawn."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from cases.optimum_cases import FAMILIES, OBJECTIVES
from cases.plants import spec_of
from cases.project import ROOT

import fopi_tune as ft
from fopi_tune.core.controller import FoPi, Pid
from fopi_tune.core.terms.digital_spec import DigitalSpec
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.errors import DomainError
from fopi_tune.optimum import Optimum, OptimumStatus, certify_optimum, recheck_optimum, to_document
from fopi_tune.optimum.certify import verified
from fopi_tune.optimum.pruning.conditions import is_maximized, kind_of
from fopi_tune.optimum.results import relative_gap
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import ControllerSpec, DesignSpec, GainRange, Relation, Requirement

RANGES = ControllerSpec(GainRange(0.0, 8.0), GainRange(0.0, 8.0), GainRange(0.4, 1.4))
DIGITAL = DigitalSpec(0.1, "modified_oustaloup", 5, (1e-3, 1e3), delay_samples=0.5, design="sampled")
PEAK = Requirement("sensitivity_db", Relation.AT_MOST, (5.0,))


def on_samples(family: str, objective: int, *limits: Requirement, digital: DigitalSpec = DIGITAL) -> DesignSpec:
    spec = spec_of(FAMILIES[family], *(limits or (PEAK,)), objective=OBJECTIVES[objective])
    return replace(spec, controller=RANGES, digital=digital)


def design_of(spec: DesignSpec) -> FoPi:
    gains = ft.tune(spec, proof=False).gains
    assert gains is not None
    return gains


def document_of(found: Optimum) -> dict[str, object]:
    document = json.loads(json.dumps(to_document(found, {})))
    assert isinstance(document, dict)
    return document


# -- what is shown -----------------------------------------------------------------------------------------------------

SLOW = ["throttle", "brake", "brake_delay", "second_order", "lag_gain_and_delay"]


@pytest.mark.parametrize("name", ["pi_baseline", *(pytest.param(name, marks=pytest.mark.long) for name in SLOW)])
def test_shipped_specs_are_certified_to_a_thousandth_and_the_file_holds(name: str) -> None:
    spec = load_spec(ROOT / "specs" / f"{name}.yaml")
    found = certify_optimum(spec, design_of(spec), gap=1e-3, time_limit_s=500.0)
    assert found.status is OptimumStatus.CERTIFIED
    assert found.gap is not None
    assert found.gap <= 1e-3
    assert recheck_optimum(document_of(found), spec).is_sound
    assert spec.digital is not None
    for other in (
        replace(spec.digital, sample_time_s=1.1 * spec.digital.sample_time_s),
        replace(spec.digital, delay_samples=spec.digital.delay_samples + 0.5),
        replace(spec.digital, design="continuous"),
    ):
        assert not recheck_optimum(document_of(found), replace(spec, digital=other)).is_sound


def test_a_spec_that_no_gains_meet_on_samples_is_proved_infeasible() -> None:
    # where |S| is small |C S| is next to 1/|P|, which is 1
    spec = on_samples(
        "lag with dead time", 1, Requirement("control_sensitivity_db", Relation.AT_MOST, (-3.0,)),
        Requirement("sensitivity_db", Relation.AT_MOST, (-12.0,), to_rad_s=0.02), PEAK,
    )  # fmt: skip
    found = certify_optimum(spec, None, time_limit_s=300.0)
    assert found.status is OptimumStatus.INFEASIBLE
    assert recheck_optimum(document_of(found), spec).is_sound
    looser = replace(spec, requirements=spec.requirements[1:])
    assert not recheck_optimum(document_of(found), looser).is_sound


# -- what is never shown -----------------------------------------------------------------------------------------------

SLOW_BOUNDS = [("lag", 6), ("lag with dead time", 1), ("lag with dead time", 2), ("second order", 1)]


@pytest.mark.parametrize(
    ("family", "objective", "order"),
    [
        ("direct path", 1, 1),
        *(
            pytest.param(family, objective, order, marks=pytest.mark.long)
            for family, objective in SLOW_BOUNDS
            for order in (None, 1)
        ),
    ],
)
def test_no_gains_that_meet_the_spec_beat_the_bound(family: str, objective: int, order: int | None) -> None:
    limits = [PEAK, Requirement("phase_margin_deg", Relation.AT_LEAST, (45.0,))]
    if objective == 6:
        limits.append(Requirement("sensitivity_db", Relation.AT_MOST, (-6.0,), to_rad_s=0.02))
    spec = on_samples(family, objective, *limits)
    if order is not None:
        spec = replace(spec, controller=replace(RANGES, measurement_filter=MeasurementFilter(order, 0.3)))
    best = design_of(spec)
    found = certify_optimum(spec, best, gap=0.02, time_limit_s=300.0)
    assert found.status is OptimumStatus.CERTIFIED
    assert found.bound is not None
    pick, met = np.random.default_rng(8), 0
    for _ in range(80):
        kp, ki = (gain * np.exp(0.15 * pick.normal()) for gain in (best.kp, best.ki))
        alpha = float(np.clip(best.alpha + 0.1 * pick.normal(), 0.4, 1.4))
        gains = FoPi(float(min(kp, 8.0)), float(min(ki, 8.0)), alpha, measurement_filter=best.measurement_filter)
        value = verified(spec, gains)
        if value.all_met and value.objective is not None:
            met += 1
            beats = value.objective > found.bound if is_maximized(spec) else value.objective < found.bound
            assert not beats, gains
    assert met


def _worse(spec: DesignSpec, best: FoPi, pick: np.random.Generator) -> FoPi | None:
    """Gains that meet the spec, with an objective that is 1 to 3 % worse."""
    value = verified(spec, best).objective
    assert value is not None
    for _ in range(40):
        away = pick.normal(size=3) * (0.02, 0.02, 0.01) * 10.0 ** pick.uniform(-0.5, 0.5)
        try:
            gains = FoPi(
                float(best.kp * np.exp(away[0])), float(best.ki * np.exp(away[1])),
                float(np.clip(best.alpha + away[2], 0.4, 1.4)),
            )  # fmt: skip
            found = verified(spec, gains)
        except DomainError:
            continue
        if found.all_met and found.objective is not None and max(gains.kp, gains.ki) <= 8.0:
            worse = (found.objective < value) == is_maximized(spec)
            if worse and 0.01 < relative_gap(kind_of(spec), found.objective, value) < 0.03:
                return gains
    return None


@pytest.mark.parametrize("count", [1, pytest.param(24, marks=pytest.mark.long)])
def test_designs_made_worse_are_not_certified(count: int) -> None:
    pick, checked = np.random.default_rng(9), 0
    names = ["lag with dead time", "second order", "integrator with dead time", "right zero", "direct path"]
    for k in range(8 * count):
        digital = replace(DIGITAL, sample_time_s=float(pick.choice([0.05, 0.1, 0.3])))
        spec = on_samples(names[k % len(names)], (1, 2)[k % 2], digital=digital)
        best = ft.tune(spec, proof=False).gains
        worse = None if best is None else _worse(spec, best, pick)
        if worse is None:
            continue
        found = certify_optimum(spec, worse, gap=9e-3, most_boxes=300, time_limit_s=600.0)
        assert found.status is OptimumStatus.LIMIT_REACHED, (spec, worse)
        checked += 1
        if checked == count:
            break
    assert checked == count


# -- what is refused by name -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"method": "fit"}, "method: fit"),
        ({"rule": "matched"}, "rule: matched"),
        ({"prewarp": "crossover"}, "prewarp: crossover"),
    ],
)
def test_filters_that_are_no_functions_of_the_order_alone_have_no_bound(change: dict[str, str], words: str) -> None:
    spec = on_samples("lag", 1, digital=replace(DIGITAL, **change))
    found = certify_optimum(spec, FoPi(1.0, 0.5, 0.9))
    assert found.status is OptimumStatus.NO_BOUND
    assert words in found.reason


def test_a_derivative_on_samples_has_no_bound() -> None:
    pid = replace(RANGES, alpha=GainRange(1.0, 1.0), kd=GainRange(0.0, 1.0), derivative_filter_time_constant_s=0.2)
    found = certify_optimum(replace(on_samples("lag", 1), controller=pid), Pid(1.0, 0.5, 0.1, 0.2))
    assert found.status is OptimumStatus.NO_BOUND
    assert found.reason == "there is no bound for a controller with a derivative on samples (design: sampled)"


def test_requirements_without_a_condition_on_samples_are_named() -> None:
    limits = (
        PEAK, Requirement("delay_margin_s", Relation.AT_LEAST, (0.2,)),
        Requirement("crossover_rad_s", Relation.AT_MOST, (40.0,)),
    )  # fmt: skip
    spec = on_samples("lag", 6, *limits, Requirement("sensitivity_db", Relation.AT_MOST, (-6.0,), to_rad_s=0.02))
    found = certify_optimum(spec, design_of(spec), gap=0.05)
    assert found.status is OptimumStatus.CERTIFIED
    assert found.left_out == ("delay_margin_s at least 0.2", "crossover_rad_s at most 40")

"""What people hand to the public functions in Python and is none: told in one line, by this package's errors."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases.project import ROOT

import fopi_tune

#: without types, as what a type checker refuses is given on purpose
ft: Any = fopi_tune

SPEC = ft.load_spec(ROOT / "specs" / "pi_baseline.yaml")
GAINS = ft.FoPi(1.0, 0.5, 1.0)
CAR = "systems/car.yaml"


@pytest.mark.parametrize("call", [ft.prove, ft.discretize, ft.simulate, ft.validate])
@pytest.mark.parametrize(("gains", "told"), [(None, "there are no gains"), ((1, 2, 1), "is no controller")])
def test_what_are_no_gains_is_told(call: Callable[..., Any], gains: Any, told: str) -> None:
    with pytest.raises(ft.DomainError, match=told):
        call(SPEC, gains)


@pytest.mark.parametrize("name", ["brake", "brake_continuous"])
@pytest.mark.parametrize("call", [ft.prove, ft.certify_optimum])
@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_gains_that_are_all_0_are_refused_on_samples_as_in_continuous_time(
    call: Callable[..., Any], name: str, zero: float
) -> None:
    with pytest.raises(ft.DomainError, match="all gains are 0: there is no controller"):
        call(ROOT / "specs" / f"{name}.yaml", ft.FoPi(zero, zero, 1.0))


@pytest.mark.parametrize("gains", [GAINS, [GAINS], {"brake": None}, {"brake": "a"}])
@pytest.mark.parametrize("call", [ft.simulate_system, ft.discretize_system, ft.validate_system, ft.prove_system])
def test_what_are_no_gains_of_a_system_is_told(call: Callable[..., Any], gains: Any) -> None:
    with pytest.raises(ft.DomainError, match=r"no mapping of gains|no gains|no controller"):
        call(CAR, gains)


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: ft.tune(SPEC, solver="newton"), "there is no solver 'newton'; there is 'ipopt' and 'convex'"),
        (lambda: ft.tune(SPEC, start=(1, 2, 1)), "is no controller"),
        (lambda: ft.certify_optimum(SPEC, "a"), "is no controller"),
        (lambda: ft.certify_optimum(SPEC, GAINS, gap="a"), "gap = 'a' is not a number"),
        (lambda: ft.prove(SPEC, GAINS, tolerance="a"), "tolerance = 'a' is not a number"),
        (lambda: ft.validate(SPEC, GAINS, samples="10"), "samples = '10' is no whole number"),
        (lambda: ft.simulate(SPEC, GAINS, replay=1.5), "replay = 1.5 is no whole number"),
        (lambda: ft.simulate(SPEC, GAINS, plant=[1.5]), "no mapping of numbers by name"),
        (lambda: ft.simulate(SPEC, GAINS, plant={"time_constant_s": "1.5"}), "time_constant_s = '1.5' is not a number"),
        (lambda: ft.simulate_system(CAR, replay="a"), "replay = 'a' is no whole number"),
        (lambda: ft.tune(SPEC, GAINS), r"by their name: tune\(spec, start=gains\)"),
        (lambda: ft.tune(SPEC, "no"), "proof = 'no' is neither True nor False"),
        (lambda: ft.tune(SPEC, bracket=2), "bracket = 2 is neither True nor False"),
        (lambda: ft.run(SPEC, "no"), "proof = 'no' is neither True nor False"),
        (lambda: ft.discretize(SPEC, GAINS, GAINS), "proof = .* is neither True nor False"),
        (lambda: ft.simulate(SPEC, GAINS, exact="no"), "exact = 'no' is neither True nor False"),
        (lambda: ft.simulate_system(CAR, exact="no"), "exact = 'no' is neither True nor False"),
        (lambda: ft.margins(None, ft.Plant([1], [1, 1])), "there are no gains"),
        (lambda: ft.margins(GAINS, SPEC.plant), "is no plant; give one"),
    ],
)
def test_other_arguments_that_are_none_are_told(call: Callable[[], Any], told: str) -> None:
    with pytest.raises(ft.DomainError, match=told):
        call()


def test_results_of_numpys_numbers_are_written() -> None:
    gains = ft.FoPi(np.float32(1.0), np.int64(1), np.float64(1.0))
    assert json.loads(json.dumps(ft.prove(SPEC, gains).to_dict()))["gains"] == {"kp": 1.0, "ki": 1.0, "alpha": 1.0}
    drawn = ft.validate(SPEC, gains, samples=np.int64(3), seed=np.int64(1))
    assert json.loads(json.dumps(drawn.to_dict()))["drawn"]["samples"] == 3


def test_a_loaded_result_is_not_taken_for_a_design_that_has_prices(tmp_path: Path) -> None:
    ft.prove(SPEC, GAINS).save(tmp_path)
    with pytest.raises(ft.DomainError, match="StoredLoop has no multipliers"):
        ft.price(ft.load(tmp_path))


@pytest.mark.parametrize("recheck", [ft.recheck, ft.recheck_system, lambda name: ft.recheck_optimum(name, SPEC)])
def test_a_path_in_place_of_a_certificate_is_told(recheck: Callable[[Any], Any]) -> None:
    for given in ("certificate.json", Path("certificate.json")):
        with pytest.raises(ft.CertificateError, match=r"is text or a path.*json.load"):
            recheck(given)

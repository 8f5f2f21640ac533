"""All stages of the shipped specs:  each is solved, proved, and its digital loop met."""

from __future__ import annotations

import pytest
from cases.project import ROOT

import fopi_tune as ft

SHIPPED = ("throttle", "brake", "pi_baseline", "brake_delay", "second_order", "lag_gain_and_delay")
#: minutes of processor time on a busy machine
SLOW = ("second_order", "lag_gain_and_delay")


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.long] if n in SLOW else []) for n in SHIPPED])
def test_a_shipped_spec_is_solved_and_proved_as_the_loop_on_samples(name: str) -> None:
    done = ft.run(ROOT / "specs" / f"{name}.yaml")
    assert done.design.status is ft.Status.SOLVED
    assert done.design.certificate is not None
    assert done.digital is not None
    assert done.digital.status == "met"
    assert done.digital.certificate is done.design.certificate


@pytest.mark.parametrize("name", ["brake", "throttle"])
def test_the_continuous_twin_differs_in_the_loop_alone(name: str) -> None:
    sampled = ft.load_spec(ROOT / "specs" / f"{name}.yaml")
    continuous = ft.load_spec(ROOT / "specs" / f"{name}_continuous.yaml")
    assert sampled.digital is not None
    assert sampled.digital.design == "sampled"
    # its gains on samples miss: it is about the loop in continuous time alone
    assert continuous.digital is None
    for part in ("plant", "controller", "objective"):
        assert getattr(sampled, part) == getattr(continuous, part)
    assert [str(r.limits) for r in sampled.requirements] == [str(r.limits) for r in continuous.requirements]

"""Verdicts of whole systems, and what is still proved where there is none."""

from __future__ import annotations

from dataclasses import replace

import pytest
from cases import switched
from cases.project import ROOT

from fopi_tune.errors import DomainError
from fopi_tune.proof.switched import SystemVerdict, prove, prove_system, recheck_system
from fopi_tune.proof.switched.documents import from_document, to_document
from fopi_tune.spec import load_system

VERDICTS = {"reset": SystemVerdict.SETTLES, "tracking": SystemVerdict.SETTLES, "held": SystemVerdict.CYCLES}


@pytest.mark.parametrize("memory", VERDICTS)
def test_the_published_gains(memory: str) -> None:
    found = switched.certificate(memory)
    assert found.verdict is VERDICTS[memory]
    assert all(loop is not None for loop in found.loops)
    assert found.verdict.advice


@pytest.mark.thinned(slow=["tracking", "held"])
@pytest.mark.parametrize("memory", VERDICTS)
def test_the_tuned_gains(memory: str) -> None:
    found = prove_system(switched.car(memory), switched.TUNED, setpoints=switched.SETPOINTS)
    assert found.verdict is VERDICTS[memory]
    assert recheck_system(found, switched.car(memory), switched.TUNED).accepted


def test_setpoints_that_cannot_be_reached_leave_it_undecided_with_what_is_proved() -> None:
    found = prove_system(switched.car("reset"), switched.GAINS, setpoints=(5, 30))
    assert found.verdict is SystemVerdict.UNDECIDED
    assert found.setpoints == (5.0, 30.0)
    assert found.settling is not None
    assert "settles on each setpoint from 5 to 25.1" in found.statements[2]
    assert found.statements[-1].startswith("Not proved: above 25.1")
    assert recheck_system(found).accepted


def test_a_system_that_the_methods_do_not_handle_is_undecided_with_a_reason() -> None:
    system = load_system(ROOT / "systems" / "switching.yaml")
    gains = {mode.name: mode.gains for mode in system.modes if mode.gains is not None}
    found = prove_system(system, gains)
    assert found.verdict in (SystemVerdict.UNDECIDED, SystemVerdict.CYCLES)
    assert found.reason.startswith("without hysteresis")
    assert recheck_system(found, system, gains).accepted


def test_a_throttle_that_may_not_settle_from_every_state_is_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prove, "prove_saturated_loop", lambda loop, sample_time_s: None)
    found = prove_system(switched.car("reset"), switched.GAINS, setpoints=switched.SETPOINTS)
    assert found.verdict is SystemVerdict.UNDECIDED
    assert found.statements[0].startswith("From every state with the brake active")
    assert "the throttle alone is not shown to settle" in found.statements[-1]
    assert recheck_system(found).accepted


@pytest.mark.parametrize("setpoints", [(5.0, 2.0), (float("nan"), 3.0), (1.0, float("inf"))])
def test_setpoints_that_are_no_range_are_refused(setpoints: tuple[float, float]) -> None:
    with pytest.raises(DomainError, match="two finite numbers"):
        prove_system(switched.CAR, switched.GAINS, setpoints=setpoints)


@pytest.mark.parametrize("limited", [(True, True), (True, False), (False, True)], ids=["both", "throttle", "brake"])
def test_a_mode_that_limits_the_rate_of_its_output_leaves_nothing_proved(limited: tuple[bool, bool]) -> None:
    modes = [
        replace(mode, spec=replace(mode.spec, digital=replace(mode.spec.digital, output_rate_per_s=0.5)))  # pyright: ignore
        if own
        else mode
        for mode, own in zip(switched.CAR.modes, limited, strict=True)
    ]
    system = replace(switched.car("reset"), modes=(modes[0], modes[1]))
    found = prove_system(system, switched.GAINS, setpoints=switched.SETPOINTS)
    assert found.settling is None
    assert found.bounded is None
    assert found.cycles == ()
    assert (
        found.reason == f"{'throttle' if limited[0] else 'brake'}: an output rate limit is not modelled in this proof"
    )
    for proof, own in zip(found.loops, limited, strict=True):
        assert proof is None or not own
    read = from_document(to_document(found))
    assert read.model == found.model
    assert recheck_system(read, system, switched.GAINS).problems == ()
    # a certificate of the system without the limit is not accepted for this one
    of_car = switched.certificate("reset")
    assert of_car.settling is not None
    assert recheck_system(of_car, system, switched.GAINS).problems != ()

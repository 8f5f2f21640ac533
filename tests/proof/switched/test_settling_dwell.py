"""Settling with a minimum dwell:  entries below the line, statements that are false, simulations, the file."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import switched
from oracles.switched_loop import run

from fopi_tune.errors import CertificateError
from fopi_tune.proof.documents import digest
from fopi_tune.proof.switched import SystemCertificate, SystemVerdict, prove_system, recheck_system
from fopi_tune.proof.switched.documents import from_document, to_document
from fopi_tune.proof.switched.model import SwitchedModel
from fopi_tune.proof.switched.settling import verify_settling
from fopi_tune.proof.switched.settling_search import prove_settling

MEMORIES = ("reset", "tracking")


@cache
def dwelling(memory: str, seconds: float) -> SystemCertificate:
    return prove_system(switched.car(memory, min_dwell_s=seconds), switched.GAINS)


@pytest.mark.thinned(slow=["tracking", "reset-4", "reset-0.9"])
@pytest.mark.parametrize("seconds", [0.4, 0.9, 4.0])
@pytest.mark.parametrize("memory", MEMORIES)
def test_no_simulation_contradicts(memory: str, seconds: float) -> None:
    found, rng = dwelling(memory, seconds), np.random.default_rng(7)
    model, proof = found.model, found.settling
    assert proof is not None
    assert found.verdict is SystemVerdict.SETTLES
    lanes, samples = 400, 2500
    setpoint = rng.uniform(*proof.setpoints, lanes)
    throttle = -np.expm1(-0.2 * 0.1746), 4.39 / 0.1746
    taus = rng.choice([1.6, 3.1], (samples, lanes))
    taus[:, ::3], taus[:, 1::3] = rng.uniform(1.6, 3.1, (samples, len(setpoint[::3]))), 1.6
    brake = -np.expm1(-0.2 / taus), 1.0
    if memory == "reset":
        memories = [rng.normal(size=(size, lanes)) * 0.5 for size in model.sizes]
        output, mode = rng.uniform(0.0, 40.0, lanes), rng.integers(0, 2, lanes)
        # in the middle of a dwell
        waits = rng.integers(0, model.min_dwell_samples, lanes)
    else:
        output = setpoint + rng.uniform(0.5, 20.0, lanes)
        memories, mode = [np.zeros((size, lanes)) for size in model.sizes], np.zeros(lanes, dtype=np.int64)
        memories[0][0], waits = output / throttle[1], np.zeros(lanes, dtype=np.int64)
    traces = run(model, setpoint, output, mode, memories, throttle, brake, waits)
    assert np.sum(traces.mode[1:] != traces.mode[:-1], axis=0).max() <= 3
    back = (traces.mode[1:] == 0) & (traces.mode[:-1] == 1)
    line, late = setpoint + model.lower, 0
    for lane in np.flatnonzero(back.any(axis=0)):
        first = 1 + int(np.flatnonzero(back[:, lane])[-1])
        driven = np.flatnonzero(traces.mode[:first, lane] == 0)
        entered = int(driven[-1]) + 1 if len(driven) else 0
        # the entries that are covered: the brake was active above the line before
        if traces.y[entered, lane] > line[lane]:
            error = setpoint[lane] - traces.y[first:, lane]
            assert error.max() <= proof.undershoot
            assert -error.min() <= proof.overshoot
            late += traces.y[first - 1, lane] < line[lane]
    # the dwell was what kept the brake, in some
    assert late > 10 or seconds < 0.5


@pytest.mark.thinned(slow=["tracking"])
@pytest.mark.parametrize("memory", MEMORIES)
def test_a_proof_of_a_shorter_dwell_is_none_of_a_longer_one(memory: str) -> None:
    proof = switched.certificate(memory).settling
    assert proof is not None
    longer = replace(switched.model(memory), min_dwell_samples=25)
    assert verify_settling(longer, proof) is None
    # with an answer that the methods give, and one sample is as none
    found = prove_settling(longer, switched.SETPOINTS)
    assert found.reason
    assert verify_settling(replace(longer, min_dwell_samples=1), proof) is not None
    named = "min_dwell_s" if memory == "tracking" else "upper limit"
    assert named in found.reason


@pytest.mark.thinned(12)
@pytest.mark.parametrize(
    ("memory", "seconds", "setpoints"),
    [
        ("reset", 0.6, (0.6, 25.1)),
        ("reset", 1.0, (0.6, 20.7)),
        ("reset", 2.0, (0.6, 13.7)),
        ("reset", 4.0, (0.6, 10.5)),
        ("tracking", 1.0, (1.2, 25.1)),
        ("tracking", 2.0, (2.6, 25.1)),
        ("tracking", 4.0, (10.3, 25.1)),
    ],
)
def test_setpoints_that_are_left_with_a_dwell(memory: str, seconds: float, setpoints: tuple[float, float]) -> None:
    """Those that the page of limits states."""
    found = dwelling(memory, seconds).settling
    assert found is not None
    assert found.setpoints == setpoints


def test_lowest_entries_are_those_of_full_braking_for_the_whole_dwell() -> None:
    """r - y at the switch, by the closed form of a lag at its limit from the line on."""
    for samples in (2, 6, 12):
        model = replace(switched.model("reset"), min_dwell_samples=samples)
        found = prove_settling(model, (6.0, 6.0)).proof
        assert found is not None
        fallen = -1.0 + (5.5 + 1.0) * np.exp(-samples * 0.2 / 1.6)
        # what follows the switch is lower still
        assert found.undershoot >= 6.0 - fallen
        assert found.undershoot < 6.0 - fallen + 4.0


def test_the_file_has_the_dwell_and_a_system_with_another_one_is_refused() -> None:
    found = dwelling("reset", 0.6)
    document = json.loads(json.dumps(to_document(found)))
    assert document["min_dwell_samples"] == 3
    assert "min_dwell_samples" not in switched.document("reset")
    assert any("at least 3 samples after a switch" in each for each in document["statements"])
    assert from_document(document) == found
    for seconds, accepted in ((0.6, True), (0.5, True), (0.0, False), (0.4, False), (0.8, False)):
        checked = recheck_system(found, switched.car("reset", min_dwell_s=seconds), switched.GAINS)
        assert checked.accepted is accepted, seconds
        assert accepted or "other controllers, plants or switching" in checked.problems[0]
    assert not recheck_system(
        switched.certificate("reset"), switched.car("reset", min_dwell_s=0.6), switched.GAINS
    ).accepted


@pytest.mark.thinned(2)
@pytest.mark.parametrize("value", [-1, 2.5, None, True, "3"])
def test_a_dwell_that_is_none_is_told(value: object) -> None:
    document = {**to_document(dwelling("reset", 0.6)), "min_dwell_samples": value}
    document["digest"] = digest(document)
    with pytest.raises(CertificateError):
        from_document(document)


def test_a_certificate_without_its_dwell_is_refused() -> None:
    document = to_document(dwelling("reset", 0.6))
    del document["min_dwell_samples"]
    with pytest.raises(CertificateError):
        from_document(document)
    document["digest"] = digest({key: value for key, value in document.items() if key != "digest"})
    with pytest.raises(CertificateError):
        from_document(document)


def test_a_model_without_a_dwell_is_the_one_of_before() -> None:
    assert SwitchedModel.of(switched.car("reset", min_dwell_s=0.0), switched.GAINS) == switched.model("reset")

"""The loop with the limits of its control: shown where that can be, told where not, and never part of the verdict."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from cases.project import ROOT

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.errors import CertificateError
from fopi_tune.pipeline.prove import prove, recheck
from fopi_tune.proof.documents import digest
from fopi_tune.proof.output_limits import prove_with_limits
from fopi_tune.results.design import Check
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import DesignSpec

GAINS = FoPi(0.44651, 0.37033, 0.83197)


def brake(limits: tuple[float, float] | None = (-1.0, 0.0), **digital: Any) -> DesignSpec:
    spec = load_spec(ROOT / "specs" / "brake.yaml")
    assert spec.digital is not None
    return replace(spec, digital=replace(spec.digital, output_limits=limits, **digital))


@functools.cache
def check() -> Check:
    """The published gains on the brake, proved once."""
    return prove(brake(), GAINS)


def test_the_brake_is_stable_with_its_limits() -> None:
    limited = check().certificate.limited
    assert limited is not None
    assert limited.proof is not None
    assert limited.reason == ""
    assert limited.statement.startswith("stable with its limits, -1 to 0: proved, for every plant, from every state")
    # the norm is halved when decay^n = 1/2
    assert limited.half_life_s is not None
    assert limited.proof.decay ** (limited.half_life_s / 0.2) == pytest.approx(0.5)
    said = check().to_dict()["proof"]["with_limits"]
    assert (said["verdict"], said["output_limits"]) == ("proved", [-1.0, 0.0])
    assert said["decay_per_sample"] == limited.proof.decay


def test_without_limits_or_samples_nothing_is_said() -> None:
    assert prove_with_limits(brake(None), implementation_of(brake(), GAINS)) is None
    assert prove_with_limits(brake(), None) is None
    plain = prove(brake(None), GAINS)
    assert plain.certificate.limited is None
    assert "with_limits" not in plain.to_dict()["proof"]
    # the verdict is the same with limits and without
    assert plain.status == check().status
    assert plain.certificate.verdict is check().certificate.verdict


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"dead_time_s": Uncertain.exactly(0.3)}, "a dead time is not modelled"),
        ({"static_gain": Uncertain.exactly(-1.0)}, "gain must be positive"),
    ],
)
def test_what_is_not_available_has_a_reason(changes: dict[str, Uncertain], words: str) -> None:
    spec = brake()
    plant = PlantFamily(spec.plant.model, {**spec.plant.parameters, **changes})
    limited = prove_with_limits(replace(spec, plant=plant), implementation_of(brake(), GAINS))
    assert limited is not None
    assert limited.proof is None
    assert words in limited.reason
    assert "not available: " in limited.statement
    assert limited.to_dict()["verdict"] == "not_available"


def test_a_computing_delay_is_in_the_proof() -> None:
    for delay, shown in ((1.0, True), (1.5, False)):
        spec = brake(delay_samples=delay)
        limited = prove_with_limits(spec, implementation_of(spec, GAINS))
        assert limited is not None
        assert (limited.proof is not None) == shown
        assert ("more than one sample" in limited.reason) != shown


def test_an_unstable_loop_has_no_proof() -> None:
    limited = prove_with_limits(brake(), implementation_of(brake(), FoPi(60.0, 10.0, 0.8)))
    assert limited is not None
    assert limited.reason == "the circle criterion, which is sufficient only, was not shown to hold"


def test_the_certificate_is_sound_and_says_it() -> None:
    found = recheck(check().certificate_document(), brake())
    assert found.problems == ()
    assert found.certificate.limited == check().certificate.limited


CHANGES: dict[str, Callable[[dict[str, Any]], None]] = {
    "decay": lambda entry: entry["decays"].update(decay=0.5),
    "multiplier": lambda entry: entry["decays"].update(multiplier=0.0),
    "matrix": lambda entry: entry["decays"]["matrix"][2].__setitem__(2, -1.0),
    "statement": lambda entry: entry.update(statement="stable"),
    "limits": lambda entry: entry.update(output_limits=[-2.0, 0.0]),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_by_somebody_who_knows_the_digest_is_refused(name: str) -> None:
    document = copy.deepcopy(check().certificate_document())
    CHANGES[name](document["with_limits"])
    document["digest"] = digest(document)
    assert recheck(document, brake()).problems != ()


@pytest.mark.parametrize("decay", [-0.5, 0.0, 1.0, 2.0])
def test_a_decay_that_is_none_is_no_certificate(decay: float) -> None:
    document = copy.deepcopy(check().certificate_document())
    document["with_limits"]["decays"]["decay"] = decay
    with pytest.raises(CertificateError, match="must be between 0 and 1"):
        recheck(document)


def test_limits_of_another_spec_are_refused() -> None:
    problems = recheck(check().certificate_document(), brake((-1.0, 0.5))).problems
    assert "with_limits: the limits are not those of the spec" in problems


def test_decay_is_slower_than_the_loop_without_limits() -> None:
    limited = check().certificate.limited
    assert limited is not None
    assert limited.proof is not None
    assert 0.0 < -math.log(limited.proof.decay) < 1.0


# -- a limit of the output's rate --------------------------------------------------------------------------------------

NOT_MODELLED = "an output rate limit is not modelled in this proof"


@pytest.mark.parametrize("limits", [(-1.0, 0.0), None], ids=["with limits", "alone"])
def test_a_rate_limit_is_never_left_out_of_a_proof(limits: tuple[float, float] | None) -> None:
    found = prove(brake(limits, output_rate_per_s=0.5), GAINS)
    limited = found.certificate.limited
    assert limited is not None
    assert limited.proof is None
    assert limited.statement == f"stable with its output rate limit: not available: {NOT_MODELLED}"
    assert found.to_dict()["proof"]["with_limits"]["most_change"] == pytest.approx(0.1)
    # the requirements are about the loop within its limits
    assert found.certificate.verdict is check().certificate.verdict
    document = found.certificate_document()
    again = recheck(document, brake(limits, output_rate_per_s=0.5))
    assert again.certificate.limited == limited
    assert again.problems == ()
    for other in (0.6, None):
        assert (
            "with_limits: the limits are not those of the spec"
            in recheck(document, brake(limits, output_rate_per_s=other)).problems
        )


def test_a_proof_without_the_rate_is_not_one_with_it() -> None:
    document = copy.deepcopy(check().certificate_document())
    problems = recheck(document, brake(output_rate_per_s=0.5)).problems
    assert "with_limits: the limits are not those of the spec" in problems
    # a rate that is written into a certificate takes its proof away
    document["with_limits"]["most_change"] = 0.1
    document["digest"] = digest(document)
    assert "with_limits: the loop is not shown to settle with its limits" in recheck(document).problems
    document["with_limits"]["most_change"] = 0.0
    document["digest"] = digest(document)
    with pytest.raises(CertificateError, match="most_change must be greater than 0"):
        recheck(document)

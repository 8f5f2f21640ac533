"""Proofs of loops with a measurement filter:  limits around the worst case, and certificates of another filter."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cases.limits_told_apart import outcomes
from cases.plants import spec_of
from cases.random_pids import pid_for, plants_of, sized, uncertain
from oracles.pid_loops import PidFamily

from fopi_tune.core.controller import FoPi, FoPid, GainRange
from fopi_tune.core.measurement_filter import MeasurementFilter
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.errors import CertificateError
from fopi_tune.pipeline.prove import recheck
from fopi_tune.proof import certify, verify
from fopi_tune.proof.certificate import Verdict
from fopi_tune.proof.documents import digest, to_document
from fopi_tune.spec.model import DesignSpec, Relation, Requirement

#: of the random numbers
SALT = 41
USED = MeasurementFilter(2, 0.1)
LAG = PlantFamily(
    "lag",
    {
        "static_gain": Uncertain.exactly(1.0),
        "time_constant_s": Uncertain.between(0.8, 1.5),
        "dead_time_s": Uncertain.exactly(0.1),
    },
)


def _family(rng: np.random.Generator) -> PidFamily:
    plants = uncertain(rng, plants_of(rng))
    pid = pid_for(rng, plants)
    used = MeasurementFilter(int(rng.integers(1, 3)), sized(rng, 0.01, 2.0))
    return PidFamily(plants, replace(pid, measurement_filter=used))


@pytest.mark.parametrize(("seeds", "least"), [(range(9), 5), pytest.param(range(9, 60), 25, marks=pytest.mark.long)])
def test_limits_around_the_worst_case_with_a_filter_are_told_apart(seeds: range, least: int) -> None:
    counted, undecided, _ = outcomes(seeds, _family, SALT)
    assert len(undecided) <= len(seeds) // 30, undecided
    assert counted["told apart"] >= least, counted


def _spec(controller: FoPi) -> DesignSpec:
    asked = [("sensitivity_db", Relation.AT_MOST, 6.0), ("control_sensitivity_db", Relation.AT_MOST, 12.0)]
    asked += [("phase_margin_deg", Relation.AT_LEAST, 30.0), ("gain_margin_db", Relation.AT_LEAST, 4.0)]
    spec = spec_of(LAG, *(Requirement(name, relation, (limit,)) for name, relation, limit in asked))
    box = replace(spec.controller, measurement_filter=controller.measurement_filter)
    if isinstance(controller, FoPid):
        filter_s = controller.derivative_filter_time_constant_s
        box = replace(box, derivative_filter_time_constant_s=filter_s, kd=GainRange(), mu=GainRange(0.1, 1.0))
    return replace(spec, controller=box)


@pytest.mark.parametrize(
    "terms",
    [FoPi(1.0, 1.1, 1.0), FoPi(0.9, 1.1, 0.8), FoPid(1.0, 1.1, 0.9, 0.1, 0.7, 0.02)],
    ids=["pi", "fopi", "fopid"],
)
def test_a_certificate_says_the_filter_and_is_refused_with_another(terms: FoPi) -> None:
    controller = replace(terms, measurement_filter=USED)
    spec = _spec(controller)
    certificate = certify(spec, verify(spec, controller), {})
    assert [proof.verdict for proof in certificate.requirements] == [Verdict.PROVED] * 4
    document: dict[str, Any] = json.loads(json.dumps(to_document(certificate)))
    assert document["gains"]["measurement_filter_order"] == 2
    assert document["gains"]["measurement_filter_time_constant_s"] == 0.1
    assert recheck(document, spec).problems == ()
    outcome = Counter[bool]()
    for order, time_s in ((1, 0.1), (2, 0.11), (2, 0.4)):
        changed = json.loads(json.dumps(document))
        changed["gains"] |= {"measurement_filter_order": order, "measurement_filter_time_constant_s": time_s}
        changed["digest"] = digest(changed)
        problems = recheck(changed, spec).problems
        assert "the controller is not of the structure that the spec asks for" in problems
        outcome[len(problems) > 1] += 1
    assert outcome[True] >= 2, "what is stated of one filter does not hold for another"
    del document["gains"]["measurement_filter_order"]
    with pytest.raises(CertificateError, match="measurement_filter_order"):
        recheck(document)


def test_the_noise_gain_is_proved_with_the_filter() -> None:
    bare = FoPi(1.0, 1.1, 1.0)
    found = [
        verify(_spec(each), each).requirements[1].achieved for each in (bare, replace(bare, measurement_filter=USED))
    ]
    assert found[0] is not None
    assert found[1] is not None
    assert abs(found[1] - found[0]) > 0.1
    controller = replace(bare, measurement_filter=MeasurementFilter(2, 0.1))
    for limit, wanted in ((found[1] + 1e-5, Verdict.PROVED), (found[1] - 1e-4, Verdict.REFUTED)):
        spec = replace(_spec(controller), requirements=(_noise(limit),))
        assert certify(spec, verify(spec, controller), {}).requirements[0].verdict is wanted


def _noise(limit: float) -> Requirement:
    return Requirement("control_sensitivity_db", Relation.AT_MOST, (limit,))

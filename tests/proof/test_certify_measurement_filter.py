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

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.terms.controller_spec import GainRange
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.digital import sections_of
from fopi_tune.errors import CertificateError
from fopi_tune.pipeline.prove import recheck
from fopi_tune.proof import certify, verify
from fopi_tune.proof import recheck as recheck_alone
from fopi_tune.proof.certificate import Verdict
from fopi_tune.proof.documents import digest, to_document
from fopi_tune.spec.model import DesignSpec, DigitalSpec, Relation, Requirement

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
        assert "the controller's measurement_filter is not that of the spec" in problems
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


def _joined(sections: Sections, used: MeasurementFilter) -> Sections:
    """F of order 1 by Tustin's rule times a sum of sections, as another such sum, by partial fractions."""
    ts = sections.sample_time_s
    share = ts / (2.0 * used.time_constant_s + ts)
    pole = 1.0 - 2.0 * share

    def filtering(z: float) -> float:
        return share * (z + 1.0) / (z - pole)

    def terms(z: float) -> float:
        pairs = zip(sections.poles, sections.residues, strict=True)
        return sections.direct + sum(residue / (z - p) for p, residue in pairs)

    residues = [residue * filtering(p) for p, residue in zip(sections.poles, sections.residues, strict=True)]
    residues.append(share * (pole + 1.0) * terms(pole))
    return Sections(ts, share * sections.direct, (*sections.poles, pole), tuple(residues))


@pytest.mark.parametrize("terms", [FoPi(1.0, 1.1, 1.0), FoPi(0.9, 1.1, 0.8), Pid(1.0, 1.1, 0.1, 0.05)], ids=str)
def test_a_loop_on_samples_with_a_filter_is_proved_as_that_of_the_sections_it_makes(terms: FoPi) -> None:
    used = MeasurementFilter(1, 0.13)
    controller = replace(terms, measurement_filter=used)
    sections = sections_of(terms, DigitalSpec(0.05, poles=3, band_rad_s=(0.01, 100.0)))
    ours, joined = Implementation(sections, 0.5), Implementation(_joined(sections, used), 0.5)
    spec = _spec(controller)
    found, wanted = verify(spec, controller, implementation=ours), verify(spec, terms, implementation=joined)
    values = [(a.achieved, b.achieved) for a, b in zip(found.requirements, wanted.requirements, strict=True)]
    for one, two in values:
        assert one == pytest.approx(two, abs=1e-7)
    assert found.requirements[1].achieved is not None
    for step, verdict in ((1e-5, Verdict.PROVED), (-1e-5, Verdict.REFUTED)):
        limit = found.requirements[1].achieved + step
        narrow = replace(spec, requirements=(_noise(limit),))
        certificate = certify(narrow, verify(narrow, controller, implementation=ours), {}, ours)
        assert certificate.stability.verdict is Verdict.PROVED
        assert certificate.requirements[0].verdict is verdict
        assert recheck_alone(to_document(certificate)).problems == ()


def test_a_second_order_filter_on_samples_is_proved_up_to_its_worst_case() -> None:
    controller = replace(FoPi(1.0, 1.1, 1.0), measurement_filter=USED)
    sections = sections_of(replace(controller, measurement_filter=None), DigitalSpec(0.05))
    implementation, spec = Implementation(sections, 0.5), _spec(controller)
    found = verify(spec, controller, implementation=implementation)
    # by (1) of the filter's module, with the plants behind their hold and C as a sum
    omega = np.linspace(1e-3, 1.0, 40_001) * np.pi / 0.05
    rows = np.zeros(len(omega), dtype=np.intp)
    bare = replace(controller, measurement_filter=None)
    b, a = (np.asarray(row) for row in USED.polynomials_in_z(0.05))
    z = np.exp(1j * omega * 0.05)
    filtering = np.polyval(b, z) / np.polyval(a, z)
    largest = -np.inf
    for tau in np.linspace(0.8, 1.5, 15):
        loops = SampledLoops.implemented(bare, implementation, Plants.members(LAG, np.array([[tau]])))
        terms = sections.response(omega)
        gain = loops.response(rows, omega) * filtering
        largest = max(largest, float(np.abs(terms * filtering / (1.0 + gain)).max()))
    assert found.requirements[1].achieved == pytest.approx(20.0 * np.log10(largest), abs=1e-4)
    for step, verdict in ((1e-4, Verdict.PROVED), (-1e-4, Verdict.REFUTED)):
        narrow = replace(spec, requirements=(_noise((found.requirements[1].achieved or 0.0) + step),))
        certificate = certify(narrow, verify(narrow, controller, implementation=implementation), {}, implementation)
        assert certificate.requirements[0].verdict is verdict
        assert recheck_alone(to_document(certificate)).problems == ()

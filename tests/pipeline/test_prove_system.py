"""`prove_system` takes a file, and its certificate is checked against one."""

from __future__ import annotations

import json

import pytest
from cases.project import ROOT

from fopi_tune.errors import CertificateError
from fopi_tune.pipeline.prove_system import prove_system, recheck_system
from fopi_tune.proof.switched import SystemVerdict

CAR, CAR_HELD = ROOT / "systems" / "car.yaml", ROOT / "systems" / "car_held.yaml"


def test_a_file_is_proved_and_its_certificate_is_of_that_file() -> None:
    file = str(CAR)
    result = prove_system(file, setpoints=(2.0, 22.0))
    assert result.status is SystemVerdict.SETTLES
    assert result.to_dict()["status"] == "settles"
    document = json.loads(json.dumps(result.certificate_document(), allow_nan=False))
    certificate, found = recheck_system(document, file)
    assert found.accepted
    assert certificate == result.certificate
    assert recheck_system(document)[1].accepted
    assert not recheck_system(document, str(CAR_HELD))[1].accepted


def test_the_shipped_car_settles_and_the_papers_memories_cycle() -> None:
    assert prove_system(CAR).status is SystemVerdict.SETTLES
    held = prove_system(CAR_HELD)
    assert held.status is SystemVerdict.CYCLES
    assert len(held.certificate.cycles) >= 7
    shipped, papers = (path.read_text(encoding="utf-8").partition("scenarios:")[2] for path in (CAR, CAR_HELD))
    assert shipped == papers


def test_another_document_is_no_certificate_of_a_system() -> None:
    with pytest.raises(CertificateError, match="kind is another"):
        recheck_system({"kind": "x"})

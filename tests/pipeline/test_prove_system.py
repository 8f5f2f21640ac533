"""`prove_system` takes a file, and its certificate is checked against one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cases.project import ROOT

from fopi_tune.errors import CertificateError
from fopi_tune.pipeline.prove_system import prove_system, recheck_system
from fopi_tune.proof.switched import SystemVerdict

CAR = ROOT / "systems" / "car.yaml"


def car_that_resets(folder: Path) -> str:
    text = CAR.read_text(encoding="utf-8").replace("inactive: held ", "inactive: reset ")
    path = folder / "car.yaml"
    path.write_text(text.replace("../specs", str(ROOT / "specs")), encoding="utf-8")
    return str(path)


def test_a_file_is_proved_and_its_certificate_is_of_that_file(tmp_path: Path) -> None:
    file = car_that_resets(tmp_path)
    result = prove_system(file, setpoints=(2.0, 22.0))
    assert result.status is SystemVerdict.SETTLES
    assert result.to_dict()["status"] == "settles"
    document = json.loads(json.dumps(result.certificate_document(), allow_nan=False))
    certificate, found = recheck_system(document, file)
    assert found.accepted
    assert certificate == result.certificate
    assert recheck_system(document)[1].accepted
    assert not recheck_system(document, str(CAR))[1].accepted


def test_another_document_is_no_certificate_of_a_system() -> None:
    with pytest.raises(CertificateError, match="kind is another"):
        recheck_system({"kind": "x"})

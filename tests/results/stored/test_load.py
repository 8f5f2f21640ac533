"""Results written to folders and read again: the same JSON, as the command line writes it; mistakes are told."""

from __future__ import annotations

import dataclasses
import json
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from cases.plain_figures import RENDERED_BY, drawn_alone
from cases.project import ROOT
from typer.testing import CliRunner

import fopi_tune as ft
from fopi_tune.cli import app

BRAKE = ROOT / "specs" / "brake.yaml"
CAR = ROOT / "systems" / "car.yaml"
GAINS = ft.FoPi(kp=0.44651, ki=0.37033, alpha=0.83197)


@cache
def run() -> ft.Run:
    return ft.run(BRAKE)


#: what is saved, and the kind it is read as
RESULTS: dict[str, Callable[[], Any]] = {
    "run": run,
    "design": lambda: run().design,
    "digital": lambda: run().digital,
    "check": lambda: ft.prove(BRAKE, GAINS),
    "evidence": lambda: ft.validate(BRAKE, GAINS, samples=50),
    "simulation": lambda: ft.simulate(BRAKE, GAINS),
    "tradeoff": lambda: ft.tradeoff(BRAKE, 5, points=2),
    "system_proof": lambda: ft.prove_system(CAR),
    "system_simulation": lambda: ft.simulate_system(CAR),
    "system_evidence": lambda: ft.validate_system(CAR, samples=20),
    "system_digital": lambda: ft.discretize_system(CAR),
    "system_design": lambda: ft.tune_system(ROOT / "systems" / "car_comfort.yaml"),
}
SLOW = ("tradeoff", "system_design")


def text(document: dict[str, Any]) -> str:
    return json.dumps(document, allow_nan=False)


@pytest.mark.parametrize("kind", [pytest.param(k, marks=pytest.mark.long) if k in SLOW else k for k in RESULTS])
def test_what_is_saved_is_read_again(kind: str, tmp_path: Path) -> None:
    result: Any = RESULTS[kind]()
    assert result.save(tmp_path / "deep" / "out") == tmp_path / "deep" / "out"
    again = ft.load(tmp_path / "deep" / "out")
    assert again.kind == kind
    assert text(again.to_dict()) == text(result.to_dict())
    assert kind == "tradeoff" or again.rows() == result.rows()
    assert again.status == getattr(result, "status", None)
    assert len(repr(again)) <= 800
    assert pickle.loads(pickle.dumps(again)).to_dict() == result.to_dict()
    # nothing is left beside the files, and what was read is written as it was
    assert not list(tmp_path.rglob("*.tmp"))
    again.save(tmp_path / "twice")
    for path in (tmp_path / "twice").iterdir():
        assert path.read_bytes() == (tmp_path / "deep" / "out" / path.name).read_bytes()


def test_the_files_are_those_of_the_command_line_without_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RENDERED_BY, drawn_alone)
    run().save(tmp_path / "python")
    assert CliRunner().invoke(app, ["run", str(BRAKE), "--out", str(tmp_path / "command")]).exit_code == 0
    saved = {path.relative_to(tmp_path / "python") for path in (tmp_path / "python").rglob("*") if path.is_file()}
    written = {path.relative_to(tmp_path / "command") for path in (tmp_path / "command").rglob("*") if path.is_file()}
    assert {path.suffix for path in written - saved} == {".svg", ".png", ".html"}
    for path in saved:
        assert (tmp_path / "python" / path).read_bytes() == (tmp_path / "command" / path).read_bytes()
    # and the report is made of them
    assert CliRunner().invoke(app, ["report", str(tmp_path / "python")]).exit_code == 0
    assert (tmp_path / "python" / "report.html").is_file()


def test_a_loaded_design_has_its_spec_its_gains_its_proof_and_its_curves(tmp_path: Path) -> None:
    design = run().design
    again = ft.load(design.save(tmp_path))
    assert isinstance(again, ft.StoredLoop)
    assert (again.spec, again.gains) == (design.spec, design.gains)
    assert again.certificate is not None
    assert again.certificate.verdict is ft.Verdict.PROVED
    omega = design.bode().omega_rad_s
    assert (again.bode(omega).loop == design.bode(omega).loop).all()
    assert again.step().output.tolist() == design.step().output.tolist()


def test_what_is_not_written_is_told_with_how_to_make_it_again(tmp_path: Path) -> None:
    check = ft.prove(BRAKE, GAINS)
    again: Any = ft.load(check.save(tmp_path))
    with pytest.raises(
        AttributeError, match=r"has no 'verification': .* document \(.*requirements.*\); .* ft\.prove\("
    ):
        _ = again.verification
    made = ft.prove(again.spec, again.gains).verification
    assert made == check.verification
    assert pickle.loads(pickle.dumps(again)).to_dict() == again.to_dict()
    assert not hasattr(again, "__wrapped__")


def test_a_result_without_its_spec_takes_it_and_no_other(tmp_path: Path) -> None:
    ft.simulate(BRAKE, GAINS).save(tmp_path)
    assert not isinstance(ft.load(tmp_path), ft.StoredLoop)
    again = ft.load(tmp_path, spec=BRAKE)
    assert isinstance(again, ft.StoredLoop)
    assert again.gains == GAINS
    with pytest.raises(ft.DomainError, match="is of another spec than 'throttle'"):
        ft.load(tmp_path, spec=ROOT / "specs" / "throttle.yaml")


def test_of_a_spec_that_was_changed_the_changed_one_is_saved(tmp_path: Path) -> None:
    spec = ft.load_spec(BRAKE)
    assert spec.digital is not None
    changed = dataclasses.replace(spec, digital=dataclasses.replace(spec.digital, sample_time_s=0.1))
    ft.prove(changed, GAINS).save(tmp_path)
    again = ft.load(tmp_path)
    assert isinstance(again, ft.StoredLoop)
    assert again.spec.digital == changed.digital


def test_of_several_results_the_kind_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(ft.DomainError, match="there is no result in"):
        ft.load(tmp_path)
    ft.simulate(BRAKE, GAINS).save(tmp_path)
    ft.validate(BRAKE, GAINS, samples=20).save(tmp_path)
    with pytest.raises(ft.DomainError, match="say which with kind=: evidence, simulation"):
        ft.load(tmp_path)
    assert ft.load(tmp_path, "evidence").kind == "evidence"
    for other in ({}, ["evidence"], 3):
        with pytest.raises(ft.DomainError, match="there is no result of the kind"):
            ft.load(tmp_path, other)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ft.DomainError, match="no result of the kind 'design'"):
        ft.load(tmp_path, "design")


def test_damaged_files_are_told_with_their_place(tmp_path: Path) -> None:
    ft.simulate(BRAKE, GAINS).save(tmp_path)
    path = tmp_path / "simulation.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    document["scenarios"][0]["finite"] = "yes"
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(ft.DomainError, match=r"simulation\.json .* scenarios\[0\]\.finite must be of type boolean"):
        ft.load(tmp_path)
    path.write_text("{", encoding="utf-8")
    with pytest.raises(ft.DomainError, match=r"simulation\.json is no JSON"):
        ft.load(tmp_path)


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(ft.DomainError, match=r"cannot write .* give another folder"):
        ft.prove(BRAKE, GAINS).save(tmp_path / "file")

"""Damaged files and paths that are no files: every command ends with 0, 1 or 2, in bounded time and memory."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from cases.fuzz_commands import (
    Ended,
    Target,
    computing_targets,
    mutants,
    prepare,
    result_targets,
    run_in_child,
    spec_targets,
    takes_as_long_undamaged,
)
from cases.project import ROOT
from typer.testing import CliRunner, Result

from fopi_tune.cli import app
from fopi_tune.cli.batch import OutputOptions
from fopi_tune.cli.gains import gains_of_earlier_design
from fopi_tune.spec import load_spec

BRAKE = str(ROOT / "specs" / "brake.yaml")
pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="pipes and child processes as POSIX has them"),
    pytest.mark.usefixtures("plain_figures"),
]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fuzz") / "files"
    folder.mkdir()
    prepare(folder, ["brake"])
    return folder


def fopi(*arguments: str) -> Result:
    """A command in this process; one that waits fails."""
    signal.alarm(60)
    try:
        return CliRunner().invoke(app, list(arguments))
    finally:
        signal.alarm(0)


def described(ends: Sequence[Ended]) -> str:
    return "\n".join(
        f"{e.code} {e.cpu_s:.1f} s {e.mutant.target} {e.mutant.data[:2000]!r} {e.words[-500:]}" for e in ends
    )


# -- damaged files -----------------------------------------------------------------------------------------------------


def check_in_this_process(targets: Sequence[Target], folder: Path, chance: random.Random, count: int) -> set[int]:
    """The exit codes; the time is asserted only as a whole, since other processes may need the processor."""
    codes = set[int]()
    for mutant in mutants(targets, folder, chance, count):
        path = folder / mutant.target.file
        good = path.read_bytes()
        path.write_bytes(mutant.data)
        try:
            result = fopi(*mutant.target.arguments)
        finally:
            path.write_bytes(good)
        assert result.exit_code in (0, 1, 2), (mutant, result.output)
        assert result.exception is None or isinstance(result.exception, SystemExit), (mutant, result.exception)
        assert "internal error" not in result.output, mutant
        if result.exit_code == 2:
            assert result.stderr.strip(), mutant  # nothing is refused without a word
        codes.add(result.exit_code)
    return codes


@pytest.mark.parametrize("count", [20, pytest.param(45, marks=pytest.mark.long)])
def test_damaged_specs_studies_and_recordings_are_read_or_refused(files: Path, count: int) -> None:
    # a seed with which some of the damaged ones can still be read
    assert {0, 2} <= check_in_this_process(spec_targets(files), files, random.Random(2), count)


def test_damaged_results_and_certificates_are_read_or_refused(files: Path) -> None:
    assert {1, 2} <= check_in_this_process(result_targets(files, "brake"), files, random.Random(2), 15)


def check_in_children(targets: Sequence[Target], folder: Path, seed: int, count: int, batch: int = 100) -> None:
    """Many files, a batch of them in a process, whose time and memory are measured."""
    chance, left = random.Random(seed), count
    while left > 0:
        ends = run_in_child(mutants(targets, folder, chance, batch), folder)
        ill = [e for e in ends if not e.is_well or (e.is_slow and not takes_as_long_undamaged(e, folder))]
        assert not ill, described(ill)
        left -= len(ends)


@pytest.mark.long
def test_a_thousand_damaged_specs_studies_and_recordings(files: Path) -> None:
    check_in_children(spec_targets(files), files, 3, 1_000)


@pytest.mark.long
def test_hundreds_of_damaged_results_and_certificates(files: Path) -> None:
    check_in_children(result_targets(files, "brake"), files, 4, 500)


@pytest.mark.long
def test_a_hundred_damaged_specs_and_systems_that_are_computed(files: Path) -> None:
    # the good files of these take more memory already: their plants are many
    heavy = ("lag_gain_and_delay", "second_order")
    targets = [each for each in computing_targets(files) if not any(name in each.file for name in heavy)]
    check_in_children(targets, files, 5, 100, batch=1)


# -- wrong entries of results ------------------------------------------------------------------------------------------


@pytest.fixture
def results(files: Path, tmp_path: Path) -> Path:
    """The results of a run without proof, whose every entry can be changed."""
    shutil.copytree(files / "brake_unproved", tmp_path / "brake")
    shutil.copytree(files / "brake", tmp_path / "other")
    return tmp_path / "brake"


def change(path: Path, place: Sequence[str | int], value: Any) -> None:
    """Change an entry of a JSON file; `...` drops it, bytes are written as they are."""
    document = json.loads(path.read_text(encoding="utf-8"))
    inner = document
    for key in place[:-1]:
        inner = inner[key]
    if value is ...:
        del inner[place[-1]]
    else:
        inner[place[-1]] = "here" if isinstance(value, bytes) else value
    text = json.dumps(document)
    path.write_text(text.replace('"here"', value.decode()) if isinstance(value, bytes) else text, encoding="utf-8")


@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    ("file", "place", "value", "said"),
    [
        ("design.json", ["proof"], ..., "proof is missing"),
        ("design.json", ["proof"], 7, "proof is no object"),
        ("design.json", ["proof", "verdict"], "sure", "proof.verdict is none of"),
        ("design.json", ["requirements", 1, "achieved"], ..., "requirements[1].achieved is missing"),
        ("design.json", ["requirements", 1, "achieved"], "90", "requirements[1].achieved is no finite number"),
        ("design.json", ["requirements", 1, "achieved"], b"1e999", "requirements[1].achieved is a number beyond"),
        ("design.json", ["requirements", 1, "met"], 1, "requirements[1].met is neither true nor false"),
        ("design.json", ["requirements", 1, "name"], "x", "requirements[1].name is another requirement"),
        ("design.json", ["requirements", 1, "worst", "plant"], {"a": 1}, "requirements[1].worst.plant is no plant"),
        (
            "design.json",
            ["requirements", 1, "worst", "plant", "time_constant_s"],
            -1e300,
            "requirements[1].worst.plant is no plant",
        ),
        ("design.json", ["requirements", 1], None, "requirements[1] is no object"),
        ("design.json", ["requirements"], [], "requirements is not those of the spec"),
        ("design.json", ["stability", "stable"], "yes", "stability.stable is neither true nor false"),
        ("design.json", ["gains", "alpha"], 3, "alpha"),
        ("design.json", ["gains"], [1, 2, 3], "gains is no object"),
        ("design.json", ["clash"], [{"requirement": 99, "give": 1, "new_limit": 1}], "clash[0].requirement is none"),
        ("design.json", ["stamp", "versions"], [], "stamp.versions is no object"),
        ("design.json", ["nominal"], {}, "nominal.stable is missing"),
        ("design.json", ["schema"], 2, "schema is not 1"),
        ("digital.json", ["controller", "sections"], [], "controller.sections is no poles"),
        ("digital.json", ["controller", "sections", 0, "pole"], 1.5, "controller.sections is no poles"),
        ("digital.json", ["controller", "direct"], None, "controller.direct is no finite number"),
        ("digital.json", ["requirements", 0, "score"], [], "requirements[0].score is no finite number"),
        ("evidence.json", ["drawn", "confidence"], 1, "drawn.confidence is not between 0 and 1"),
        ("evidence.json", ["stable", "total"], 0, "stable.met is no part"),
        ("evidence.json", ["requirements", 0, "histogram", "counts"], [], "requirements[0].histogram.edges is not one"),
        ("evidence.json", ["requirements", 0, "histogram", "edges", 3], -1e9, "histogram.edges is not increasing"),
        ("evidence.json", ["requirements", 0, "histogram", "counts", 0], 10**6, "histogram.counts is no counts"),
        ("evidence.json", ["requirements", 0, "limits"], [], "requirements[0].limits is empty"),
        ("evidence.json", ["limits"], 5, "limits is no list"),
    ],
)
def test_a_wrong_entry_of_a_result_is_named_by_the_report_and_the_comparison(
    results: Path, file: str, place: list[str | int], value: Any, said: str
) -> None:
    change(results / file, place, value)
    page = ("--out", str(results.parent / "page"))
    for arguments in (
        ["report", str(results)],
        ["report", "--compare", str(results), str(results.parent / "other"), *page],
    ):
        result = fopi(*arguments, "-q")
        assert result.exit_code == 2, (result.output, result.exception)
        assert said in result.stderr
        assert file in result.stderr
        assert not (results.parent / "page").exists()


def test_a_run_whose_folder_holds_wrong_evidence_says_so_and_keeps_its_report(results: Path) -> None:
    change(results / "evidence.json", ["drawn"], [])
    result = fopi("run", BRAKE, "--no-proof", "--out", str(results), "-q")
    assert result.exit_code in (0, 1)
    assert "evidence.json is not as this tool writes it: drawn is no object" in result.stderr
    assert "the report leaves it out" in result.stderr
    assert (results / "report.html").exists()


# -- paths that are no files -------------------------------------------------------------------------------------------


@pytest.fixture(params=["pipe", "device", "directory"])
def no_file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / "no_file"
    if request.param == "pipe":
        os.mkfifo(path)
    elif request.param == "device":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    return path


@pytest.fixture(autouse=True)
def alarm() -> Iterator[None]:
    """Whoever waits for a pipe is ended by the alarm, and not by patience."""
    yield
    signal.alarm(0)


def test_no_command_opens_what_is_no_file(no_file: Path, files: Path, tmp_path: Path) -> None:
    path, kind = str(no_file), "directory" if no_file.is_dir() else "only regular files are read"
    system, study = tmp_path / "system.yaml", tmp_path / "study.yaml"
    text = (ROOT / "systems" / "switching.yaml").read_text(encoding="utf-8")
    system.write_text(text.replace("../specs/", f"{tmp_path}/").replace("throttle.yaml", "no_file"), encoding="utf-8")
    study.write_text(
        "schema: 1\nname: a\nspecs: [no_file]\nstages: [tune]\ncollect: {kp: tune.gains.kp}\n", encoding="utf-8"
    )
    listed = tmp_path / "listed.yaml"
    listed.write_text(
        (files / "listed.yaml").read_text(encoding="utf-8").replace("draws.csv", "no_file"), encoding="utf-8"
    )
    commands = [
        ("prove", path),
        ("prove", path, "--kp", "1", "--ki", "1", "--alpha", "1"),
        ("prove", "--recheck", path),
        ("prove", "--recheck", str(files / "brake" / "certificate.json"), path),
        ("study", path, "--dry-run"),
        ("study", str(study), "--dry-run"),
        ("simulate", path),
        ("simulate", str(system)),
        ("tune", str(listed)),
        ("init", "x", "--out", str(tmp_path / "x.yaml"), "--from-step-data", path),
    ]
    for arguments in commands:
        result = fopi(*arguments)
        assert result.exit_code == 2, (arguments, result.output, result.exception)
        assert kind in result.stderr.lower(), (arguments, result.stderr)
    assert not (tmp_path / "x.yaml").exists()


@pytest.mark.parametrize("name", ["spec.yaml", "design.json", "digital.json", "evidence.json", "certificate.json"])
def test_a_folder_of_results_with_a_pipe_in_it_is_refused(files: Path, tmp_path: Path, name: str) -> None:
    folder = tmp_path / "brake"
    shutil.copytree(files / "brake", folder)
    (folder / name).unlink()
    os.mkfifo(folder / name)
    page = ("--out", str(tmp_path / "page"))
    for arguments in (["report", str(folder)], ["report", "--compare", str(folder), str(files / "brake"), *page]):
        result = fopi(*arguments)
        assert result.exit_code == 2, (result.output, result.exception)
        assert f"{name}" in result.stderr
        assert "it is a pipe, and only regular files are read" in result.stderr


def test_gains_are_not_read_from_a_pipe(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "design.json")
    signal.alarm(60)
    assert gains_of_earlier_design(load_spec(BRAKE), OutputOptions(str(tmp_path), False, True, False)) is None


# -- contents that are nobody's business -------------------------------------------------------------------------------

SECRET = "hunter2correcthorse"
SECRETS = {
    "a key": f"-----BEGIN PRIVATE KEY-----\n{SECRET}\nMIIEvQIBADANBgkqh\n-----END PRIVATE KEY-----\n",
    "an old key": f"-----BEGIN RSA PRIVATE KEY-----\nProc-Type: 4,ENCRYPTED\n\n{SECRET}\n",
    "a list of users": f"admin:{SECRET}:0:0:admin:/:/bin/sh\nuser:{SECRET}:1:1::/:/bin/sh\n",
    "an environment": f"TOKEN={SECRET}\nUSER=me\n",
    "credentials": f"machine example.org login me password {SECRET}\n",
    "credentials of YAML": f"password: {SECRET}\ntoken: [{SECRET}, {SECRET}]\n{SECRET}:\n",
    "credentials of JSON": json.dumps({"token": SECRET, SECRET: 1, "b": [SECRET]}),
    "a table": f"user,password\nme,{SECRET}\nyou,{SECRET}\n",
    "a table of one column": f"{SECRET}\n{SECRET}\n",
    "a word": SECRET,
    "a binary file": "\x7fELF\0\1\2" + SECRET + "\0\xff",
}


@pytest.mark.thinned(3)
@pytest.mark.parametrize("kind", SECRETS)
def test_what_is_no_spec_no_table_and_no_result_is_not_shown(files: Path, tmp_path: Path, kind: str) -> None:
    path = tmp_path / "secret"
    path.write_bytes(SECRETS[kind].encode("latin-1"))
    listed = tmp_path / "listed.yaml"
    listed.write_text(
        (files / "listed.yaml").read_text(encoding="utf-8").replace("draws.csv", "secret"), encoding="utf-8"
    )
    study = tmp_path / "study.yaml"
    study.write_text(
        "schema: 1\nname: a\nspecs: [secret]\nstages: [tune]\ncollect: {kp: tune.gains.kp}\n", encoding="utf-8"
    )
    for name in ("design.json", "certificate.json"):
        shutil.copytree(files / "brake", tmp_path / name)
        shutil.copy(path, tmp_path / name / name)
    commands = [
        ("report", str(path)),
        ("simulate", str(path)),
        ("study", str(path), "--dry-run"),
        ("prove", "--recheck", str(path)),
        ("tune", str(listed)),
        ("init", "x", "--out", str(tmp_path / "x.yaml"), "--from-step-data", str(path)),
        ("study", str(study), "--dry-run"),
        ("report", str(tmp_path / "design.json")),
        ("report", str(tmp_path / "certificate.json")),
    ]
    for arguments in commands:
        result = fopi(*arguments)
        assert result.exit_code == 2, (arguments, result.output, result.exception)
        assert SECRET not in result.output, (arguments, result.output)
        assert SECRET[:8] not in result.output, (arguments, result.output)

"""The command line: output, files, exit codes, and what it must not import."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from cases.project import CONTINUOUS, IMPORTED
from typer.testing import CliRunner, Result

from fopi_tune import __version__
from fopi_tune.cli import app
from fopi_tune.cli.output import still_running_notes
from fopi_tune.errors import DomainError
from fopi_tune.results.status import Status
from fopi_tune.spec import load_spec

pytestmark = pytest.mark.usefixtures("plain_figures")

BRAKE_FILE, THROTTLE_FILE = str(CONTINUOUS / "brake.yaml"), str(CONTINUOUS / "throttle.yaml")
BRAKE = (CONTINUOUS / "brake.yaml").read_text(encoding="utf-8")
PUBLISHED = ("--kp", "0.07", "--ki", "0.11", "--alpha", "0.45")
ROBUST = ("--kp", "0.3851247", "--ki", "0.3877569", "--alpha", "0.8203826", "--tolerance", "1e-5")

BRAKE_TABLE = """\
brake: solved. All requirements are proved for every plant and every frequency.

kp = 0.38512   ki = 0.38776   alpha = 0.82038           C(s) = kp + ki / s^alpha

          requirement                               achieved    score multiplier
proved    crossover_rad_s = 0.3                          0.3    0.000      0.373
            nominal plant; worst at 0.3 rad/s
proved    phase_margin_deg = 90                           90    0.000     0.0729
            nominal plant; worst at 0.3 rad/s
proved    phase_margin_deg >= 80                      82.906    0.951          0
            family; worst at 0.26854 rad/s with time_constant_s = 3.1
proved    gain_margin_db >= 12.04                   infinite    0.000          0
            family; no phase crossover sets it
proved    sensitivity_db <= -20                          -20    1.000      0.405
            family, up to 0.02 rad/s; worst at 0.02 rad/s with
            time_constant_s = 3.1

A score of at most 1 is met.
The multiplier is what the objective gains for each unit the limit gives.

objective minimize phase_margin_spread_deg: 7.3856
stability stable: no member has a closed-loop pole in the right half-plane; |S|
          stays below 0.47 dB; closest to -1 at 0.74888 rad/s with
          time_constant_s = 3.1
nominal   crossover 0.3 rad/s, phase margin 90 deg, gain margin infinite, delay
          margin 5.236 s
proof     proved: 288 boxes in ball arithmetic; each bound within 5.0e-07
          (relative) of a value that a plant reaches
optimum   nothing better by more than 0.1 % is possible (checked)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def fopi(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def fails(*_: object, **__: object) -> Any:
    raise RuntimeError("three\nis not four")


def spec_file(name: str, text: str) -> str:
    Path(name).write_text(text, encoding="utf-8")
    return name


def brake_with(*changes: str) -> str:
    text = BRAKE
    for old, new in zip(changes[::2], changes[1::2], strict=True):
        assert old in text
        text = text.replace(old, new, 1)
    return text


def test_tune_prints_the_brakes_table() -> None:
    result = fopi("tune", BRAKE_FILE)
    assert result.exit_code == 0
    assert result.stdout == BRAKE_TABLE


def test_tune_writes_what_json_prints_and_prints_nothing_else() -> None:
    result = fopi("tune", BRAKE_FILE, "--json")
    assert result.exit_code == 0
    assert Path("results/brake/design.json").read_text(encoding="utf-8") == result.stdout
    document = json.loads(result.stdout)
    assert list(document)[:6] == ["schema", "status", "gains", "objective", "requirements", "stamp"]
    assert document["gains"] == pytest.approx({"kp": 0.38512, "ki": 0.38776, "alpha": 0.82038}, rel=1e-4)
    assert sorted(os.listdir("results/brake")) == ["certificate.json", "design.json", "spec.yaml"]


def test_notes_go_to_stderr_and_quiet_silences_them() -> None:
    path = Path("results", "throttle", "design.json")
    loud = fopi("tune", THROTTLE_FILE)
    assert f"throttle: wrote {path}\n" in loud.stderr
    quiet = fopi("tune", THROTTLE_FILE, "--quiet")
    assert (quiet.stderr, quiet.stdout) == ("", loud.stdout)


def test_run_without_a_digital_section_does_what_tune_does() -> None:
    text = Path(THROTTLE_FILE).read_text(encoding="utf-8")
    Path("t.yaml").write_text(
        "".join(line for line in text.splitlines(True) if not line.startswith("digital")), "utf-8"
    )
    ran, tuned = json.loads(fopi("run", "t.yaml", "--json").stdout), json.loads(fopi("tune", "t.yaml", "--json").stdout)
    assert ran == {**tuned, "digital": None, "digital_problem": ""}


def test_out_replaces_the_folder() -> None:
    assert fopi("tune", THROTTLE_FILE, "--out", "a/b").exit_code == 0
    assert os.listdir() == ["a"]
    assert sorted(os.listdir("a/b")) == ["certificate.json", "design.json", "spec.yaml"]


def test_several_specs_get_a_folder_each_and_the_worst_exit_code_counts() -> None:
    broken = spec_file("broken.yaml", brake_with("crossover_rad_s", "crosover_rad_s"))
    impossible = spec_file("impossible.yaml", brake_with("name: brake", "name: impossible", "max: 1.5", "max: 0.6"))
    result = fopi("tune", broken, impossible, THROTTLE_FILE, "--json", "--out", "o")
    assert result.exit_code == 2
    assert [document["status"] for document in json.loads(result.stdout)] == ["infeasible", "solved"]
    assert sorted(os.listdir("o")) == ["impossible", "throttle"]
    assert result.stderr.startswith("broken.yaml:14:5: requirements[0].crosover_rad_s: ")
    assert fopi("tune", impossible, THROTTLE_FILE).exit_code == 1


def test_tables_of_several_specs_are_separated() -> None:
    second = spec_file("b.yaml", Path(THROTTLE_FILE).read_text(encoding="utf-8").replace("name: throttle", "name: b"))
    printed = fopi("tune", THROTTLE_FILE, second).stdout
    assert "\n\nb: solved." in printed


def test_two_specs_of_one_name_do_not_overwrite_each_other() -> None:
    second = spec_file("second.yaml", brake_with("name: brake", "name: Throttle"))
    result = fopi("tune", THROTTLE_FILE, second)
    assert result.exit_code == 2
    assert "second.yaml: " in result.stderr
    assert "has the same name, Throttle" in result.stderr
    assert os.listdir("results") == ["throttle"]


def test_an_infeasible_spec_says_what_clashes_and_ends_with_1() -> None:
    result = fopi("tune", spec_file("s.yaml", brake_with("max: 1.5", "max: 0.6")))
    assert result.exit_code == 1
    assert result.stdout.startswith("brake: infeasible. No gains meet all requirements")
    assert "alpha >= 0.6220" in result.stdout
    clash = result.stdout.partition("These clash")[2]
    assert "\n  crossover_rad_s = 0.3 (nominal plant)\n" in clash
    assert "\n  phase_margin_deg = 90 (nominal plant)\n" in clash
    assert json.loads(Path("results/brake/design.json").read_text(encoding="utf-8"))["status"] == "infeasible"


def test_what_a_clashing_requirement_would_have_to_give_is_said_in_words() -> None:
    text = "\n".join(
        (
            "schema: 1",
            "name: s",
            "plant: {model: lag, static_gain: 1, time_constant_s: 2, dead_time_s: 1}",
            "controller: {kp: {min: 0, max: 10}, ki: {min: 0, max: 10}, alpha: 1}",
            "requirements:",
            "  - crossover_rad_s: {at_least: 1.5}",
            "  - phase_margin_deg: {at_least: 60}",
            "objective: {minimize: sensitivity_peak_db}",
        )
    )
    result = fopi("tune", spec_file("s.yaml", text), "--json")
    assert result.exit_code == 1
    gives = {give["name"]: give for give in json.loads(result.stdout)["clash"]}
    assert gives.keys() == {"crossover_rad_s", "phase_margin_deg"}
    table = fopi("tune", "s.yaml").stdout
    for give, unit_limit in ((gives["crossover_rad_s"], 1.5), (gives["phase_margin_deg"], 60.0)):
        assert give["new_limit"] == pytest.approx(unit_limit - give["give"])
        assert f"      by {give['give']:.5g}, to {give['new_limit']:.5g}\n" in table
    # 180 deg - phase of 1/(2s + 1) - the dead time's, with a proportional controller, is the most there is at 1.5 rad/s
    # the advice is a hair (6e-4 deg) below, and rounded down to the five digits that are printed (1e-3 deg)
    most = 180 - 71.565051 - 85.943669
    assert most - 2e-3 <= gives["phase_margin_deg"]["new_limit"] < most


def test_an_unbounded_spec_ends_with_1() -> None:
    text = "schema: 1\nname: s\nplant: {model: lag, static_gain: 1, time_constant_s: 2}\nobjective: {maximize: ki}\n"
    result = fopi("tune", spec_file("s.yaml", text))
    assert result.exit_code == 1
    assert result.stdout.startswith("s: unbounded. ")
    assert "they are no solution" in result.stdout


def test_prove_refutes_the_published_brake_gains() -> None:
    result = fopi("prove", BRAKE_FILE, *PUBLISHED, "--json")
    assert result.exit_code == 1
    document = json.loads(result.stdout)
    assert document["status"] == "violated"
    assert document["nominal"]["crossover_rad_s"] == pytest.approx(0.00838, rel=1e-3)
    assert document["nominal"]["phase_margin_deg"] == pytest.approx(141.0, abs=0.05)
    assert Path("results/brake/check.json").read_text(encoding="utf-8") == result.stdout
    table = fopi("prove", BRAKE_FILE, *PUBLISHED).stdout
    assert table.startswith("brake: violated. The gains do not meet the requirements that are marked.\n")
    assert "violated  phase_margin_deg = 90                       141.02" in table
    assert "multiplier" not in table


def test_gains_whose_loop_turns_too_often_to_search_are_violated_where_it_is_unstable() -> None:
    result = fopi("prove", str(CONTINUOUS / "lag_gain_and_delay.yaml"), "--kp", "1e6", "--ki", "1", "--alpha", "1")
    assert result.exit_code == 1
    assert "violated, the loop is not stable" in result.stderr
    assert "turns 49,736 times below its gain crossover" in " ".join(result.stderr.split())
    assert "take smaller gains or a shorter dead time" in " ".join(result.stderr.split())


def test_prove_confirms_good_gains_within_the_tolerance() -> None:
    result = fopi("prove", BRAKE_FILE, *ROBUST)
    assert result.exit_code == 0
    assert result.stdout.startswith("brake: met. All requirements are proved for every plant and every frequency.\n")


def test_prove_says_when_a_plant_is_unstable_or_has_no_crossover() -> None:
    unstable = fopi("prove", BRAKE_FILE, "--kp", "-2", "--ki", "0.11", "--alpha", "0.45")
    assert unstable.exit_code == 1
    assert "not stable for every plant" in unstable.stdout
    assert "NOT STABLE: 2 closed-loop poles in the right half-plane" in unstable.stdout
    spec = spec_file(
        "s.yaml",
        "schema: 1\nname: s\nplant: {model: lag, static_gain: 0.5, time_constant_s: 2}\n"
        "requirements: [{crossover_rad_s: {at_least: 0.3}}]\n",
    )
    silent = fopi("prove", spec, "--kp", "0.5", "--ki", "0", "--alpha", "1")
    assert silent.exit_code == 1
    assert "no crossover" in silent.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--kp", "0", "--ki", "0", "--alpha", "1"), "0"),
        (("--kp", "1", "--ki", "1", "--alpha", "2"), "alpha = 2.0 lies outside (0, 2)"),
        (("--kp", "1", "--ki", "1", "--alpha", "0"), "alpha = 0.0 lies outside (0, 2)"),
        (("--kp", "1_0", "--ki", "1", "--alpha", "1"), "--kp': 1_0 has underscores; write 10"),
        (("--kp", "-1e-400", "--ki", "1", "--alpha", "1"), "--kp': -1e-400 is too small to compute with"),
        (("--kp", "nan", "--ki", "1", "--alpha", "1"), "--kp': 'nan' is not a finite number"),
        (("--kp", "1", "--ki", "1e400", "--alpha", "1"), "--ki': 1e400 is too large to compute with"),
        ((*PUBLISHED, "--tolerance", "0"), "tolerance = 0.0 must be greater than 0 and at most 0.01"),
        ((*PUBLISHED, "--tolerance", "nan"), "--tolerance': 'nan' is not a finite number"),
        ((*PUBLISHED, "--tolerance", "1_0"), "--tolerance': 1_0 has underscores; write 10"),
        (("--kp", "1", "--ki", "1"), "--alpha"),
        (("--kp", "fast", "--ki", "1", "--alpha", "1"), "--kp"),
        ((*PUBLISHED, "--gain", "1"), "--gain"),
    ],
)
def test_bad_options_end_with_2_and_no_traceback(arguments: tuple[str, ...], said: str) -> None:
    result = fopi("prove", BRAKE_FILE, *arguments)
    assert result.exit_code == 2
    assert said in result.stderr
    assert "Traceback" not in result.stderr
    assert result.stdout == ""
    assert os.listdir() == []


def test_every_mistake_of_a_spec_is_one_line_on_stderr() -> None:
    file = spec_file("s.yaml", brake_with("static_gain: 1.0", "static_gain: yes", "at_least: 80", "at_least: 1e400"))
    for arguments in (("tune", file), ("run", file, "--json"), ("prove", file, *PUBLISHED)):
        result = fopi(*arguments)
        assert (result.exit_code, result.stdout) == (2, "")
        first, second = result.stderr.splitlines()
        assert first.startswith("s.yaml:6:16: plant.static_gain: ")
        assert second.startswith("s.yaml:18:34: requirements[2].phase_margin_deg.at_least: ")


def test_a_missing_file_is_bad_input_and_control_characters_in_its_name_are_shown() -> None:
    result = fopi("tune", "no\x1b[31m\nsuch.yaml")
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert "\x1b" not in result.stderr


@pytest.mark.parametrize("out", ["file", "file/deeper"])
def test_a_folder_that_cannot_be_written_loses_nothing(out: str) -> None:
    Path("file").write_text("mine", encoding="utf-8")
    result = fopi("tune", THROTTLE_FILE, "--out", out)
    assert result.exit_code == 2
    assert f"throttle: cannot write {Path(out, 'spec.yaml')}" in result.stderr
    assert "--out" in result.stderr
    assert result.stdout.startswith("throttle: solved.")
    assert Path("file").read_text(encoding="utf-8") == "mine"


def test_a_failed_write_leaves_the_old_result_and_no_litter(monkeypatch: pytest.MonkeyPatch) -> None:
    fopi("prove", BRAKE_FILE, *PUBLISHED)
    before = Path("results/brake/check.json").read_bytes()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    result = fopi("prove", BRAKE_FILE, *ROBUST)
    assert result.exit_code == 2
    assert "No space left on device" in result.stderr
    assert sorted(os.listdir("results/brake")) == ["certificate.json", "check.json", "spec.yaml"]
    assert Path("results/brake/check.json").read_bytes() == before


def test_a_failure_of_the_tool_is_one_line_and_the_other_specs_are_done(monkeypatch: pytest.MonkeyPatch) -> None:
    import fopi_tune.pipeline.tune

    real = fopi_tune.pipeline.tune.tune
    monkeypatch.setattr(
        "fopi_tune.pipeline.tune.tune", lambda spec, *_, **__: fails() if spec.name == "brake" else real(spec)
    )
    result = fopi("tune", BRAKE_FILE, THROTTLE_FILE, "--quiet")
    assert result.exit_code == 3
    assert result.stdout.startswith("throttle: solved.")
    assert result.stderr == (
        "brake: internal error, RuntimeError: three\\nis not four; this is a mistake of fopi-tune: please report it "
        "together with the spec and what --debug adds\n"
    )
    assert "in fails\n" in fopi("tune", BRAKE_FILE, "--debug").stderr


def test_a_failed_status_ends_with_3_and_a_domain_error_with_2(monkeypatch: pytest.MonkeyPatch) -> None:
    from dataclasses import replace

    import fopi_tune.pipeline.tune

    design = fopi_tune.pipeline.tune.tune(load_spec(THROTTLE_FILE))
    failed = replace(design, status=Status.FAILED, message="Ipopt gave up")
    monkeypatch.setattr("fopi_tune.pipeline.tune.tune", lambda *_, **__: failed)
    result = fopi("tune", THROTTLE_FILE)
    assert result.exit_code == 3
    assert "Why: Ipopt gave up.\n" in result.stdout

    def refuses(*_: object, **__: object) -> None:
        raise DomainError("the dead time is too long")

    monkeypatch.setattr("fopi_tune.pipeline.tune.tune", refuses)
    result = fopi("tune", THROTTLE_FILE, "--quiet")
    assert (result.exit_code, result.stderr) == (2, "throttle: the dead time is too long\n")


def test_schema_prints_the_json_schema() -> None:
    result = fopi("schema")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["$schema"].startswith("https://json-schema.org/")


def test_init_writes_a_spec_that_can_be_used() -> None:
    result = fopi("init", "motor")
    assert (result.exit_code, result.stdout) == (0, "")
    assert load_spec("motor.yaml").name == "motor"
    assert sorted(os.listdir()) == ["fopi.schema.json", "motor.yaml"]
    assert fopi("init").exit_code == 0
    assert fopi("init", "--out", "deeper/x.yaml").exit_code == 0
    assert (load_spec("design.yaml").name, load_spec("deeper/x.yaml").name) == ("design", "x")


def test_init_overwrites_only_when_forced() -> None:
    spec_file("motor.yaml", "mine")
    refused = fopi("init", "motor")
    assert refused.exit_code == 2
    assert "--force" in refused.stderr
    assert Path("motor.yaml").read_text(encoding="utf-8") == "mine"
    assert fopi("init", "motor", "--force").exit_code == 0
    assert load_spec("motor.yaml").name == "motor"


@pytest.mark.parametrize("arguments", [("../x",), ("a b",), ("x", "--out", "."), ("x", "--out", "taken/x.yaml")])
def test_init_refuses_what_it_cannot_write(arguments: tuple[str, ...]) -> None:
    spec_file("taken", "mine")
    result = fopi("init", *arguments)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert os.listdir() == ["taken"]


def test_help_names_every_command_and_a_wrong_one_is_bad_input() -> None:
    shown = fopi("--help").stdout
    assert all(f"\n  {command} " in shown for command in ("tune", "run", "prove", "schema", "init"))
    assert fopi("polish").exit_code == 2


def test_every_line_fits_80_columns_of_plain_ascii() -> None:
    names = ", ".join(f"{{complementary_sensitivity_db: {{between: [-{10 + k}.0412, 30.0103]}}}}" for k in range(2))
    gain, time, dead = "{min: 1, max: 2}", "{min: 1.6, max: 3.1}", "{min: 0.211111, max: 0.411111}"
    plant = f"{{model: lag, static_gain: {gain}, time_constant_s: {time}, dead_time_s: {dead}}}"
    file = spec_file("s.yaml", f"schema: 1\nname: {'long' * 16}\nplant: {plant}\nrequirements: [{names}]\n")
    result = fopi("prove", file, "--kp", "0.1111111", "--ki", "1.23456789e-7", "--alpha", "0.333333333")
    assert result.stdout.isascii()
    assert "\x1b" not in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 80
    assert "[-11.0412, 30.0103]" in result.stdout


def python(program: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(IMPORTED), "PYTHONSAFEPATH": "1"} | environment,
        check=False,
        timeout=300,
    )


MODULES_AFTER = """
import sys
from fopi_tune.cli import main
sys.argv = ["fopi", *{arguments!r}]
try:
    main()
except SystemExit as end:
    print(end.code, *(m for m in ("numpy", "casadi", "scipy", "control", "rich", "cvxpy") if m in sys.modules))
"""


def test_the_version_is_told_without_numpy_and_a_mistake_without_the_solver() -> None:
    assert python(MODULES_AFTER.format(arguments=["--version"])).stdout == f"fopi {__version__}\n0\n"
    file = spec_file("s.yaml", brake_with("static_gain: 1.0", "static_gain: yes"))
    done = python(MODULES_AFTER.format(arguments=["tune", file]))
    assert done.stdout == "2 numpy\n"
    assert done.stderr.startswith("s.yaml:6:16: ")


def test_a_design_and_its_text_load_neither_simulations_nor_proofs_of_systems() -> None:
    program = """
import sys
import fopi_tune.pipeline.tune
import fopi_tune.report.text.design
unused = ("fopi_tune.proof.switched", "fopi_tune.proof.time_domain", "fopi_tune.simulation", "fopi_tune.study")
print([m for m in sys.modules if m.startswith(unused)])
"""
    assert python(program).stdout == "[]\n"


@pytest.mark.skipif(os.name != "posix", reason="terminals and pipes of POSIX")
def test_a_process_colours_terminals_only_and_survives_a_closed_pipe() -> None:
    program = """
import os, pty, sys
from fopi_tune.cli.output import print_out, print_styled
from rich.text import Text
text = Text("solved", "bold green")
code = print_styled(text)
front, back = pty.openpty()
sys.stdout = os.fdopen(back, "w")
print_styled(text)
os.environ["NO_COLOR"] = "1"
print_styled(text)
shown = b""
while shown.count(b"\\n") < 2:
    shown += os.read(front, 1000)
sys.stderr.write(repr(shown))
read, write = os.pipe()
os.close(read)
os.dup2(write, 1)
sys.stdout = os.fdopen(1, "w")
sys.exit(int(print_out("x")))
"""
    done = python(program, TERM="xterm", NO_COLOR="")
    assert done.stdout == "solved\n"
    assert done.stderr == repr(b"\x1b[1;32msolved\x1b[0m\r\nsolved\r\n")
    assert done.returncode == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device here")
def test_a_full_stdout_is_told_and_the_file_is_written_all_the_same() -> None:
    program = (
        f"import sys; from fopi_tune.cli import main; sys.argv = ['fopi', 'tune', {THROTTLE_FILE!r}, '-q']; main()"
    )
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run(
            [sys.executable, "-c", program],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": str(IMPORTED), "PYTHONSAFEPATH": "1"},
            check=False,
            timeout=300,  # the first search compiles
        )
    assert done.returncode == 2
    assert done.stderr == "cannot write to stdout (No space left on device)\n"
    assert Path("results/throttle/design.json").exists()


# -- long work, completion --------------------------------------------------------------------------------------------


def test_long_work_is_told_of_ever_more_seldom_and_never_when_it_should_be_quiet(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("fopi_tune.cli.output._FIRST_NOTE_S", 0.05)
    told = threading.Event()
    said: list[str] = []

    def say(words: str) -> None:
        said.append(words)
        if len(said) == 3:
            told.set()

    monkeypatch.setattr("fopi_tune.cli.output.say", say)
    with still_running_notes("s: still tuning", quiet=False) as enough:
        assert told.wait(30.0)
        enough()
    assert said[:3] == [f"s: still tuning after {seconds} s ..." for seconds in ("0.05", "0.1", "0.2")]
    said.clear()
    with still_running_notes("s: still tuning", quiet=True):
        time.sleep(0.15)
    with still_running_notes("s: still tuning", quiet=False):
        pass
    assert said == []
    assert capsys.readouterr().err == ""


def test_who_waits_for_the_compiler_is_told_that_it_is_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from numba import njit

    monkeypatch.setattr("fopi_tune.cli.output._FIRST_NOTE_S", 0.05)
    said: list[str] = []
    monkeypatch.setattr("fopi_tune.cli.output.say", said.append)
    with still_running_notes("s: still tuning", quiet=False):
        while not said:
            njit(lambda x: x + 1)(1.0)
        for _ in range(10):
            njit(lambda x: x + 1)(1.0)
    assert any("still tuning after" in words and "(compiling the search: one to two minutes" in words for words in said)


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("words", "at", "found"),
    [("fopi tu", 1, ["tune"]), ("fopi tune --sol", 2, ["--solver"]), ("fopi tune --solver ", 3, ["ipopt", "convex"])],
)
def test_a_shell_completes_commands_options_and_their_words(words: str, at: int, found: list[str]) -> None:
    done = python(
        "from fopi_tune.cli import main; import sys; sys.argv = ['fopi']; main()",
        _FOPI_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=str(at),
    )  # fmt: skip
    assert done.stdout.split() == found
    assert done.stderr == ""


def test_every_command_is_told_in_one_whole_line_of_the_help() -> None:
    told = fopi("--help").stdout
    lines = told[told.index("Commands:") :].splitlines()[1:]
    commands = [line for line in lines[: lines.index("")] if line]
    assert [line.split()[0] for line in commands] == [
        c.callback.__name__ for c in app.registered_commands if c.callback
    ]
    assert not [line for line in commands if line.endswith("...")]


def test_a_bound_of_other_gains_is_for_one_design_by_ipopt() -> None:
    for arguments in (("--solver", "convex"), ("--tradeoff", "sensitivity_db")):
        refused = fopi("tune", BRAKE_FILE, *arguments, "--bracket")
        assert refused.exit_code == 2
        assert "--bracket belongs to one design by ipopt" in refused.stderr

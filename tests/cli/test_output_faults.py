"""Every single operation on files of `run`, `validate` and `report`, killed, stopped and failing.

Nothing is lost, no file is half, and results of two runs are never taken for those of one.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from cases.fault_points import AVAILABLE, Commands, Ended, How, commands

pytestmark = pytest.mark.skipif(not AVAILABLE, reason="fault points need Linux and a C compiler")

#: gains and filter differ in the two texts; with fixed gains nothing is searched
SPEC = """\
schema: 1
name: brake
plant: {{model: lag, static_gain: 1.0, time_constant_s: {{nominal: 2.25, min: 1.6, max: 3.1}}, dead_time_s: 0.0}}
controller: {{kp: {kp}, ki: 0.38776, alpha: 0.82038}}
requirements:
  - phase_margin_deg: {{at_least: 80}}
  - sensitivity_db: {{at_most: -19.9}}
    to_rad_s: 0.02
digital: {{sample_time_s: 0.2, method: oustaloup, poles: {poles}, band_rad_s: [1.0e-3, 1.0e3], rule: tustin,
  delay_samples: 0}}
validation: {{samples: 200, seed: 1}}
"""
Files = dict[str, bytes]
#: name of a case -> its command, and the case in whose folder it runs; an empty one where there is none
CASES = {
    "evidence": (("validate", "FIRST"), ""),
    "first": (("run", "FIRST"), "evidence"),
    "run": (("run", "SECOND"), ""),
    "run over an earlier result": (("run", "SECOND"), "first"),
    "validate": (("validate", "FIRST", "--samples", "100"), "first"),
    "report": (("report", "FIRST"), "first"),
}


def files_in(folder: Path) -> dict[str, bytes]:
    """What is there under final names."""
    found = (path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("."))
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def litter_in(folder: Path) -> list[str]:
    return [path.name for path in folder.rglob(".*")]


@dataclass(frozen=True)
class Case:
    """A command that writes into a folder of results.

    Args:
        arguments: of `fopi`, without the folder.
        before: the files that are there.
        after: those of an undisturbed run.
        operations: its operations on files.
    """

    arguments: tuple[object, ...]
    before: Files
    after: Files
    operations: tuple[str, ...]


@dataclass(frozen=True)
class Bench:
    """What the tests share: the process that runs commands, two specs, and the cases that were made."""

    tool: Commands
    first: Path
    second: Path
    root: Path
    made: dict[str, Case]

    def folder(self, files: Files) -> Path:
        """The folder of results, with these files alone."""
        folder = self.root / "results"
        shutil.rmtree(folder, ignore_errors=True)
        for name, content in files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        return folder

    def case(self, name: str) -> Case:
        """A case by its name."""
        if name not in self.made:
            arguments, base = CASES[name]
            before = self.case(base).after if base else {}
            if name == "report":
                before = before | {"report.html": b"an earlier one"}
            files = {"FIRST": self.first, "SECOND": self.second}
            self.made[name] = self._counted(tuple(files.get(word, word) for word in arguments), before)
        return self.made[name]

    def _counted(self, arguments: tuple[object, ...], before: Files) -> Case:
        folder = self.folder(before)
        assert self.tool.run(*arguments, *options(folder)).status == 0
        after = files_in(folder)
        folder = self.folder(before)
        ended = self.tool.disturb(*arguments, *options(folder), folder=folder)
        assert ended.status == 0, ended.err
        assert files_in(folder) == after, "equal input gives equal bytes"
        return Case(arguments, before, after, ended.operations)


def options(folder: Path) -> tuple[object, ...]:
    return ("--quiet", "--out", folder)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    root = tmp_path_factory.mktemp("faults")
    first, second = root / "first.yaml", root / "second.yaml"
    first.write_text(SPEC.format(kp=0.38512, poles=7), encoding="utf-8")
    # another limit too: a certificate is about plants, requirements and the gains that it states
    second.write_text(SPEC.format(kp=0.39, poles=4).replace("at_least: 80", "at_least: 79"), encoding="utf-8")
    with commands(root) as tool:
        yield Bench(tool, first, second, root, {})


def some_and_all(**steps: int) -> list[Any]:
    """Of each case every n-th operation, n no multiple of the four that write a file; in the long tests all."""
    names = {"run": "run over an earlier result", "new": "run", "validate": "validate", "report": "report"}
    some = [pytest.param(names[name], step, id=f"{name}-some") for name, step in steps.items()]
    every = [pytest.param(case, 1, id=f"{name}-all", marks=pytest.mark.long) for name, case in names.items()]
    return [*some, *every]


def check_whole(folder: Path, case: Case) -> None:
    """Every file is the old one or the new one; what is left of a write that was cut off is hidden."""
    for name, content in files_in(folder).items():
        assert content in (case.before.get(name), case.after.get(name)), f"{name} is neither the old nor the new one"
    assert set(case.before) <= set(files_in(folder))


def check_told(bench: Bench, folder: Path) -> None:
    """`fopi report` refuses, or shows one result whole, or says what it leaves out."""
    found = files_in(folder)
    told = bench.tool.run("report", folder, "--quiet")
    if told.status == 2:
        assert told.err.startswith(("brake: ", str(folder))), told.err
        return
    assert told.status == 0, told.err
    of_one = [case for case in bench.made.values() if is_of(found, case.after)]
    assert of_one or "is left out" in told.err, told.err


def is_of(found: Files, after: Files) -> bool:
    """Whether all that a result is, and the code that was made of it, are those of one run; pages are made again."""
    kept = {name for name in {*found, *after} if name.endswith((".json", ".yaml", ".c", ".h", ".csv"))}
    return all(found.get(name) == after.get(name) for name in kept)


def check_recheck(bench: Bench, folder: Path) -> None:
    """A certificate is sound; with the spec beside it where it is of that spec, and refused otherwise."""
    found = files_in(folder)
    for name in {"certificate.json", "digital_certificate.json"} & set(found):
        assert bench.tool.run("prove", "--recheck", folder / name).status == 0
        if "spec.yaml" in found:
            of_spec = bench.tool.run("prove", folder / "spec.yaml", "--recheck", folder / name)
            pair = ("spec.yaml", name)
            belongs = any(all(found[n] == case.after.get(n) for n in pair) for case in bench.made.values())
            assert (of_spec.status == 0) == belongs, of_spec.err


def check_again(bench: Bench, folder: Path, case: Case) -> None:
    """The same command again ends with the bytes of an undisturbed one."""
    again = bench.tool.run(*case.arguments, *options(folder))
    assert again.status == 0, again.err
    wanted = {**case.before, **case.after}
    assert files_in(folder) == wanted


@pytest.mark.parametrize(("name", "step"), some_and_all(run=79, new=63, validate=7, report=79))
def test_a_command_killed_at_an_operation_leaves_old_and_new_files_that_are_told_apart(
    bench: Bench, name: str, step: int
) -> None:
    case = bench.case(name)
    assert {line.split()[0] for line in case.operations} >= {"create", "write", "sync", "rename"}
    rechecked = set[tuple[bytes | None, ...]]()
    for at in range(1, len(case.operations) + 1, step):
        for how in (How.KILL_BEFORE, How.KILL_AMID):
            folder = bench.folder(case.before)
            ended = bench.tool.disturb(*case.arguments, *options(folder), folder=folder, at=at, how=how)
            assert ended.status == -9, (at, ended)
            check_whole(folder, case)
            assert all(left.endswith(".tmp") for left in litter_in(folder))
            found = files_in(folder)
            proofs = tuple(found.get(n) for n in ("spec.yaml", "certificate.json", "digital_certificate.json"))
            if proofs not in rechecked:
                check_recheck(bench, folder)
                rechecked.add(proofs)
            check_told(bench, folder)
            if name != "report":  # which reads what is there, and has just been run
                folder = again_as_killed(bench, found, folder)
            check_again(bench, folder, case)


def again_as_killed(bench: Bench, found: Files, folder: Path) -> Path:
    """The files as the kill left them, with its litter."""
    litter = {path.relative_to(folder): path.read_bytes() for path in folder.rglob(".*")}
    folder = bench.folder(found)
    for path, content in litter.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)
    return folder


def check_said(ended: Ended, folder: Path, why: str) -> None:
    """Exit code 2, and one line that says what, where, why and what to do."""
    assert ended.status == 2, ended
    (line,) = ended.err.splitlines()
    assert line.startswith(f"brake: cannot write {folder}/"), line
    assert f"({why})" in line
    assert "--out" in line


@pytest.mark.parametrize(("name", "step"), some_and_all(run=67, validate=7, report=79))
def test_a_full_disk_is_told_and_nothing_is_lost(bench: Bench, name: str, step: int) -> None:
    check_failing(bench, name, step, How.FULL_DISK, "No space left on device")


@pytest.mark.parametrize(("name", "step"), some_and_all(validate=1))
def test_an_error_of_the_disk_is_told_and_nothing_is_lost(bench: Bench, name: str, step: int) -> None:
    check_failing(bench, name, step, How.FAIL_ONCE, "Input/output error")


def check_failing(bench: Bench, name: str, step: int, how: How, why: str) -> None:
    case = bench.case(name)
    for at in range(1, len(case.operations) + 1, step):
        folder = bench.folder(case.before)
        ended = bench.tool.disturb(*case.arguments, *options(folder), folder=folder, at=at, how=how)
        check_said(ended, folder, why)
        check_whole(folder, case)
        assert litter_in(folder) == []
        if name != "report":
            assert ended.out.startswith("brake"), "the result is printed all the same"
        check_again(bench, folder, case)


@pytest.mark.parametrize("name", ["run", "run over an earlier result", "validate", "report"])
def test_a_read_only_folder_is_told_and_stays_as_it_is(bench: Bench, name: str) -> None:
    case = bench.case(name)
    folder = bench.folder(case.before)
    ended = bench.tool.disturb(*case.arguments, *options(folder), folder=folder, how=How.READ_ONLY)
    check_said(ended, folder, "Read-only file system")
    assert files_in(folder) == case.before
    assert litter_in(folder) == []


# a file takes four operations: of every seventh one each kind is met
@pytest.mark.parametrize("step", [37, pytest.param(7, marks=pytest.mark.long)])
def test_two_runs_into_one_folder_leave_whole_files_that_are_told_apart(bench: Bench, step: int) -> None:
    case, other = bench.case("run"), bench.case("first")
    folder = bench.folder(other.before)
    one = (*case.arguments, *options(folder))
    # in a folder that is there already, which is one operation less
    count = len(bench.tool.disturb(*one, folder=folder).operations)
    for at in range(1, count + 1, step):
        bench.folder(other.before)
        first, second = bench.tool.run_two(one, (*other.arguments, *options(folder)), folder, at)
        assert (first.status, second.status) == (0, 0), (first.err, second.err)
        for name, content in files_in(folder).items():
            assert content in (case.after.get(name), other.after.get(name)), name
        assert litter_in(folder) == []
        check_told(bench, folder)

"""Commands that read a file which was damaged:  a folder of good files, and for each the commands that read it.

`run_in_child` runs commands in a process of their own and measures them, so that one that hangs, grows or crashes is
seen and harms nobody.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import pickle
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cases.fuzz import damaged, damaged_json
from cases.project import IMPORTED, ROOT
from typer.testing import CliRunner

from fopi_tune.cli import app

GAINS = ("--kp", "0.38512473433142086", "--ki", "0.3877569243622711", "--alpha", "0.8203825948834322")
SHIPPED = tuple(
    path.relative_to(ROOT).as_posix()
    for name in ("specs", "systems", "studies")
    for path in sorted((ROOT / name).glob("*.yaml"))
)
#: systems whose gains are designed when they are simulated
DESIGNED = ("systems/car.yaml", "systems/car_held.yaml", "systems/car_comfort.yaml")
_SAMPLES_SPEC = "validation: {samples_file: draws.csv}\n"
_SAMPLES = "time_constant_s\n" + "".join(f"{2.0 + k / 50}\n" for k in range(20))
_RECORDING = "time_s,input,output\n" + "".join(
    f"{k},{int(k >= 10)},{max(0.0, 2.0 * (1 - 0.7 ** (k - 12))) if k > 12 else 0.0:.6f}\n" for k in range(40)
)
#: seconds and bytes that a command may take for a file of a few KiB; the base is what the libraries take
MOST_CPU_S, MOST_BYTES = 5.0, 300 * 2**20
#: of the clock, until a command is taken to hang; other processes may need the processor
_MOST_WALL_S = 120
#: copies of the good files, below the folder
GOOD = "good"


@dataclass(frozen=True)
class Target:
    """A file that is damaged, and a command that reads it.

    Args:
        file: relative to the folder.
        arguments: of the command.
        damage: bytes and chance to bytes.
    """

    file: str
    arguments: tuple[str, ...]
    damage: Callable[[bytes, random.Random], bytes]


def prepare(folder: Path, specs: Sequence[str]) -> None:
    """Fill a folder with the shipped files, files of samples and recordings, and results of some specs."""
    for name in ("specs", "systems", "studies"):
        shutil.copytree(ROOT / name, folder / name)
    spec = (ROOT / "specs" / "brake.yaml").read_text(encoding="utf-8")
    lines = [line for line in spec.splitlines(keepends=True) if not line.startswith("validation:")]
    (folder / "listed.yaml").write_text("".join(lines) + _SAMPLES_SPEC, encoding="utf-8")
    (folder / "draws.csv").write_text(_SAMPLES, encoding="utf-8")
    (folder / "step.csv").write_text(_RECORDING, encoding="utf-8")
    study = "schema: 1\nname: one\nspecs: [listed.yaml]\nstages: [tune]\ncollect: {kp: tune.gains.kp}\n"
    (folder / "listed_study.yaml").write_text(study, encoding="utf-8")
    for name in specs:
        spec_file, out = str(folder / "specs" / f"{name}.yaml"), str(folder / name)
        for words in (["run"], ["validate", "--samples", "30"]):
            made = CliRunner().invoke(app, [*words, spec_file, "--out", out, "-q"])
            assert made.exit_code in (0, 1), made.output
        shutil.copytree(folder / name, folder / f"{name}_again")
        _leave_proofs_out(folder / name, folder / f"{name}_unproved")
    shutil.copytree(folder, folder.parent / GOOD)
    shutil.move(folder.parent / GOOD, folder / GOOD)


def _leave_proofs_out(proved: Path, folder: Path) -> None:
    """Results as --no-proof leaves them: no certificate stands for what they hold."""
    shutil.copytree(proved, folder)
    for file in ("design.json", "digital.json"):
        document = json.loads((folder / file).read_text(encoding="utf-8"))
        document["proof"] = {"verdict": "not_attempted", "reason": "left out on demand: the gains are not proved"}
        for entry in document["requirements"]:
            entry["proof"] = None
        (folder / file).write_text(json.dumps(document), encoding="utf-8")
        (folder / file.replace("design", "certificate").replace("digital.", "digital_certificate.")).unlink()


def spec_targets(folder: Path) -> list[Target]:
    """Specs, studies, systems, and files that a spec names: commands that read them and need no solver."""
    targets = []
    for name in SHIPPED:
        path = str(folder / name)
        if name.startswith("studies/"):
            targets.append(Target(name, ("study", path, "--dry-run", "-q"), damaged))
        elif name.startswith("specs/"):
            targets.append(Target(name, ("report", path, "--out", str(folder / "nowhere"), "-q"), damaged))
    targets.append(Target("draws.csv", ("study", str(folder / "listed_study.yaml"), "--dry-run", "-q"), damaged))
    arguments = ("init", "x", "--no-schema", "--force", "--out", str(folder / "x.yaml"), "--from-step-data")
    targets.append(Target("step.csv", (*arguments, str(folder / "step.csv")), damaged))
    return targets


def computing_targets(folder: Path) -> list[Target]:
    """The same, and commands that simulate a loop or a system with given gains."""
    targets = spec_targets(folder)
    for name in SHIPPED:
        path, out = str(folder / name), ("--out", str(folder / "out"), "-q")
        if name.startswith("systems/") and name not in DESIGNED:
            targets.append(Target(name, ("simulate", path, *out), damaged))
        elif name.startswith("specs/"):
            targets.append(Target(name, ("discretize", path, *GAINS, "--no-proof", *out), damaged))
            targets.append(Target(name, ("validate", path, *GAINS, "--samples", "5", *out), damaged))
    return targets


def result_targets(folder: Path, name: str) -> list[Target]:
    """Results of a spec: the report made again, a comparison, and the recheck of certificates."""
    results, spec = str(folder / name), str(folder / "specs" / f"{name}.yaml")
    report = ("report", results, "-q")
    compare = ("report", "--compare", results, str(folder / f"{name}_again"), "--out", str(folder / "pages"), "-q")
    unproved = str(folder / f"{name}_unproved")
    targets = []
    for file in ("design.json", "digital.json", "evidence.json", "certificate.json", "digital_certificate.json"):
        targets += [Target(f"{name}/{file}", words, damaged_json) for words in (report, compare)]
    # no certificate stands for what these hold
    for file in ("design.json", "digital.json", "evidence.json"):
        words = ("report", unproved, "-q")
        targets.append(Target(f"{name}_unproved/{file}", words, damaged_json))
        words = ("report", "--compare", unproved, results, *compare[4:])
        targets.append(Target(f"{name}_unproved/{file}", words, damaged_json))
    for file in ("certificate.json", "digital_certificate.json"):
        path = str(folder / name / file)
        targets.append(Target(f"{name}/{file}", ("prove", "--recheck", path), damaged_json))
        targets.append(Target(f"{name}/{file}", ("prove", "--recheck", path, spec, "--json"), damaged_json))
    certificate = str(folder / name / "certificate.json")
    targets.append(Target(f"specs/{name}.yaml", ("prove", "--recheck", certificate, spec), damaged))
    return targets


@dataclass(frozen=True)
class Mutant:
    """A damaged file in place of a good one, and the command that reads it.

    Args:
        target: the file and the command.
        data: what the file holds instead.
    """

    target: Target
    data: bytes


@dataclass(frozen=True)
class Ended:
    """The end of a command.

    Args:
        mutant: what it read.
        code: its exit code; below 0 the signal that ended it.
        cpu_s: time of the processor.
        peak_bytes: the most memory that its process had, with commands before it in the same batch.
        words: what it printed.
    """

    mutant: Mutant
    code: int
    cpu_s: float
    peak_bytes: int
    words: str

    @property
    def is_slow(self) -> bool:
        """Whether it took more time of the processor than a command may."""
        return self.cpu_s > MOST_CPU_S

    @property
    def is_well(self) -> bool:
        """Whether it ended as commands must, in memory, and without a warning of a library."""
        bounded = self.peak_bytes <= MOST_BYTES
        return self.code in (0, 1, 2) and bounded and "Warning:" not in self.words and "Traceback" not in self.words


def mutants(targets: Sequence[Target], folder: Path, chance: random.Random, count: int) -> list[Mutant]:
    """Damaged files, drawn by chance."""
    chosen = [chance.choice(targets) for _ in range(count)]
    return [Mutant(target, target.damage((folder / target.file).read_bytes(), chance)) for target in chosen]


def run_in_child(batch: Sequence[Mutant], folder: Path) -> list[Ended]:
    """Run commands one after the other in a new process; after a crash the batch goes on in another.

    It is no fork of this process, which holds what all tests before have imported and computed: the memory that is
    measured would be theirs.
    """
    ends: list[Ended] = []
    log, todo = folder / "said.jsonl", folder / "todo.pickle"
    paths = os.pathsep.join((str(Path(__file__).parents[1]), str(IMPORTED)))
    environment = os.environ | {"PYTHONPATH": paths, "PYTHONSAFEPATH": "1"}
    program = "import sys; from cases.fuzz_commands import run_all; run_all(sys.argv[1], sys.argv[2])"
    while len(ends) < len(batch):
        started = batch[len(ends) :]
        log.write_text("", encoding="utf-8")
        todo.write_bytes(
            pickle.dumps([(folder / each.target.file, each.data, each.target.arguments) for each in started])
        )
        ended = subprocess.run([sys.executable, "-c", program, str(todo), str(log)], env=environment, check=False)
        lines = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
        ends += [Ended(mutant, *line) for mutant, line in zip(started, lines, strict=False)]
        if len(lines) < len(started):
            culprit = started[len(lines)]
            (folder / culprit.target.file).write_bytes(_good(folder, culprit))
            ends.append(Ended(culprit, ended.returncode, MOST_CPU_S, 0, "the process was ended"))
    return ends


def takes_as_long_undamaged(ended: Ended, folder: Path) -> bool:
    """Whether the same command needs a third of the time for the good file: the machine is slow, or gains are designed.

    Other limits than the good file's may take longer to design for.
    """
    good = _good(folder, ended.mutant)
    return 3.0 * run_in_child([Mutant(ended.mutant.target, good)], folder)[0].cpu_s >= ended.cpu_s


def _good(folder: Path, mutant: Mutant) -> bytes:
    return (folder / GOOD / mutant.target.file).read_bytes()


def run_all(todo: str, log: str) -> None:
    """Run commands on damaged files, and write how each ended: code, seconds, peak of memory in bytes, words."""
    for path, data, arguments in pickle.loads(Path(todo).read_bytes()):
        good = path.read_bytes()
        path.write_bytes(data)
        signal.alarm(_MOST_WALL_S)
        began, words = time.process_time(), io.StringIO()
        code = _code_of(arguments, words)
        took = time.process_time() - began
        path.write_bytes(good)
        line = code, took, _peak_bytes(), words.getvalue()
        with open(log, "a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")


def _peak_bytes() -> int:
    """The most memory that this process had; Linux counts into ru_maxrss that of the process which started it."""
    status = Path("/proc/self/status")
    if not status.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    peak = next(line for line in status.read_text(encoding="utf-8").splitlines() if line.startswith("VmHWM:"))
    return int(peak.split()[1]) * 1024


def _code_of(arguments: Sequence[str], words: io.StringIO) -> int:
    with contextlib.redirect_stdout(words), contextlib.redirect_stderr(words):
        try:
            app(list(arguments), prog_name="fopi")
        except SystemExit as end:
            return end.code if isinstance(end.code, int) else 1
        except BaseException:
            traceback.print_exc(file=words)
            return 98
    return 0

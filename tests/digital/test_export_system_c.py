"""A system in C: compiled, replayed bit for bit, against the compiled simulation, and with hostile texts."""

from __future__ import annotations

import itertools
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cases.thinned import thinned

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.digital import Export, Memory, Switching, SystemExport, Units, discretize, export_system_c
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.switched_runtime import SwitchedRuntime, replay
from fopi_tune.digital.system_vectors import COLUMNS, system_operations
from fopi_tune.digital.vectors import Op, Operation
from fopi_tune.errors import DomainError
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import (
    Actuator,
    Hybrid,
    InactiveController,
    InitialInput,
    Mode,
    Scenario,
    Sensor,
    Signals,
    Start,
)
from fopi_tune.spec.model import DigitalSpec

TS = 0.2
FLAGS = [
    *("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"),
    *("-Wstrict-prototypes", "-Wmissing-prototypes", "-Wcast-qual", "-ffp-contract=off"),
]
SANITIZE = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
with_each_compiler = pytest.mark.parametrize(
    "compiler",
    [
        pytest.param(c, marks=pytest.mark.skipif(not shutil.which(c), reason=f"{c} is not found"))
        for c in ("gcc", "clang")
    ],
)
HOSTILE = "*/ #error escaped \\\n??/ \u2028 {{ 1/0 }} /*"


@cache
def mode_export(name: str, gains: FoPi, limits: tuple[float, float] | None, poles: int = 7) -> Export:
    controller = discretize(gains, DigitalSpec(TS, "oustaloup", poles))
    return Export(name, "One mode.", "0123456789abcdef" * 4, "fopi-tune 0", controller, Units("km/h"), limits)


def exported(switching: Switching, **changes: object) -> SystemExport:
    values: dict[str, object] = {
        "name": "Car-1.2",
        "description": "A car.",
        "system_sha256": "fedcba9876543210" * 4,
        "tool": "fopi-tune 0",
        "modes": (
            mode_export("throttle", FoPi(0.09, 0.025, 0.8), (0.0, 1.0)),
            mode_export("brake", FoPi(0.07, 0.11, 0.45), (-1.0, 0.0), 5),
        ),
        "mode_names": ("throttle", "brake"),
        "switching": switching,
        "min_dwell_s": switching.min_dwell_samples * TS,
    }
    return SystemExport(**{**values, **changes})  # pyright: ignore[reportArgumentType]


def pair_of(export: SystemExport, precision: Precision = Precision.FLOAT64) -> SwitchedRuntime:
    one, two = (Runtime.of(mode.controller.sections, precision, mode.limits) for mode in export.modes)
    return SwitchedRuntime((one, two), export.switching)


def built(files: dict[str, str], folder: Path, compiler: str, *flags: str) -> Path:
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="ascii")
    sources = sorted(name for name in files if name.endswith(".c"))
    done = subprocess.run(
        [compiler, *FLAGS, *flags, "-o", "replay", *sources], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder / "replay"


def replayed(program: Path, table: str = "test_vectors.csv") -> subprocess.CompletedProcess[str]:
    return subprocess.run([program, table], cwd=program.parent, capture_output=True, text=True, check=False)


@pytest.mark.thinned(slow=["held", "reset"])
@with_each_compiler
@pytest.mark.parametrize(("memory", "dwell"), thinned(itertools.product(Memory, (5, 0))))
def test_the_vectors_are_met_bit_for_bit(tmp_path: Path, memory: Memory, dwell: int, compiler: str) -> None:
    files = export_system_c(exported(Switching(0.5, memory, dwell, first=dwell % 2)))
    for level in ("-O0", "-O2"):
        done = replayed(built(files, tmp_path / level[1:], compiler, level))
        assert done.returncode == 0, done.stdout + done.stderr
        assert "rows are equal bit for bit" in done.stdout
    sanitized = built(files, tmp_path / "sanitized", compiler, "-O1", *SANITIZE)
    assert replayed(sanitized).returncode == 0


@pytest.mark.thinned(2)
@pytest.mark.parametrize("dwell", [0, 5])
@pytest.mark.parametrize("memory", Memory)
def test_the_vectors_switch_saturate_and_wait(memory: Memory, dwell: int) -> None:
    pair = pair_of(exported(Switching(0.5, memory, dwell)))
    operations = system_operations(pair)
    # as text, in which a NaN equals another
    assert repr(operations) == repr(system_operations(pair))
    outputs, modes = replay(pair, operations)
    assert {-1.0, 0.0, 1.0} <= set(outputs.tolist())
    switches = np.flatnonzero(modes[1:] != modes[:-1]) + 1
    assert len(switches) > 150
    stepped = np.array([one.op is Op.STEP for one in operations])
    apart = [b - a for a, b in itertools.pairwise(switches) if stepped[a : b + 1].all()]
    assert min(apart) == max(dwell, 1)
    assert any(np.isnan(one.measurement) for one in operations)
    # another memory or dwell would have been seen
    for other in (Switching(0.5, memory, dwell + 1), *(Switching(0.5, m, dwell) for m in Memory if m is not memory)):
        found, found_modes = replay(SwitchedRuntime(pair.controllers, other), operations)
        plain = other.min_dwell_samples == 1
        assert plain or found.tobytes() != outputs.tobytes() or not np.array_equal(found_modes, modes)


@pytest.mark.thinned(slow=["held"])
@with_each_compiler
@pytest.mark.parametrize(("memory", "dwell", "delay"), thinned(itertools.product(Memory, (0, 7), (0.0, 0.6, 2.0)), 5))
def test_long_random_runs_are_the_compiled_simulation_bit_for_bit(
    tmp_path: Path, memory: Memory, dwell: int, delay: float, compiler: str
) -> None:
    export = exported(Switching(0.5, memory, dwell))
    pair, single = pair_of(export), pair_of(export, Precision.FLOAT32)
    rng, samples = np.random.default_rng(11), 4000
    levels = np.repeat(rng.uniform(2.0, 24.0, samples // 50), 50)
    # the last fifth rests
    levels[-samples // 5 :] = 0.0
    hybrid = Hybrid(0.5, InactiveController.of(memory), min_dwell_samples=dwell)
    start, actuator = Start(2.0, InitialInput.FREE), Actuator(delay_samples=delay)
    scenario = Scenario(TS, Signals(levels), Sensor(0.0, 0.4, 5), actuator, start, hybrid)
    # the second pair's output overflows
    throttle, brake = np.array([[1.0, 0.17], [1.0, -1.0]]), np.array([[2.25, 1.0], [2.25, -5.0]])
    plants = Plants(np.full((2, 1), 4.39), throttle, np.zeros(2)), Plants(np.ones((2, 1)), brake, np.zeros(2))
    modes = [Mode(controller, each) for controller, each in zip(pair.controllers, plants, strict=True)]
    traces = simulate(modes, scenario)
    assert np.isfinite(traces.measured[0]).all()
    assert not np.isfinite(traces.measured[1]).all()
    assert np.sum(traces.mode[0, 1:] != traces.mode[0, :-1]) > 50
    low, high = (np.min(traces.demanded[0]), np.max(traces.demanded[0]))
    assert (low, high) == (-1.0, 1.0)
    program = built(export_system_c(export), tmp_path, compiler, "-O2")
    for row in range(2):
        steps = list(zip(levels.tolist(), traces.measured[row].tolist(), strict=True))
        floats, float_modes = replay(single, [Operation(Op.STEP, *step) for step in steps])
        lines = [COLUMNS, ",".join(["init", *[(0.0).hex()] * 5, "1,1"])]
        for k, step in enumerate(steps):
            expected = float(traces.demanded[row, k]), float(floats[k])
            numbers = ",".join(float(x).hex() for x in (*step, 0.0, *expected))
            lines.append(f"step,{numbers},{traces.mode[row, k]},{1 + float_modes[k]}")
        (tmp_path / "run.csv").write_text("\n".join([*lines, ""]))
        done = replayed(program, "run.csv")
        assert done.returncode == 0, done.stdout + done.stderr


@with_each_compiler
def test_a_wrong_output_or_mode_is_told(tmp_path: Path, compiler: str) -> None:
    files = export_system_c(exported(Switching(0.5, Memory.RESET, 2)))
    program = built(files, tmp_path, compiler)
    lines = files["test_vectors.csv"].splitlines()
    place = next(k for k, line in enumerate(lines) if line.startswith("step") and line.endswith(",2,2"))
    for wrong in (lines[place][:-1] + "1", lines[place][:-3] + "1,2", lines[place].replace("step", "track")):
        (tmp_path / "wrong.csv").write_text("\n".join([*lines[:place], wrong, ""]))
        assert replayed(program, "wrong.csv").returncode == (2 if "track" in wrong else 1)


@with_each_compiler
def test_headers_of_another_export_are_refused(tmp_path: Path, compiler: str) -> None:
    one, two = (export_system_c(exported(Switching(0.5), modes=modes)) for modes in (
        exported(Switching(0.5)).modes,
        (mode_export("throttle", FoPi(0.1, 0.025, 0.8), (0.0, 1.0)), exported(Switching(0.5)).modes[1]),
    ))  # fmt: skip
    name = "fopi_car_1_2_throttle_f32"
    mixed = {**one, f"{name}.h": two[f"{name}.h"], f"{name}.c": two[f"{name}.c"]}
    with pytest.raises(AssertionError, match="is of another export than this file: export all again"):
        built(mixed, tmp_path, compiler)


@with_each_compiler
@pytest.mark.parametrize("memory", thinned(Memory, every=3))
def test_controllers_without_an_integral_or_limits_are_exported_too(
    tmp_path: Path, compiler: str, memory: Memory
) -> None:
    modes = mode_export("one", FoPi(0.3, 0.0, 0.8), None), mode_export("two", FoPi(0.2, 0.1, 1.0), (-3.0, 2.0))
    export = exported(Switching(0.0, memory, 3), modes=modes)
    done = replayed(built(export_system_c(export), tmp_path / memory.value, compiler))
    assert done.returncode == 0, done.stdout + done.stderr


@with_each_compiler
def test_texts_cannot_leave_their_comments(tmp_path: Path, compiler: str) -> None:
    plain = exported(Switching(0.5, Memory.TRACKING, 2))
    hostile = exported(plain.switching, description=HOSTILE, system_sha256=HOSTILE, tool=HOSTILE)
    assert replayed(built(export_system_c(hostile), tmp_path, compiler)).returncode == 0
    with pytest.raises(DomainError, match="cannot name files"):
        export_system_c(exported(plain.switching, name="../car"))


def test_the_header_has_the_numbers() -> None:
    files = export_system_c(exported(Switching(0.5, Memory.RESET, 4), min_dwell_s=0.7))
    header = re.sub(r"\s*\n \*\s*|\s+", " ", files["fopi_car_1_2_f32.h"])
    for words in (
        "System: Car-1.2, sha256 fedcba98",
        "Sample time: 0.2 s",
        "Mode 1: throttle, kp = 0.09, ki = 0.025, alpha = 0.8, limits: 0.0 to 1.0",
        "Mode 2: brake, kp = 0.07, ki = 0.11, alpha = 0.45, limits: -1.0 to 0.0",
        "Setpoint: km/h",
        "measurement >= setpoint + eps, back when measurement <= setpoint - eps; eps = 0.5",
        "a mode stays at least 4 samples after it was entered, 0.8 s, rounded up from 0.7 s",
        "of the inactive controller: starts anew, at an output of 0, when its mode is entered",
    ):
        assert words in header, words
    assert "none; a mode may be left" in export_system_c(exported(Switching(0.5)))["fopi_car_1_2_f64.h"]
    assert "call that one's" in files["fopi_car_1_2_brake_f64.h"]


def test_equal_systems_give_equal_bytes_and_others_another_export() -> None:
    first, again = (export_system_c(exported(Switching(0.5, Memory.RESET, 4))) for _ in range(2))
    assert first == again
    others = (
        export_system_c(exported(switching))
        for switching in (Switching(0.5, Memory.RESET, 3), Switching(0.6, Memory.RESET, 4))
    )
    found = set()
    for files in (first, *others):
        found |= set(re.findall(r"_EXPORT (0x\w+)", files["fopi_car_1_2_f64.h"]))
    assert len(found) == 3


def test_a_hysteresis_beyond_float_is_refused() -> None:
    with pytest.raises(DomainError, match="hysteresis"):
        export_system_c(exported(Switching(1e39)))

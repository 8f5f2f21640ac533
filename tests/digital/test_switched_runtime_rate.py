"""Two modes that limit the rate of their outputs: the runtime, the compiled simulation and C are the same bits."""

from __future__ import annotations

import math
import shutil
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.digital import Export, Memory, Switching, SystemExport, discretize, export_system_c
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.switched_runtime import SwitchedRuntime, init, replay, step
from fopi_tune.digital.system_vectors import COLUMNS
from fopi_tune.digital.vectors import Op, Operation
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import (
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

#: to measure what rounding does to a filter takes a tenth of a second
discretized = cache(discretize)

TS = 0.2
FLAGS = [
    *("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"),
    *("-Wstrict-prototypes", "-Wmissing-prototypes", "-Wcast-qual", "-ffp-contract=off", "-O2"),
]
#: of throttle and brake, per s
BOTH, BRAKE_ALONE = (0.3, 0.5), (None, 0.5)


@cache
def modes(rates: tuple[float | None, float | None]) -> tuple[Export, Export]:
    """Limits that overlap, so that what the other mode had is seldom at a limit of the entered one."""
    throttle = discretized(FoPi(0.09, 0.025, 0.8), DigitalSpec(TS))
    brake = discretized(FoPi(0.07, 0.11, 0.45), DigitalSpec(TS, "oustaloup", 5))
    one = Export("throttle", "", "0" * 64, "fopi-tune 0", throttle, limits=(-0.2, 1.0), rate_per_s=rates[0])
    return one, Export("brake", "", "0" * 64, "fopi-tune 0", brake, limits=(-1.0, 0.1), rate_per_s=rates[1])


def pair_of(
    rates: tuple[float | None, float | None], switching: Switching, precision: Precision = Precision.FLOAT64
) -> SwitchedRuntime:
    one, two = (Runtime.of(mode.controller.sections, precision, mode.limits, mode.rate_per_s) for mode in modes(rates))
    return SwitchedRuntime((one, two), switching)


def driven(pair: SwitchedRuntime, samples: int) -> tuple[list[Operation], np.ndarray, np.ndarray]:
    """What a loop measured, and the compiled simulation's outputs and modes."""
    levels = np.repeat(np.array([18.0, 6.0, 10.0, 24.0, 3.0]), samples // 5)
    hybrid = Hybrid(
        pair.lines,
        InactiveController.of(pair.switching.memory),
        min_dwell_samples=pair.switching.min_dwell_samples,
    )
    scenario = Scenario(TS, Signals(levels), Sensor(0.0, 0.3, 5), start=Start(2.0, InitialInput.FREE), hybrid=hybrid)
    plants = (
        Plants(np.full((1, 1), 4.4), np.array([[1.0, 0.2]]), np.zeros(1)),
        Plants(np.ones((1, 1)), np.array([[2.2, 1.0]]), np.zeros(1)),
    )
    loops = [Mode(controller, plant) for controller, plant in zip(pair.controllers, plants, strict=True)]
    traces = simulate(loops, scenario)
    pairs = zip(levels.tolist(), traces.measured[0].tolist(), strict=True)
    return [Operation(Op.STEP, *each) for each in pairs], traces.demanded[0], traces.mode[0]


@pytest.mark.parametrize("rates", [BOTH, BRAKE_ALONE], ids=["both", "brake"])
@pytest.mark.parametrize("memory", Memory)
def test_the_pair_is_the_compiled_simulation_bit_for_bit(
    memory: Memory, rates: tuple[float | None, float | None]
) -> None:
    for dwell in (0, 7):
        pair = pair_of(rates, Switching(0.4, memory, dwell))
        operations, demanded, mode = driven(pair, 600)
        outputs, found = replay(pair, operations)
        assert outputs.tobytes() == demanded.tobytes()
        np.testing.assert_array_equal(found + 1, mode)
        assert np.sum(np.diff(mode) != 0) > 3


@pytest.mark.thinned(slow=["held", "tracking"])
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("memory", Memory)
def test_the_c_code_of_a_system_is_the_same_bits(tmp_path: Path, memory: Memory, compiler: str) -> None:
    if not shutil.which(compiler):
        pytest.skip(f"{compiler} is not found")
    for number, rates in enumerate((BOTH, BRAKE_ALONE)):
        switching, folder = Switching(0.4, memory, 3 * number), tmp_path / str(number)
        folder.mkdir()
        files = export_system_c(
            SystemExport("Car", "", "0" * 64, "fopi-tune 0", modes(rates), ("throttle", "brake"), switching)
        )
        for name, text in files.items():
            (folder / name).write_text(text, encoding="ascii")
        sources = sorted(name for name in files if name.endswith(".c"))
        command = [compiler, *FLAGS, "-o", "replay", *sources]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        operations, demanded, mode = driven(pair_of(rates, switching), 4000)
        floats, float_modes = replay(pair_of(rates, switching, Precision.FLOAT32), operations)
        lines = [COLUMNS, ",".join(["init", *[(0.0).hex()] * 5, "1,1"])]
        for k, one in enumerate(operations):
            numbers = (one.setpoint, one.measurement, 0.0, float(demanded[k]), float(floats[k]))
            lines.append(f"step,{','.join(x.hex() for x in numbers)},{mode[k]},{1 + float_modes[k]}")
        (folder / "run.csv").write_text("\n".join([*lines, ""]))
        for table in ("test_vectors.csv", "run.csv"):
            done = subprocess.run([folder / "replay", table], cwd=folder, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stdout + done.stderr
        assert f"rate: {rates[1]} per s" in files["fopi_car_f64.h"].replace("\n *             ", "")


@pytest.mark.parametrize("memory", Memory)
def test_the_entered_mode_goes_on_from_what_the_other_had(memory: Memory) -> None:
    pair = pair_of(BOTH, Switching(0.5, memory))
    state = init(pair)
    for _ in range(30):
        state = step(pair, state, 10.0, 2.0)
    before = float(state.output)
    assert state.mode == 0
    assert before > 0.5
    # the brake's upper limit is 0.1; its rate is 0.1 a sample
    entered = step(pair, state, 10.0, 40.0)
    assert entered.mode == 1
    assert float(entered.output) == pytest.approx(0.0, abs=1e-15)
    held = step(pair, entered, 10.0, math.nan)
    assert held.output == entered.output


def test_a_rate_that_is_never_reached_changes_no_bit() -> None:
    for memory in Memory:
        free = pair_of((None, None), Switching(0.4, memory))
        fast = replace(free, controllers=(replace(free.controllers[0], most_change=9.0), free.controllers[1]))
        operations, demanded, _ = driven(free, 600)
        assert replay(fast, operations)[0].tobytes() == demanded.tobytes()

"""Two controllers with a derivative that take turns: in C and in the compiled simulation, bit for bit the same."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases.thinned import thinned

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.switching_lines import SwitchingLines, Threshold
from fopi_tune.digital import Memory, Switching, SystemExport, export_system_c
from fopi_tune.digital.inactive import observe, restarted
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime, init, reset, step
from fopi_tune.digital.switched_runtime import COASTING, SwitchedRuntime, replay
from fopi_tune.digital.switched_runtime import init as pair_init
from fopi_tune.digital.switched_runtime import step as pair_step
from fopi_tune.digital.system_vectors import system_vector_table
from fopi_tune.digital.vectors import NOT_FINITE, Op, Operation, in_float32
from tests.digital.test_export_system_c import TS, built, exported, mode_export, replayed, with_each_compiler
from tests.digital.test_switched_runtime import simulated

PID, OTHER = Pid(0.09, 0.03, 0.05, 0.4), Pid(0.07, 0.05, 0.04, 0.3)
ORDERS = FoPid(0.09, 0.025, 0.8, 0.04, 0.7, 0.4)
MIXES = {
    "both": (PID, OTHER),
    "first": (PID, FoPi(0.07, 0.11, 0.45)),
    "second": (FoPi(0.09, 0.025, 0.8), OTHER),
    "orders": (ORDERS, Pid(0.07, 0.0, 0.04, 0.3)),
}
BAND = SwitchingLines(Threshold(0.9), Threshold(-0.7), Threshold(0.1), Threshold(0.2))


def system(mix: str, switching: Switching, rates: tuple[float | None, float | None] = (None, None)) -> SystemExport:
    modes = tuple(
        replace(mode_export(name, gains, limits), rate_per_s=rate)
        for name, gains, limits, rate in zip(
            ("throttle", "brake"), MIXES[mix], ((0.0, 1.0), (-1.0, 0.0)), rates, strict=True
        )
    )
    return exported(switching, modes=modes)


def pair_of(export: SystemExport, precision: Precision = Precision.FLOAT64) -> SwitchedRuntime:
    one, two = (Runtime.of(m.controller.sections, precision, m.limits, m.rate_per_s) for m in export.modes)
    return SwitchedRuntime((one, two), export.switching)


CASES = list(itertools.product(MIXES, Memory, (0.5, BAND), (False, True)))


@with_each_compiler
@pytest.mark.thinned(6)
@pytest.mark.parametrize(("mix", "memory", "lines", "more"), thinned(CASES, every=7))
def test_the_vectors_are_met_bit_for_bit(
    tmp_path: Path, mix: str, memory: Memory, lines: SwitchingLines | float, more: bool, compiler: str
) -> None:
    fed = ((0.03, 0.2), (0.011, 0.0)) if more else ()
    export = system(mix, Switching(lines, memory, 3 * more, fed=fed), (0.5, None) if more else (None, None))
    files = export_system_c(export)
    done = replayed(built(files, tmp_path, compiler, "-O2"))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "rows are equal bit for bit" in done.stdout


@pytest.mark.thinned(4)
@pytest.mark.parametrize("dwell", [0, 9])
@pytest.mark.parametrize("memory", Memory)
@pytest.mark.parametrize("mix", MIXES)
def test_the_pair_is_the_compiled_simulation_bit_for_bit(mix: str, memory: Memory, dwell: int) -> None:
    switches = 0
    for lines in (0.4, BAND):
        pair = pair_of(system(mix, Switching(lines, memory, dwell, dwell % 2), (0.6, None) if dwell else (None, None)))
        levels, traces = simulated(pair, 600, 0.3)
        for measured, demanded, mode in zip(traces.measured, traces.demanded, traces.mode, strict=True):
            steps = zip(levels, measured, strict=True)
            outputs, modes = replay(pair, [Operation(Op.STEP, float(r), float(y)) for r, y in steps])
            assert outputs.tobytes() == demanded.tobytes()
            np.testing.assert_array_equal(modes + 1, mode)
            switches += int(np.sum(mode[1:] != mode[:-1]))
    assert switches > 40


@pytest.mark.parametrize("precision", Precision)
@pytest.mark.parametrize("gains", [PID, ORDERS])
def test_the_measurements_behind_the_lags_are_those_of_a_controller_that_steps(
    gains: Pid, precision: Precision
) -> None:
    runtime = Runtime.of(mode_export("a", gains, (-1.0, 1.0)).controller.sections, precision, (-1.0, 1.0))
    draw, idle, active = random.Random(3), init(runtime), init(runtime)
    for k in range(400):
        r, y = draw.uniform(-1.0, 1.0), draw.uniform(-1.0, 1.0) if k < 200 else 0.0
        if k % 17 == 0:
            r = draw.choice(NOT_FINITE)
        idle, active = observe(runtime, idle, r, y), step(runtime, active, r, y)
        assert idle.filtered is not None
        assert active.filtered is not None
        assert idle.filtered.tobytes() == active.filtered.tobytes()
        assert idle.is_new == active.is_new
        assert not idle.x.any()
    entered = restarted(runtime, active)
    assert entered.filtered is active.filtered
    assert entered.x.tobytes() == init(runtime).x.tobytes()
    # a PI remembers nothing of the measurement
    plain = Runtime.of(mode_export("b", FoPi(0.1, 0.1, 1.0), (-1.0, 1.0)).controller.sections, precision)
    rest = reset(plain, 0.3)
    assert observe(plain, rest, 1.0, 0.0) is rest


@pytest.mark.parametrize("memory", Memory)
@pytest.mark.parametrize("lines", [0.5, BAND], ids=["turns", "band"])
def test_a_change_of_the_mode_is_no_kick_of_the_derivative(memory: Memory, lines: SwitchingLines | float) -> None:
    # a steady ramp through the setpoint: the derivative term of a controller that was never inactive
    kd, tf, slope, setpoint = 0.05, 0.4, 0.2, 10.0
    gains = Pid(0.0, 0.0, kd, tf), Pid(0.0, 0.0, kd, tf)
    modes = tuple(mode_export(name, each, (-1.0, 1.0)) for name, each in zip(("a", "b"), gains, strict=True))
    pair = pair_of(exported(Switching(lines, memory), modes=modes))
    state, seen = pair_init(pair), []
    for k in range(120):
        state = pair_step(pair, state, setpoint, setpoint - 12.0 + slope * k)
        if state.mode == COASTING:
            continue
        seen.append((state.mode, float(state.output)))
    assert {mode for mode, _ in seen} == {0, 1}
    steady = -kd * slope / TS
    late = [output for _, output in seen[20:]]
    np.testing.assert_allclose(late, steady, rtol=1e-3)


@with_each_compiler
@pytest.mark.parametrize("count", [4000, pytest.param(100_000, marks=pytest.mark.long)])
@pytest.mark.parametrize("memory", [Memory.HELD, Memory.TRACKING])
def test_a_long_drive_is_the_same_bits_in_c(tmp_path: Path, memory: Memory, count: int, compiler: str) -> None:
    export = system("both", Switching(BAND, memory, 2), (2.0, None))
    double, single = (pair_of(export, precision) for precision in (Precision.FLOAT64, Precision.FLOAT32))
    operations = long_drive(count)
    outputs, modes = replay(double, operations)
    assert set(modes.tolist()) == {COASTING, 0, 1}
    assert {-1.0, 0.0, 1.0} <= set(outputs.tolist())
    program = built(export_system_c(export), tmp_path, compiler, "-O2")
    (tmp_path / "run.csv").write_text(system_vector_table(double, single, operations), encoding="ascii")
    done = replayed(program, "run.csv")
    assert done.returncode == 0, done.stdout + done.stderr


def long_drive(count: int) -> list[Operation]:
    """A setpoint that jumps and a measurement that follows it with noise; numbers not finite, and resets."""
    draw, rows, level = random.Random(8), [Operation(Op.INIT)], 0.0
    while len(rows) < count:
        setpoint, noise = draw.uniform(0.0, 20.0), draw.choice((0.0, 0.05, 1.0))
        for _ in range(draw.randrange(5, 80)):
            level += 0.1 * (setpoint - level)
            measured = level + noise * draw.uniform(-1.0, 1.0)
            if draw.random() < 0.01:
                measured = draw.choice(NOT_FINITE)
            rows.append(Operation(Op.STEP, setpoint, measured))
        if draw.random() < 0.05:
            rows.append(Operation(Op.RESET, output=draw.choice((0.0, 0.5, -3.0, *NOT_FINITE))))
    return [in_float32(row) for row in rows[:count]]

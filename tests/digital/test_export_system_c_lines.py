"""Separate lines and coasting in C: replayed bit for bit, against the compiled simulation, and what the header says."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases.thinned import thinned

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.switching_lines import SwitchingLines, Threshold
from fopi_tune.digital import Memory, Switching, export_system_c
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.switched_runtime import COASTING, SwitchedRuntime, init, replay, step
from fopi_tune.digital.system_vectors import system_operations
from fopi_tune.digital.vectors import Op, Operation
from fopi_tune.errors import DomainError
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
from tests.digital.test_export_system_c import TS, built, exported, mode_export, pair_of, replayed, with_each_compiler

RELATIVE = SwitchingLines(Threshold(0.75), Threshold(0.1))
MIXED = SwitchingLines(Threshold(12.3, True), Threshold(-0.7))
BAND = SwitchingLines(Threshold(0.9), Threshold(-0.7), Threshold(0.1), Threshold(0.2))
ABSOLUTE_BAND = SwitchingLines(Threshold(9.0, True), Threshold(-0.7), Threshold(8.1, True), Threshold(0.0))
LINES = {"relative": RELATIVE, "mixed": MIXED, "band": BAND, "absolute-band": ABSOLUTE_BAND}
CASES = [(name, memory, dwell) for dwell in (0, 3) for memory in Memory for name in LINES]


@pytest.mark.thinned(slow=["mixed", "absolute-band"])
@with_each_compiler
@pytest.mark.parametrize(("name", "memory", "dwell"), thinned(CASES, every=5))
def test_the_vectors_are_met_bit_for_bit(tmp_path: Path, name: str, memory: Memory, dwell: int, compiler: str) -> None:
    files = export_system_c(exported(Switching(LINES[name], memory, dwell, first=dwell % 2)))
    done = replayed(built(files, tmp_path, compiler, "-O2"))
    assert done.returncode == 0, done.stdout + done.stderr


@with_each_compiler
def test_a_limited_rate_begins_at_the_output_that_rested(tmp_path: Path, compiler: str) -> None:
    modes = (
        replace(mode_export("throttle", FoPi(0.09, 0.025, 0.8), (0.0, 1.0)), rate_per_s=0.5),
        mode_export("brake", FoPi(0.07, 0.11, 0.45), (-1.0, 0.0), 5),
    )
    export = exported(Switching(BAND), modes=modes)
    done = replayed(built(export_system_c(export), tmp_path, compiler))
    assert done.returncode == 0, done.stdout + done.stderr
    one, two = (Runtime.of(mode.controller.sections, Precision.FLOAT64, mode.limits, mode.rate_per_s) for mode in modes)
    pair = SwitchedRuntime((one, two), export.switching)
    state = init(pair)
    # at its upper limit, coasting, and back: from 0, not from where it was
    for setpoint in [15.0] * 20 + [9.9] + [20.0]:
        state = step(pair, state, setpoint, 10.0)
    assert float(state.output) == pytest.approx(0.5 * TS, abs=1e-15)


#: g and h/Ts of both modes
FED = ((0.03, 0.2), (0.011, 0.0))


@pytest.mark.thinned(slow=["reset"])
@with_each_compiler
@pytest.mark.parametrize("memory", Memory)
def test_a_feed_forward_is_met_bit_for_bit(tmp_path: Path, memory: Memory, compiler: str) -> None:
    without_integral = mode_export("brake", FoPi(0.07, 0.0, 1.0), (-1.0, 0.0))
    modes = exported(Switching(0.5)).modes[0], replace(without_integral, rate_per_s=1.5)
    for name, turns in (("hysteresis", 0.5), ("band", BAND)):
        export = exported(Switching(turns, memory, 2, fed=FED), modes=modes)
        done = replayed(built(export_system_c(export), tmp_path / name, compiler, "-O2"))
        assert done.returncode == 0, done.stdout + done.stderr
    operations = system_operations(pair_of(exported(Switching(0.5, memory))))
    outputs = [replay(pair_of(exported(Switching(0.5, memory, fed=fed))), operations)[0] for fed in (FED, ())]
    assert not np.array_equal(outputs[0], outputs[1])


@pytest.mark.parametrize("memory", Memory)
def test_a_run_that_is_fed_forward_is_the_compiled_simulation_bit_for_bit(memory: Memory) -> None:
    pair = pair_of(exported(Switching(BAND, memory, 2, fed=FED)))
    levels = np.concatenate([np.linspace(2.0, 18.0, 80), np.full(60, 6.0), np.linspace(6.0, 11.0, 60)])
    hybrid = Hybrid(BAND, InactiveController.of(memory), min_dwell_samples=2, fed=FED)
    scenario = Scenario(TS, Signals(levels), Sensor(0.0, 0.4, 5), start=Start(2.0, InitialInput.FREE), hybrid=hybrid)
    plants = (
        Plants(np.array([[4.39]]), np.array([[1.0, 0.17]]), np.zeros(1)),
        Plants(np.array([[1.0]]), np.array([[2.25, 1.0]]), np.zeros(1)),
    )
    found = simulate([Mode(c, each) for c, each in zip(pair.controllers, plants, strict=True)], scenario)
    rows = zip(levels.tolist(), found.measured[0].tolist(), strict=True)
    outputs, modes = replay(pair, [Operation(Op.STEP, *row) for row in rows])
    assert outputs.tobytes() == found.demanded[0].tobytes()
    assert np.array_equal(modes + 1, found.mode[0])


def test_a_sample_that_is_held_leaves_the_setpoint_before_it() -> None:
    pair = pair_of(exported(Switching(0.5, fed=((0.0, 0.1), (0.0, 0.1)))))
    state = step(pair, step(pair, init(pair), 1.0, 1.0), float("nan"), 1.0)
    assert state.setpoint == 1.0
    plain = step(pair, step(pair, init(pair), 1.0, 1.0), 1.4, 1.4)
    assert float(step(pair, state, 1.4, 1.4).output) == float(plain.output) == pytest.approx(0.04, abs=1e-12)


@pytest.mark.parametrize("memory", Memory)
@pytest.mark.parametrize("name", LINES)
def test_the_vectors_reach_every_state_and_the_lines_themselves(name: str, memory: Memory) -> None:
    pair = pair_of(exported(Switching(LINES[name], memory)))
    operations = system_operations(pair)
    modes = replay(pair, operations)[1]
    assert set(modes) == {0, 1} | ({COASTING} if LINES[name].coasts else set())
    # lines that lie a little elsewhere would have been seen
    for field in ("up", "down", "coast_above", "coast_below"):
        line = getattr(LINES[name], field)
        if line is not None:
            moved = replace(LINES[name], **{field: replace(line, value=line.value + 0.01)})
            other = SwitchedRuntime(pair.controllers, replace(pair.switching, hysteresis=moved))
            assert not np.array_equal(replay(other, operations)[1], modes), field


@pytest.mark.parametrize("memory", Memory)
@pytest.mark.parametrize("name", LINES)
def test_a_run_is_the_compiled_simulation_bit_for_bit(name: str, memory: Memory) -> None:
    pair = pair_of(exported(Switching(LINES[name], memory, 2)))
    levels = np.repeat([18.0, 6.0, 10.0, 13.0, 3.0], 60)
    hybrid = Hybrid(LINES[name], InactiveController.of(memory), min_dwell_samples=2)
    scenario = Scenario(TS, Signals(levels), Sensor(0.0, 0.4, 5), start=Start(2.0, InitialInput.FREE), hybrid=hybrid)
    plants = (
        Plants(np.array([[4.39]]), np.array([[1.0, 0.17]]), np.zeros(1)),
        Plants(np.array([[1.0]]), np.array([[2.25, 1.0]]), np.zeros(1)),
    )
    found = simulate([Mode(c, each) for c, each in zip(pair.controllers, plants, strict=True)], scenario)
    rows = zip(levels.tolist(), found.measured[0].tolist(), strict=True)
    outputs, modes = replay(pair, [Operation(Op.STEP, *row) for row in rows])
    assert outputs.tobytes() == found.demanded[0].tobytes()
    assert np.array_equal(modes + 1, found.mode[0])
    assert len(set(modes)) >= 2


def test_the_header_tells_the_lines() -> None:
    header = export_system_c(exported(Switching(ABSOLUTE_BAND, Memory.RESET)))["fopi_car_1_2_f64.h"]
    said = re.sub(r"\s*\n \*\s*|\s+", " ", header)
    for words in (
        "to 2 when measurement >= 9.0, to 1 when measurement <= setpoint + -0.7",
        "mode 0, both outputs rest at 0; from 1 when measurement >= 8.1, from 2 when measurement <= setpoint + 0.0",
        "let go the other one's, both in mode 0",
        "0: coasting, 1: throttle, 2: brake",
    ):
        assert words in said, words


def test_limits_without_0_cannot_coast() -> None:
    modes = mode_export("one", FoPi(0.3, 0.1, 0.8), (0.1, 1.0)), exported(Switching(0.5)).modes[1]
    with pytest.raises(DomainError, match="rest at an output of 0"):
        export_system_c(exported(Switching(BAND), modes=modes))


def test_lines_beyond_float_are_refused() -> None:
    with pytest.raises(DomainError, match="finite"):
        export_system_c(exported(Switching(SwitchingLines(Threshold(1e39), Threshold(-1.0)))))

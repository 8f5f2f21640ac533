"""The limit of the output's rate in the controller: against a plain recursion, in C bit for bit, and what it means."""

from __future__ import annotations

import math
import random
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Sections
from fopi_tune.digital import Export, discretize, export_c
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime, init, reset, step, track
from fopi_tune.digital.vectors import COLUMNS, Op, Operation, in_float32, replay, standard_operations
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import DigitalSpec

TS = 0.2
LIMITS = (-1.0, 1.0)
#: of the output, per s; 0.05 a sample
RATE = 0.25
PI = Sections(TS, 0.42, (1.0,), (0.04,))
FRACTIONAL = discretize(FoPi(0.4, 0.3, 0.7), DigitalSpec(TS))
PROPORTIONAL = discretize(FoPi(0.7, 0.0, 0.7), DigitalSpec(TS))
FLAGS = [
    *("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"),
    *("-Wstrict-prototypes", "-Wmissing-prototypes", "-ffp-contract=off", "-O2"),
]
with_each_compiler = pytest.mark.parametrize(
    "compiler",
    [
        pytest.param(c, marks=pytest.mark.skipif(not shutil.which(c), reason=f"{c} is not found"))
        for c in ("gcc", "clang")
    ],
)
with_each_precision = pytest.mark.parametrize("precision", Precision)


def random_operations(count: int, seed: int = 3) -> list[Operation]:
    """Levels that saturate, ramps that are followed, noise, resets, tracking and numbers that are not finite."""
    draw, found, level = random.Random(seed), [Operation(Op.INIT)], 0.0
    while len(found) < count:
        chance = draw.random()
        if chance < 0.01:
            found.append(Operation(Op.RESET, output=draw.choice((0.3, -0.9, 5.0, math.nan))))
        elif chance < 0.02:
            applied = draw.choice((draw.uniform(-2.0, 2.0), math.inf))
            found += [Operation(Op.TRACK, level, 0.0, applied)] * draw.randint(1, 5)
        elif chance < 0.03:
            found.append(Operation(Op.STEP, draw.choice((math.nan, math.inf, 3e38)), draw.uniform(-1.0, 1.0)))
        else:
            level = draw.choice((0.0, level, 0.9 * level, draw.uniform(-4.0, 4.0)))
            small = draw.choice((1.0, 0.01))
            found += [
                Operation(Op.STEP, small * level, small * draw.gauss(0.0, 0.1)) for _ in range(draw.randint(1, 40))
            ]
    return [in_float32(one) for one in found[:count]]


def plain(runtime: Runtime, operations: list[Operation], change: float) -> list[float]:
    """The recursion as the manual tells it, in the precision's own scalars: one section after the other."""
    number = runtime.precision.dtype
    low, high, most = number(runtime.limits[0]), number(runtime.limits[1]), number(change)
    zero, largest = number(0.0), np.finfo(number).max
    states, last, found = [zero] * len(runtime.poles), zero, []

    def start(at: np.floating) -> None:
        nonlocal last
        last = min(max(at, low), high)
        states[:] = [last if k == 0 and runtime.has_integrator else zero for k in range(len(states))]

    for one in operations:
        error = number(one.setpoint) - number(one.measurement)
        wanted = number(runtime.direct) * error
        for state in states:
            wanted = wanted + state
        applied = number(one.output)
        usable = abs(error) <= largest and abs(wanted) <= largest
        if one.op in (Op.INIT, Op.RESET):
            start(applied if abs(applied) <= largest and one.op is Op.RESET else zero)
        elif one.op is Op.TRACK and usable and abs(applied) <= largest:
            last = min(max(applied, low), high)
            rest = number(runtime.direct) * error
            for k in range(1, len(states)):
                states[k] = number(runtime.poles[k]) * states[k]
                rest = rest + states[k]
            if runtime.has_integrator:
                states[0] = last - rest
            states[:] = [zero if abs(x) < runtime.precision.flush_below else x for x in states]
        elif one.op is Op.STEP and usable:
            aim = min(max(wanted, low), high)
            last = max(min(aim, last + most), last - most) if abs(aim - last) > most else aim
            lost = number(runtime.tracking_gain) * (last - wanted)
            for k, state in enumerate(states):
                shifted = state + number(runtime.weights[k]) * lost
                states[k] = number(runtime.poles[k]) * shifted + number(runtime.residues[k]) * error
            if abs(error) < runtime.precision.flush_below:
                states[:] = [zero if abs(x) < runtime.precision.flush_below else x for x in states]
        found.append(float(last))
    return found


@with_each_precision
@pytest.mark.parametrize("sections", [PI, FRACTIONAL.sections, PROPORTIONAL.sections], ids=["pi", "fopi", "p"])
def test_the_runtime_is_a_plain_recursion_bit_for_bit(precision: Precision, sections: Sections) -> None:
    runtime, operations = Runtime.of(sections, precision, LIMITS, RATE), random_operations(2500)
    with np.errstate(all="ignore"):
        expected = plain(runtime, operations, runtime.most_change)
    found = replay(runtime, operations)
    assert found.tobytes() == np.array(expected).tobytes()
    # all that there is happens
    stepped = np.array([one.op is Op.STEP for one in operations[1:]])
    moves = np.abs(np.diff(found))[stepped]
    fast = np.mean(moves > 0.99 * runtime.most_change)
    assert 0.02 < fast < 0.9
    assert np.mean(moves == 0.0) > 0.01
    assert {-1.0, 1.0} <= set(found.tolist())


@with_each_precision
def test_the_output_never_moves_faster_nor_beyond_its_limits(precision: Precision) -> None:
    for limits, rate in ((LIMITS, RATE), ((-0.3, 7.0), 1.0 / 3.0), ((0.0, 1.0), 1e-3)):
        runtime = Runtime.of(FRACTIONAL.sections, precision, limits, rate)
        assert runtime.most_change <= rate * TS
        operations = standard_operations(runtime)
        found = replay(runtime, operations)
        stepped = np.array([one.op is Op.STEP for one in operations[1:]])
        # of a sum's rounding
        room = 0.5 * float(np.spacing(precision.dtype(max(abs(limit) for limit in runtime.limits))))
        moves = np.abs(np.diff(found))[stepped]
        assert moves.max() <= runtime.most_change + room
        assert np.mean(moves >= runtime.most_change - room) > 0.05
        assert found.min() >= runtime.limits[0]
        assert found.max() <= runtime.limits[1]


@with_each_precision
def test_a_rate_that_is_never_reached_changes_no_bit(precision: Precision) -> None:
    free = Runtime.of(FRACTIONAL.sections, precision, LIMITS)
    assert free.most_change == math.inf
    fast = replace(free, most_change=2.0)
    operations = standard_operations(free)
    assert replay(free, operations).tobytes() == replay(fast, operations).tobytes()
    # and one that is reached changes something
    slow = Runtime.of(FRACTIONAL.sections, precision, LIMITS, RATE)
    assert replay(free, operations).tobytes() != replay(slow, operations).tobytes()


@with_each_precision
def test_the_next_output_is_reached_from_what_was_tracked_reset_or_held(precision: Precision) -> None:
    runtime = Runtime.of(PI, precision, LIMITS, RATE)
    most = precision.dtype(runtime.most_change)
    tracked = track(runtime, init(runtime), 0.0, 0.0, -0.5)
    assert tracked.output == -0.5
    assert step(runtime, tracked, 9.0, 0.0).output == precision.dtype(-0.5) + most
    held = step(runtime, tracked, math.nan, 0.0)
    assert held is tracked
    assert step(runtime, held, -9.0, 0.0).output == precision.dtype(-0.5) - most
    started = reset(runtime, 0.9)
    assert step(runtime, started, 9.0, 0.0).output == precision.dtype(0.9) + most
    # beyond the rate lies the limit
    assert step(runtime, reset(runtime, 0.98), 9.0, 0.0).output == 1.0
    assert step(runtime, reset(runtime, 7.0), 0.0, 0.0).output == 1.0
    assert step(runtime, init(runtime), 9.0, 0.0).output == most


@pytest.mark.parametrize(("gain", "inside", "outside"), [(2.0, 0.040, 1.354), (20.0, 0.130, 1.929)])
def test_a_lag_behind_a_slow_actuator_does_not_wind_up(gain: float, inside: float, outside: float) -> None:
    """1/(2 s + 1) with kp = ki and 0.25 per s: its overshoot with the limit in the controller and without it."""
    decay, overshoots = math.exp(-0.05 / 2.0), []
    sections = Sections(0.05, gain * 1.025, (1.0,), (gain * 0.05,))
    for rate in (0.25, None):
        runtime = Runtime.of(sections, Precision.FLOAT64, None, rate)
        state, y, actuator, largest = init(runtime), 0.0, 0.0, 0.0
        for _ in range(1200):
            state = step(runtime, state, 1.0, y)
            actuator += min(max(float(state.output) - actuator, -0.0125), 0.0125)
            y = decay * y + (1.0 - decay) * actuator
            largest = max(largest, y)
        overshoots.append(largest - 1.0)
    # the limits page has these numbers
    assert overshoots == pytest.approx([inside, outside], abs=6e-4)


@with_each_precision
def test_an_output_on_its_way_turns_as_the_error_changes_its_sign(precision: Precision) -> None:
    """After more than a minute of an error that alone asks for eight times the limit."""
    for sections in (PI, FRACTIONAL.sections):
        runtime = Runtime.of(sections, precision, (0.0, 1.0), 0.01)
        state = init(runtime)
        for _ in range(400):
            state = step(runtime, state, 20.0, 0.0)
        assert 0.79 < state.output < 0.801
        turned = step(runtime, state, -4.0, 0.0)
        assert float(turned.output) == pytest.approx(float(state.output) - 0.002, abs=1e-6)


@pytest.mark.parametrize("rate", [0.0, -1.0, math.nan])
def test_a_rate_that_is_none_is_refused(rate: float) -> None:
    with pytest.raises(DomainError, match="must be greater than 0"):
        Runtime.of(PI, Precision.FLOAT64, LIMITS, rate)


def test_a_rate_that_the_precision_loses_is_refused() -> None:
    """3e-8 a sample is less than half of float32's last place of 1: an output of 1 would never move."""
    assert Runtime.of(PI, Precision.FLOAT64, LIMITS, 1e-7).limits_rate
    with pytest.raises(DomainError, match="which float32 loses beside an output of 1; give a longer sample time"):
        Runtime.of(PI, Precision.FLOAT32, LIMITS, 1e-7)
    assert Runtime.of(PI, Precision.FLOAT32, None, 1e-7).limits_rate
    with pytest.raises(DomainError, match="float32 loses"):
        Runtime.of(PI, Precision.FLOAT32, None, 1e-60)
    assert not Runtime.of(PI, Precision.FLOAT32, LIMITS, math.inf).limits_rate


# -- C -----------------------------------------------------------------------------------------------------------------


def exported(export: Export, folder: Path, compiler: str) -> dict[str, str]:
    files = export_c(export)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="ascii")
    sources = sorted(name for name in files if name.endswith(".c"))
    command = [compiler, *FLAGS, "-o", "replay", *sources]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return files


def replayed(folder: Path, table: str) -> str:
    done = subprocess.run([folder / "replay", table], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.thinned(slow=["no limits", "p-10000"])
@with_each_compiler
@pytest.mark.parametrize("count", [10_000, pytest.param(100_000, marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", ["fopi", "p", "no limits"])
def test_the_c_code_is_the_runtime_bit_for_bit(tmp_path: Path, kind: str, count: int, compiler: str) -> None:
    controller = PROPORTIONAL if kind == "p" else FRACTIONAL
    limits = None if kind == "no limits" else LIMITS
    files = exported(
        Export("slow", "", "0" * 64, "fopi-tune 0", controller, limits=limits, rate_per_s=RATE), tmp_path, compiler
    )
    assert "rows are equal bit for bit" in replayed(tmp_path, "test_vectors.csv")
    operations = random_operations(count)
    both = [replay(Runtime.of(controller.sections, precision, limits, RATE), operations) for precision in Precision]
    rows = [
        ",".join([one.op.value, *(float(x).hex() for x in (one.setpoint, one.measurement, one.output, *outputs))])
        for one, *outputs in zip(operations, *both, strict=True)
    ]
    (tmp_path / "run.csv").write_text("\n".join([COLUMNS, *rows, ""]))
    assert str(count) in replayed(tmp_path, "run.csv")
    header = files["fopi_slow_f64.h"]
    assert "the output changes by at most 0.25 per s, 0.05 from one sample to the next" in header


def test_without_a_rate_nothing_of_it_is_in_the_code() -> None:
    for text in export_c(Export("free", "", "0" * 64, "fopi-tune 0", FRACTIONAL, limits=LIMITS)).values():
        assert "most_change" not in text
        assert "Rate:" not in text

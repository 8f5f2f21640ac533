"""Test vectors of the exported controller:  operations, and their expected outputs in float64 and float32.

Inputs are representable in float32, so that both precisions read the same numbers; these are hexadecimal, so that
reading does not round.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.digital.runtime import Runtime, init, reset, step, track

#: first line of the table
COLUMNS = "op,setpoint,measurement,applied_or_output,expected_f64,expected_f32"
#: float32's largest number, its smallest, and numbers whose differences or products overflow in one precision or both
EXTREME = (3.4028234663852886e38, -3.4028234663852886e38, 1e38, -3e37, 1e30, -1e20, 1.4e-45, -1e-40, 0.0, -0.0)
NOT_FINITE = (float("nan"), float("inf"), float("-inf"))
#: share of the output's range that a signal of size 1 covers
_SHARE = 0.3
_SEED = 20


class Op(StrEnum):
    """What a caller can do; the value is the word in a table of operations."""

    INIT = "init"
    STEP = "step"
    TRACK = "track"
    RESET = "reset"


@dataclass(frozen=True)
class Operation:
    """A call of the controller.

    Args:
        op: which one.
        setpoint: of step and track.
        measurement: of step and track.
        output: what was applied, of track; where to start, of reset.
    """

    op: Op
    setpoint: float = 0.0
    measurement: float = 0.0
    output: float = 0.0


def replay(runtime: Runtime, operations: Iterable[Operation]) -> Array:
    """The output after each operation, from a fresh `init`; shape (n,)."""
    state, outputs = init(runtime), []
    for operation in operations:
        if operation.op is Op.STEP:
            state = step(runtime, state, operation.setpoint, operation.measurement)
        elif operation.op is Op.TRACK:
            state = track(runtime, state, operation.setpoint, operation.measurement, operation.output)
        else:
            state = init(runtime) if operation.op is Op.INIT else reset(runtime, operation.output)
        outputs.append(float(state.output))
    return np.array(outputs)


def vector_table(float64: Runtime, float32: Runtime, operations: Sequence[Operation]) -> str:
    """The table as CSV.

    Args:
        float64: the controller in float64.
        float32: the same controller in float32.
        operations: applied to a newly initialised controller.
    """
    expected = zip(replay(float64, operations), replay(float32, operations), strict=True)
    rows = [
        ",".join([one.op.value, *(float(x).hex() for x in (one.setpoint, one.measurement, one.output, *outputs))])
        for one, outputs in zip(operations, expected, strict=True)
    ]
    return "\n".join([COLUMNS, *rows, ""])


def standard_operations(runtime: Runtime, seed: int = _SEED, mixed: int = 800) -> tuple[Operation, ...]:
    """Steps, noise, saturation, numbers not finite or huge, hand-overs, resets and rest; equal for equal arguments.

    Args:
        runtime: whose limits and gains scale the signals.
        seed: of the noise.
        mixed: number of random operations at the end.
    """
    size, draw = signal_size(runtime), random.Random(seed)

    def noise(scale: float) -> float:
        return size * scale * draw.uniform(-1.0, 1.0)

    rows = [Operation(Op.INIT), *steps(240, lambda k: size * (k >= 10), lambda k: size * (1.0 - 0.99**k))]
    rows += steps(300, lambda k: size * 0.5, lambda k: noise(1.0))
    for sign in (1.0, -1.0, 1.0):
        rows += steps(120, lambda k, s=sign: s * 40.0 * size, lambda k: noise(0.2))
    for value in NOT_FINITE:
        rows += [Operation(Op.STEP, value, 0.0), Operation(Op.STEP, size, value), Operation(Op.STEP, value, value)]
        rows += [Operation(Op.TRACK, value, 0.0, size), Operation(Op.TRACK, size, 0.0, value)]
        rows += [Operation(Op.RESET, output=value), *steps(10, lambda k: size, lambda k: noise(1.0))]
    for first in EXTREME:
        for second in (0.0, first, -first):
            rows += [Operation(Op.STEP, first, second), Operation(Op.TRACK, size, second, first)]
        rows += [Operation(Op.RESET, output=first), *steps(5, lambda k: size, lambda k: noise(1.0))]
    for applied in (0.0, 0.5 * size, -100.0 * size):
        rows += [Operation(Op.TRACK, size, 0.5 * size, applied) for _ in range(60)]
        rows += steps(40, lambda k: size, lambda k: 0.5 * size)
    rows += [_random_operation(draw, size) for _ in range(mixed)]
    rows += _at_rest(runtime)
    if runtime.derivative is not None or runtime.measurement_filter is not None:
        rows += _measurements_at_rest()
    if runtime.limits_rate:
        rows += _around_the_rate(runtime, draw)
    return tuple(in_float32(row) for row in rows)


def steps(count: int, setpoint: Callable[[int], float], measurement: Callable[[int], float]) -> Iterable[Operation]:
    """Ordinary samples.

    Args:
        count: of them.
        setpoint: from the sample's number, from 0.
        measurement: the same.
    """
    return [Operation(Op.STEP, setpoint(k), measurement(k)) for k in range(count)]


def _around_the_rate(runtime: Runtime, draw: random.Random) -> Iterable[Operation]:
    """Errors that move the output a little slower and a little faster than its rate allows, from several outputs."""
    gain, size = abs(runtime.direct) + sum(abs(residue) for residue in runtime.residues), signal_size(runtime)
    share = runtime.most_change / gain if gain > 0.0 else 1.0
    rows: list[Operation] = []
    for sign in (1.0, -1.0):
        for speed in (0.5, 0.98, 1.02, 3.0):
            rows += [Operation(Op.RESET, output=-sign * gain * size)]
            rows += steps(40, lambda k, s=sign, v=speed: s * v * share * k, lambda k: 0.1 * share * draw.uniform(-1, 1))
        rows += [Operation(Op.TRACK, 0.0, 0.0, -0.5 * sign * gain * size) for _ in range(3)]
        rows += steps(60, lambda k, s=sign: s * size, lambda k: 0.0)
    return rows


def _at_rest(runtime: Runtime) -> Iterable[Operation]:
    """Rest after states around what float32 takes for 0: a state that is kept there is seen in the output.

    float64's threshold is beyond float32's range, and so of these inputs.
    """
    gain, rows = sum(abs(residue) for residue in runtime.residues), []
    for exponent in range(-120, -80, 8):
        error = 2.0**exponent / (gain if gain > 0.0 else 1.0)
        rows += [Operation(Op.RESET), *steps(3, lambda k, e=error: e, lambda k: 0.0)]
        rows += steps(6, lambda k: 0.0, lambda k: 0.0)
        rows += [Operation(Op.RESET), *steps(3, lambda k, e=error: -e, lambda k: 0.0)]
        rows += [Operation(Op.TRACK), *steps(3, lambda k: 0.0, lambda k: 0.0)]
    return rows


def _measurements_at_rest() -> Iterable[Operation]:
    """Measurements that come to rest at 0 beside a setpoint, from around what float32 takes for 0, and back."""
    rows: list[Operation] = []
    for exponent in range(-120, -80, 8):
        rows += [Operation(Op.RESET), *steps(3, lambda k: 0.0, lambda k, e=exponent: 2.0**e)]
        rows += steps(6, lambda k: 2.0**-60, lambda k: 0.0)
        rows += [Operation(Op.TRACK), *steps(3, lambda k: 0.0, lambda k, e=exponent: -(2.0**e))]
    return rows


def _random_operation(draw: random.Random, size: float) -> Operation:
    """A random operation, mostly an ordinary step."""
    chance, scale = draw.random(), size * (20.0 if draw.random() < 0.1 else 1.0)
    setpoint, measurement, output = (scale * draw.uniform(-1.0, 1.0) for _ in range(3))
    if chance < 0.02:
        setpoint = draw.choice(NOT_FINITE)
    elif chance < 0.04:
        measurement = draw.choice(NOT_FINITE + EXTREME)
    elif chance < 0.05:
        return Operation(Op.RESET, output=draw.choice((output, *NOT_FINITE, *EXTREME)))
    elif chance < 0.06:
        return Operation(Op.INIT)
    elif chance < 0.15:
        return Operation(Op.TRACK, setpoint, measurement, draw.choice((output, output, *NOT_FINITE)))
    return Operation(Op.STEP, setpoint, measurement)


def signal_size(runtime: Runtime) -> float:
    """Size of signals that move the output through much of its range; 1 where the range is unlimited."""
    gain = abs(runtime.direct) + sum(abs(residue) for residue in runtime.residues) + abs(runtime.proportional)
    gain += sum(map(abs, runtime.derivative.gains)) if runtime.derivative is not None else 0.0
    span = max(abs(limit) for limit in runtime.limits)
    size = _SHARE * span / gain if gain > 0.0 else 1.0
    # outside these sizes no signal reaches the limits
    return size if 1e-12 < size < 1e12 else 1.0


def in_float32(row: Operation) -> Operation:
    """The operation with its numbers rounded to float32."""
    with np.errstate(all="ignore"):
        numbers = (float(np.float32(number)) for number in (row.setpoint, row.measurement, row.output))
    return Operation(row.op, *numbers)

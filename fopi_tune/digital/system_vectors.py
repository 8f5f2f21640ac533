"""Test vectors of an exported system:  operations, and the outputs and modes they must give in float64 and float32.

Inputs are representable in float32, as those of a single controller (`vectors`).
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence

from fopi_tune.core.switching_lines import SwitchingLines
from fopi_tune.digital.switched_runtime import SwitchedRuntime, replay
from fopi_tune.digital.vectors import EXTREME, NOT_FINITE, Op, Operation, in_float32, signal_size, steps

#: first line of the table; a mode is 1 or 2, or 0 where both outputs rest
COLUMNS = "op,setpoint,measurement,start_at,expected_f64,expected_f32,mode_f64,mode_f32"
_SEED = 21


def system_vector_table(float64: SwitchedRuntime, float32: SwitchedRuntime, operations: Sequence[Operation]) -> str:
    """The table as CSV.

    Args:
        float64: the system in float64.
        float32: the same system in float32.
        operations: applied to a newly initialised system.
    """
    (double, double_mode), (single, single_mode) = replay(float64, operations), replay(float32, operations)
    rows = zip(operations, double, single, double_mode, single_mode, strict=True)
    lines = [
        ",".join([one.op.value, *(float(x).hex() for x in (one.setpoint, one.measurement, one.output, *outputs[:2]))])
        + f",{1 + outputs[2]},{1 + outputs[3]}"
        for one, *outputs in rows
    ]
    return "\n".join([COLUMNS, *lines, ""])


def system_operations(pair: SwitchedRuntime, seed: int = _SEED, mixed: int = 1200) -> tuple[Operation, ...]:
    """Switching at every few samples and rarely, saturation both ways, numbers not finite or huge, resets and rest.

    Args:
        pair: whose limits, gains and hysteresis scale the signals.
        seed: of the noise.
        mixed: number of random operations at the end.
    """
    draw = random.Random(seed)
    sizes = [signal_size(controller) for controller in pair.controllers]
    # signals that cross the lines, and signals that move the outputs
    eps = pair.lines.half_width
    widths = [(_width(pair.lines) if eps is None else eps) or 0.1 * min(sizes), *sizes]

    def noise(scale: float) -> float:
        return scale * draw.uniform(-1.0, 1.0)

    rows = [Operation(Op.INIT)]
    for width in widths:
        rows += steps(200, lambda k, w=width: w, lambda k, w=width: w + noise(1.5 * w))
        rows += steps(120, lambda k, w=width: 5.0 * w, lambda k, w=width: 5.0 * w + noise(20.0 * w))
    for sign in (1.0, -1.0, 1.0):
        # far on one side: one mode, at its limit
        rows += steps(80, lambda k: 0.0, lambda k, s=sign: s * 40.0 * max(widths) + noise(widths[0]))
    for value in NOT_FINITE:
        for side in (3.0, -3.0):
            rows += steps(12, lambda k: widths[0], lambda k, s=side: widths[0] + s * widths[0])
            rows += [
                Operation(Op.STEP, value, 0.0),
                Operation(Op.STEP, widths[0], value),
                Operation(Op.STEP, value, value),
            ]
        rows += [Operation(Op.RESET, output=value), *steps(6, lambda k: widths[0], lambda k: noise(3.0 * widths[0]))]
    for first in EXTREME:
        rows += [Operation(Op.STEP, first, second) for second in (0.0, first, -first)]
        rows += [Operation(Op.RESET, output=first), *steps(5, lambda k: widths[0], lambda k: noise(widths[0]))]
    rows += _at_rest(pair, widths[0])
    if eps is None:
        rows += _around_lines(draw, pair.lines, widths)
    rows += [_random_operation(draw, widths) for _ in range(mixed)]
    return tuple(in_float32(row) for row in rows)


def _width(lines: SwitchingLines) -> float:
    """The distance between the lines of the two modes, or the largest of their numbers where they are of two kinds."""
    up, down = lines.up, lines.down
    apart = up.value - down.value
    return abs(apart) if up.is_absolute == down.is_absolute else max(abs(up.value), abs(down.value))


def _around_lines(draw: random.Random, lines: SwitchingLines, widths: Sequence[float]) -> Iterable[Operation]:
    """Measurements on each line, just beside it, and wandering between all of them, at several setpoints."""
    every = [each for each in (lines.up, lines.down, lines.coast_above, lines.coast_below) if each is not None]
    # near absolute lines too, where relative ones change sides with them
    setpoints = [0.0, *widths, *(line.value + draw.uniform(-2.0, 2.0) * widths[0] for line in every)]
    rows: list[Operation] = []
    for setpoint in setpoints:
        for _ in range(30):
            level = draw.choice(every).level(setpoint)
            beside = draw.choice((0.0, 0.0, 1e-6, -1e-6, 0.3, -0.3)) * widths[0]
            rows.append(Operation(Op.STEP, setpoint, level + beside))
            rows += [Operation(Op.STEP, setpoint, level + beside)] * draw.choice((0, 0, 3))
    return rows


def _at_rest(pair: SwitchedRuntime, width: float) -> Iterable[Operation]:
    """Rest in both modes after states around what float32 takes for 0."""
    rows: list[Operation] = []
    for side in (-2.0, 2.0):
        for exponent in range(-120, -80, 8):
            error = 2.0**exponent
            rows += [
                Operation(Op.RESET),
                *steps(max(3, pair.switching.min_dwell_samples), lambda k: 0.0, lambda k, s=side: s * width),
            ]
            rows += steps(3, lambda k, e=error: e, lambda k: 0.0)
            rows += steps(6, lambda k: 0.0, lambda k: 0.0)
    return rows


def _random_operation(draw: random.Random, widths: Sequence[float]) -> Operation:
    """A random operation, mostly an ordinary step around the setpoint."""
    chance, width = draw.random(), draw.choice(widths)
    setpoint = draw.choice((0.0, width, 10.0 * width))
    measurement = setpoint + width * draw.choice((1.2, 1.2, 20.0)) * draw.uniform(-1.0, 1.0)
    if chance < 0.02:
        setpoint = draw.choice(NOT_FINITE)
    elif chance < 0.04:
        measurement = draw.choice(NOT_FINITE + EXTREME)
    elif chance < 0.045:
        return Operation(Op.RESET, output=draw.choice((measurement, *NOT_FINITE, *EXTREME)))
    elif chance < 0.05:
        return Operation(Op.INIT)
    return Operation(Op.STEP, setpoint, measurement)

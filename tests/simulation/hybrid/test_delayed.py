"""Separate lines and coasting in continuous time: jumps on the lines, and a plain integration in tiny steps."""

from __future__ import annotations

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.switching_lines import SwitchingLines, Threshold
from fopi_tune.digital.switched_runtime import Memory
from fopi_tune.errors import DomainError
from fopi_tune.simulation.hybrid.delayed import SteppedResponse, SteppedSignals, simulate_stepped
from fopi_tune.simulation.hybrid.flow import ModeLoop
from fopi_tune.simulation.hybrid.inclusion import simulate_hybrid
from fopi_tune.simulation.hybrid.model import Corner, HybridCar, HybridStart, Mode, Watch

RAISES = ModeLoop(20.0 / 4.0, 1.0 / 4.0, FoPi(0.12, 0.08, 1.0), limits=(0.0, 1.0))
LOWERS = ModeLoop(12.0 / 2.0, 1.0 / 2.0, FoPi(0.2, 0.15, 1.0), limits=(-1.0, 0.0))
#: s; setpoints of 8 and of 3
CORNERS, END = [Corner(0.0, 8.0), Corner(8.0, 3.0)], 16.0
STEP = 0.002
BAND = SwitchingLines(Threshold(0.7), Threshold(-0.5), Threshold(0.1), Threshold(0.2))


def setpoint(t: float | np.ndarray, ramp_s: float, just_before: bool = False) -> np.ndarray:
    """8, reached at once or in a ramp, and 3 from 8 s on."""
    first = 8.0 * np.minimum(np.asarray(t) / ramp_s, 1.0) if ramp_s else np.full(np.shape(t), 8.0)
    return np.where(np.asarray(t) <= 8.0 if just_before else np.asarray(t) < 8.0 - 1e-9, first, 3.0)


def in_steps(car: HybridCar, ramp_s: float = 0.0) -> SteppedResponse:
    times = np.asarray(STEP * np.arange(round(END / STEP) + 1), dtype=float)
    sides = tuple(np.asarray(setpoint(times, ramp_s, before), dtype=float) for before in (True, False))
    zero = np.zeros_like(times)
    signals = SteppedSignals((sides[0], sides[1]), (zero, zero))
    return simulate_stepped(car, signals, STEP, 0, HybridStart(), 0.0, Watch(50, 0.1))


#: kp, ki, limits, and gain and pole of the plant
PARTS = ((0.12, 0.08, 0.0, 1.0, 5.0, 0.25), (0.2, 0.15, -1.0, 0.0, 6.0, 0.5))


def next_state(state: int, offset: float) -> int:
    """State 1 and 2 are modes, 0 the band; `offset` is y - r."""
    if offset >= 0.7 and state != 2:
        return 2
    if offset <= -0.5 and state != 1:
        return 1
    return 0 if (state == 1 and offset >= 0.1) or (state == 2 and offset <= 0.2) else state


def in_tiny_steps(
    memory: Memory,
    ramp_s: float = 0.0,
    fed: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.0, 0.0)),
    every: int = 20,
) -> tuple[np.ndarray, np.ndarray]:
    """Output and state at the nodes, by Euler's rule."""
    h, y, x, state, left, applied = STEP / every, 0.0, [0.0, 0.0], 1, 1, 0.0
    times = h * np.arange(round(END / h) + 1)
    reference = setpoint(times, ramp_s)
    slopes = np.where((times < ramp_s) & (times < 8.0), 8.0 / ramp_s if ramp_s else 0.0, 0.0)
    r, slope, e, rows, states = float(reference[0]), float(slopes[0]), float(reference[0]), [], []
    for n in range(len(times)):
        # what a controller saw just before
        error, old, before = e, (r, slope), state
        r, slope = float(reference[n]), float(slopes[n])
        e, state = r - y, next_state(state, y - r)
        left = state or left
        kp, ki, low, high, gain, pole = PARTS[left - 1]
        static, rate = fed[left - 1]
        if state and state != before and memory is Memory.RESET:
            x[left - 1] = 0.0
        elif state and state != before and memory is Memory.TRACKING:
            # it followed what was applied until now: that of the band, or of the other mode
            x[left - 1] = (min(max(applied, low), high) - static * old[0] - rate * old[1] - kp * error) / ki
        wanted = kp * e + ki * x[left - 1] + static * r + rate * slope
        applied = min(max(wanted, low), high) if state else 0.0
        if n % every == 0:
            rows.append(y)
            states.append(state)
        x[left - 1] += h * e if state else 0.0
        y += h * (gain * applied - pole * y)
    return np.array(rows), np.array(states)


@pytest.mark.parametrize("memory", Memory)
def test_a_band_is_driven_as_a_plain_integration_drives_it(memory: Memory) -> None:
    found = in_steps(HybridCar(RAISES, LOWERS, BAND, memory))
    output, states = in_tiny_steps(memory)
    assert set(found.mode) == {0, 1, 2}
    changes = [np.flatnonzero(np.diff(each)) for each in (found.mode, states)]
    assert len(changes[0]) == len(changes[1])
    # each change comes up to a step late, and they add up; the output moves by 5 per s at most
    assert np.all(np.abs(changes[0] - changes[1]) <= 1 + np.arange(len(changes[0])))
    assert np.abs(found.output - output).max() < 5.0 * STEP * len(changes[0]) / 2
    assert np.all(found.control[found.mode == 0] == 0.0)


@pytest.mark.parametrize("memory", Memory)
def test_a_feed_forward_is_driven_as_a_plain_integration_drives_it(memory: Memory) -> None:
    fed = ((0.05, 0.3), (0.08, 0.16))
    found = in_steps(HybridCar(RAISES, LOWERS, BAND, memory, fed=fed), 6.0)
    output, states = in_tiny_steps(memory, 6.0, fed)
    changes = [np.flatnonzero(np.diff(each)) for each in (found.mode, states)]
    assert len(changes[0]) == len(changes[1]) > 2
    assert np.all(np.abs(changes[0] - changes[1]) <= 1 + np.arange(len(changes[0])))
    assert np.abs(found.output - output).max() < 5.0 * STEP * max(len(changes[0]) / 2, 1.0)
    without = in_steps(HybridCar(RAISES, LOWERS, BAND, memory), 6.0)
    assert np.abs(without.output - found.output).max() > 0.2


@pytest.mark.parametrize("lines", [(0.4, 0.15), (0.6, -0.2)])
def test_located_jumps_lie_on_their_own_lines(lines: tuple[float, float]) -> None:
    up, down = lines
    for each in (
        SwitchingLines(Threshold(up), Threshold(down)),
        SwitchingLines(Threshold(3.0 + up, is_absolute=True), Threshold(down)),
        SwitchingLines(Threshold(up), Threshold(3.0 + down, is_absolute=True)),
    ):
        start = HybridStart(6.0)
        found = simulate_hybrid(HybridCar(RAISES, LOWERS, each, Memory.RESET), [Corner(0.0, 3.0)], END, [], start=start)
        assert len(found.events) >= 2
        for event in found.events[1:]:
            line = each.up if event.before is Mode.THROTTLE else each.down
            assert event.output == pytest.approx(line.level(event.reference), abs=1e-9)


def test_an_absolute_line_waits_for_the_output_while_the_setpoint_moves() -> None:
    ramp = [Corner(0.0, 8.0, -0.5)]
    lines = SwitchingLines(Threshold(5.0, is_absolute=True), Threshold(-0.5))
    found = simulate_hybrid(HybridCar(RAISES, LOWERS, lines), ramp, 10.0, [], start=HybridStart(2.0))
    assert found.events[0].output == pytest.approx(5.0, abs=1e-9)
    # relative to the setpoint the output is then anywhere
    assert abs(found.events[0].output - found.events[0].reference) > 0.1


def test_a_hysteresis_is_two_lines_with_the_same_bits() -> None:
    lines = SwitchingLines(Threshold(0.4), Threshold(-0.4))
    one, two = (simulate_hybrid(HybridCar(RAISES, LOWERS, each), CORNERS, END, [15.0]) for each in (0.4, lines))
    assert one.events == two.events
    assert np.array_equal(one.output, two.output)


def test_jumps_to_a_band_are_not_located() -> None:
    with pytest.raises(DomainError, match="equal steps"):
        simulate_hybrid(HybridCar(RAISES, LOWERS, BAND), CORNERS, END, [])

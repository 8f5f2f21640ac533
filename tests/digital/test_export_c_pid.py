"""A derivative and a setpoint weight in C: bit for bit the runtime's arithmetic, in double and float."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from cases.c_export import SANITIZE, replayed, with_each_compiler

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.digital import Export, discretize, export_c
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime, State, init, reset, step, track
from fopi_tune.digital.vectors import (
    NOT_FINITE,
    Op,
    Operation,
    in_float32,
    replay,
    signal_size,
    standard_operations,
    vector_table,
)
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import DigitalSpec

#: to measure what rounding does to a filter takes a tenth of a second
discretized = cache(discretize)

TS = 0.1
PID = Pid(2.0, 1.0, 0.8, 0.15)
#: sections of either sign in both groups
FOPID = FoPid(2.0, 1.0, 1.2, 0.8, 0.6, 0.15)
#: with and without integral, proportional part and sections
GAINS = [PID, Pid(2.0, 0.0, 0.8, 0.15), Pid(0.0, 1.0, 0.3, 0.05), Pid(2.0, 1.0, 0.0, 0.15), FoPi(0.4, 0.4, 0.8)]
GAINS += [FoPi(1.5, 0.0, 1.0), Pid(-1.0, -0.5, 0.4, 0.3)]
GAINS += [FOPID, FoPid(2.0, 0.0, 0.8, 0.8, 0.3, 0.15), FoPid(0.0, 1.0, 0.7, -0.3, 0.9, 0.05)]
LIMITS = [(None, None), ((-1.0, 0.8), None), ((-1.0, 0.8), 2.0)]


def export(gains: FoPi, b: float, limits: tuple[float, float] | None, rate: float | None) -> Export:
    made = Export("pid", "", "0" * 64, "fopi-tune 0", discretized(gains, DigitalSpec(TS)), limits=limits)
    return replace(made, rate_per_s=rate, setpoint_weight=b)


def runtimes(made: Export) -> list[Runtime]:
    sections = made.controller.sections
    return [Runtime.of(sections, each, made.limits, made.rate_per_s, made.setpoint_weight) for each in Precision]


def long_run(runtime: Runtime, count: int) -> list[Operation]:
    """Runs of one kind each: steps of setpoints that saturate, noise, ramps, tracking, resets, numbers not finite."""
    draw, size, rows, level = random.Random(4), signal_size(runtime), [Operation(Op.INIT)], 0.0
    while len(rows) < count:
        kind, noise = draw.random(), size * draw.choice((0.0, 0.01, 1.0))
        scale = size * draw.choice((0.3, 3.0, 30.0))
        setpoint = draw.uniform(-scale, scale)
        for _ in range(draw.randrange(1, 200)):
            level += 0.05 * (setpoint - level)
            measured = level + noise * draw.uniform(-1.0, 1.0)
            if kind < 0.1:
                rows.append(Operation(Op.TRACK, setpoint, measured, draw.uniform(-2.0, 2.0)))
            elif draw.random() < 0.005:
                bad = draw.choice(NOT_FINITE)
                rows += [Operation(Op.STEP, bad, measured), Operation(Op.STEP, setpoint, bad)]
                rows += [Operation(Op.TRACK, setpoint, measured, bad)]
            else:
                rows.append(Operation(Op.STEP, setpoint, measured))
        if draw.random() < 0.1:
            rows.append(Operation(Op.RESET, output=draw.choice((0.0, 0.5, -3.0, *NOT_FINITE))))
    return [in_float32(row) for row in rows[:count]]


@with_each_compiler
@pytest.mark.parametrize("every", [16, pytest.param(4, marks=pytest.mark.long)])
def test_the_vectors_of_every_structure_are_met_bit_for_bit(tmp_path: Path, compiler: str, every: int) -> None:
    for place, (gains, b, (limits, rate)) in enumerate(itertools.product(GAINS, (0.0, 0.5, 1.0), LIMITS)):
        # of nine cases of a structure, sixteen take one or none
        if place % every and (every == 16 or gains not in (PID, FOPID) or limits is None):
            continue  # a compiler takes a second for each
        done = replayed(export_c(export(gains, b, limits, rate)), tmp_path / str(place), compiler)
        assert done.returncode == 0, (gains, b, limits, rate, done.stdout + done.stderr)


@with_each_compiler
@pytest.mark.parametrize("gains", [PID, FOPID], ids=["pid", "fopid"])
@pytest.mark.parametrize(
    ("b", "count"), [(0.3, 5_000), *(pytest.param(b, 100_000, marks=pytest.mark.long) for b in (0.3, 1.0))]
)
def test_thousands_of_operations_are_the_runtime_bit_for_bit(
    tmp_path: Path, compiler: str, gains: FoPid, b: float, count: int
) -> None:
    made = export(gains, b, (-1.0, 0.8), 0.5)
    double, single = runtimes(made)
    rows = long_run(double, count)
    table = vector_table(double, single, rows)
    done = replayed(export_c(made) | {"test_vectors.csv": table}, tmp_path / "long", compiler, "-O2")
    assert done.returncode == 0, done.stdout
    assert f"{count} rows are equal" in done.stdout
    outputs = [float.fromhex(line.split(",")[4]) for line in table.splitlines()[1:]]
    # the limits and the rate are reached often, so that the anti-windup is compared
    assert min(sum(output == limit for output in outputs) for limit in (-1.0, 0.8)) > count // 100
    moves = [abs(two - one) for one, two in itertools.pairwise(outputs)]
    assert sum(abs(move - 0.05) < 1e-12 for move in moves) > count // 100


@with_each_compiler
def test_no_operation_is_undefined(tmp_path: Path, compiler: str) -> None:
    for place, gains in enumerate((PID, GAINS[1], GAINS[4], FOPID)):
        done = replayed(export_c(export(gains, 0.5, (-1.0, 0.8), 2.0)), tmp_path / str(place), compiler, *SANITIZE)
        assert done.returncode == 0, done.stdout + done.stderr


def test_float32_stays_close_to_float64() -> None:
    for gains, b in itertools.product((PID, FOPID), (0.0, 1.0)):
        double, single = runtimes(export(gains, b, (-1.0, 0.8), 2.0))
        draw = random.Random(1)
        rows = [in_float32(Operation(Op.STEP, float(k // 400 % 2), 0.5 + 0.1 * draw.random())) for k in range(4000)]
        error = abs(replay(double, rows) - replay(single, rows)).max()
        # float32 has 7 digits; the derivative's gain of 2 kd/(2 Tf + Ts) = 4 multiplies those of the measurement; the
        # slowest lags of FOPID stop 1/q = 3e4 of their last places before the measurement, with a gain of 0.01
        assert error < (4e-6 if gains is PID else 4e-5)


def test_headers_say_what_acts_on_what_and_nothing_new_of_a_controller_of_the_error() -> None:
    header = export_c(export(PID, 0.5, None, None))["fopi_pid_f64.h"]
    assert "kp on b r - y, ki on r - y, kd on -y" in header
    assert "C(s) = kp + ki/s + kd s/(Tf s + 1)" in header
    assert "kd = 0.8, Tf = 0.15 s" in header
    assert "b = 0.5" in header
    header = export_c(export(FOPID, 1.0, None, None))["fopi_pid_f32.h"]
    assert "C(s) = kp + ki s^-alpha + kd s^mu/(Tf s + 1)" in header
    assert "kp = 2.0, ki = 1.0, alpha = 1.2,\n *              kd = 0.8, mu = 0.6, Tf = 0.15 s" in header
    plain = export_c(export(FoPi(0.4, 0.4, 0.8), 1.0, None, None))
    assert all("is_new" not in text and "filtered" not in text for text in plain.values())


@pytest.mark.parametrize("b", [0.0, 0.5, 1.0])
def test_the_first_sample_after_a_reset_is_at_rest_at_its_own_measurement(b: float) -> None:
    runtime = Runtime.of(discretized(PID, DigitalSpec(TS)).sections, Precision.FLOAT64, (-10.0, 10.0), None, b)
    state = reset(runtime, 3.0)
    for _ in range(20):
        state = step(runtime, state, 40.0, 40.0)
        assert float(state.output) == pytest.approx(3.0, abs=1e-12)
    # then the setpoint's step is weighted, and the measurement's is not
    assert float(step(runtime, state, 41.0, 40.0).output) == pytest.approx(3.0 + 2.0 * b + 0.05, rel=1e-12)


def test_a_first_sample_that_is_not_finite_is_held_and_the_next_one_is_the_first() -> None:
    runtime = Runtime.of(discretized(PID, DigitalSpec(TS)).sections, Precision.FLOAT64, None, None, 0.5)
    fresh = init(runtime)
    assert step(runtime, fresh, float("nan"), 1.0) is fresh
    assert track(runtime, fresh, 1.0, 1.0, float("inf")) is fresh
    assert step(runtime, fresh, 5.0, 5.0).output == 0.0


@pytest.mark.parametrize("b", [0.0, 0.5, 1.0])
def test_a_hand_over_after_tracking_has_no_bump_while_the_measurement_moves(b: float) -> None:
    runtime = Runtime.of(discretized(PID, DigitalSpec(TS)).sections, Precision.FLOAT64, (-10.0, 10.0), None, b)
    state = init(runtime)
    for k in range(50):
        state = track(runtime, state, 1.0, 0.1 * k, 4.0)
    # the next sample at the same signals: what was applied, but for the derivative's lag, which saw the last move
    assert float(step(runtime, state, 1.0, 0.1 * 49).output) == pytest.approx(4.0, abs=1e-12)


def test_the_derivative_of_a_constant_is_0_after_any_disturbance() -> None:
    runtime = Runtime.of(discretized(Pid(0.0, 0.0, 3.0, 0.2), DigitalSpec(TS)).sections, Precision.FLOAT32)
    state = init(runtime)
    for measurement in (0.0, 10.0, *[7.3] * 200):
        state = step(runtime, state, 0.0, measurement)
    # the lag stops within rounding of the measurement: half a last place of it, times 1/q = (2 Tf + Ts)/(2 Ts) and k_d
    assert abs(float(state.output)) <= 7.3 * 2.0**-24 * 2.5 * 12.0


def test_states_of_derivatives_at_rest_are_no_subnormal_numbers() -> None:
    # lags of up to half a second decay within 600 s
    for precision, gains in itertools.product(Precision, (PID, FoPid(1.0, 0.0, 1.0, 0.8, 0.6, 0.15))):
        digital = DigitalSpec(TS, band_rad_s=(2.0, 60.0), poles=3)
        runtime = Runtime.of(discretized(gains, digital).sections, precision)
        state = step(runtime, init(runtime), 0.0, 1.0)
        for _ in range(6000):
            # the setpoint keeps the error away from 0
            state = step(runtime, state, 1e-3, 0.0)
        assert state.filtered is not None
        assert len(state.filtered) == (1 if gains is PID else 4)
        assert not state.filtered.any()


@pytest.mark.parametrize("gains", [PID, FOPID], ids=["pid", "fopid"])
def test_the_derivatives_states_take_no_correction_from_limits(gains: FoPid) -> None:
    sections = discretized(gains, DigitalSpec(TS)).sections
    free, limited = (Runtime.of(sections, Precision.FLOAT64, limits) for limits in (None, (-0.01, 0.01)))
    states: list[State] = [init(free), init(limited)]
    draw = random.Random(2)
    for _ in range(100):
        r, y = draw.uniform(-1.0, 1.0), draw.uniform(-1.0, 1.0)
        states = [step(one, state, r, y) for one, state in zip((free, limited), states, strict=True)]
    one, two = (state.filtered for state in states)
    assert one is not None
    assert two is not None
    assert one.tobytes() == two.tobytes()


def test_a_weight_of_sections_without_parts_is_refused() -> None:
    sections = replace(discretized(PID, DigitalSpec(TS)).sections, parts=None)
    with pytest.raises(DomainError, match="proportional part"):
        Runtime.of(sections, Precision.FLOAT64, None, None, 0.5)


def test_vectors_of_a_pid_are_equal_for_equal_arguments() -> None:
    double, single = runtimes(export(PID, 0.5, (-1.0, 0.8), 2.0))
    assert len({vector_table(double, single, standard_operations(double)) for _ in range(2)}) == 1

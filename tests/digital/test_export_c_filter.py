"""A measurement filter in C: bit for bit the runtime's arithmetic, in double and float."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from cases.c_export import SANITIZE, replayed, with_each_compiler

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.digital import Export, discretize, export_c
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.vectors import NOT_FINITE, Op, Operation, in_float32, vector_table
from fopi_tune.spec.model import DigitalSpec

discretized = cache(discretize)
TS = 0.1
FILTERS = [MeasurementFilter(1, 0.3), MeasurementFilter(2, 0.3)]
PID, FOPID = Pid(2.0, 1.0, 0.8, 0.15), FoPid(2.0, 1.0, 1.2, 0.8, 0.6, 0.15)
#: every structure, with and without integral and sections
GAINS = [PID, FoPi(0.4, 0.4, 0.8), FoPi(1.5, 0.0, 1.0), FOPID, FoPi(0.5, 0.3, 1.0), Pid(2.0, 0.0, 0.8, 0.15)]
LIMITS = [((-1.0, 0.8), 2.0), (None, None), ((-1.0, 0.8), None)]


def export(gains: FoPi, used: MeasurementFilter, b: float, limits: tuple[float, float] | None = None) -> Export:
    controller = discretized(replace(gains, measurement_filter=used), DigitalSpec(TS))
    return replace(Export("lag", "", "0" * 64, "fopi-tune 0", controller, limits=limits), setpoint_weight=b)


@with_each_compiler
@pytest.mark.parametrize("every", [17, pytest.param(1, marks=pytest.mark.long)])
def test_the_vectors_of_every_structure_with_a_filter_are_met_bit_for_bit(
    tmp_path: Path, compiler: str, every: int
) -> None:
    for place, (gains, used, b, (limits, rate)) in enumerate(itertools.product(GAINS, FILTERS, (1.0, 0.5), LIMITS)):
        if place % every == 0:  # a compiler takes half a second for each
            made = replace(export(gains, used, b, limits), rate_per_s=rate)
            done = replayed(export_c(made), tmp_path / str(place), compiler)
            assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.thinned(2)
@with_each_compiler
@pytest.mark.parametrize("used", FILTERS, ids=["first", "second"])
@pytest.mark.parametrize(
    ("gains", "count"),
    [(PID, 3000), *(pytest.param(g, 100_000, marks=pytest.mark.long) for g in (PID, GAINS[1], FOPID))],
)
def test_thousands_of_operations_behind_a_filter_are_the_runtime_bit_for_bit(
    tmp_path: Path, compiler: str, used: MeasurementFilter, gains: FoPi, count: int
) -> None:
    made = replace(export(gains, used, 1.0, (-1.0, 0.8)), rate_per_s=0.5)
    double, single = (Runtime.of(made.controller.sections, each, made.limits, 0.5, 1.0, used) for each in Precision)
    draw, rows, level = random.Random(7), [Operation(Op.INIT)], 0.0
    while len(rows) < count:
        setpoint, kind = draw.uniform(-1.0, 1.0), draw.random()
        for _ in range(draw.randrange(1, 150)):
            level += 0.05 * (setpoint - level)
            y = level + 0.1 * draw.uniform(-1.0, 1.0)
            if kind < 0.1:
                rows.append(Operation(Op.TRACK, setpoint, y, draw.uniform(-2.0, 2.0)))
            elif draw.random() < 0.01:
                bad = draw.choice(NOT_FINITE)
                rows += [Operation(Op.STEP, bad, y), Operation(Op.STEP, setpoint, bad)]
            else:
                rows.append(Operation(Op.STEP, setpoint, y))
        if draw.random() < 0.1:
            rows.append(Operation(Op.RESET, output=draw.choice((0.0, 0.5, *NOT_FINITE))))
    table = vector_table(double, single, [in_float32(row) for row in rows[:count]])
    done = replayed(export_c(made) | {"test_vectors.csv": table}, tmp_path / "long", compiler, "-O2")
    assert done.returncode == 0, done.stdout + done.stderr
    outputs = [float.fromhex(line.split(",")[4]) for line in table.splitlines()[1:]]
    assert sum(output in (-1.0, 0.8) for output in outputs) > count // 100, "limits are reached"


@pytest.mark.thinned(2)
@with_each_compiler
def test_no_operation_behind_a_filter_is_undefined(tmp_path: Path, compiler: str) -> None:
    for place, (gains, used) in enumerate(zip((PID, GAINS[1]), FILTERS, strict=True)):
        made = export(gains, used, 0.5, (-1.0, 0.8))
        done = replayed(export_c(made), tmp_path / str(place), compiler, *SANITIZE)
        assert done.returncode == 0, done.stdout + done.stderr


def test_the_header_says_the_filter_and_how_far_it_is_from_the_ideal() -> None:
    header = export_c(export(PID, FILTERS[1], 1.0))["fopi_lag_f32.h"]
    assert "behind 1/(1 + sT + s^2 T^2/2), T = 0.3 s, by Tustin's rule, which is off by at most" in header
    assert "the filtered measurement" in header
    assert "lagged[2]" in header

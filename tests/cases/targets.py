"""Controllers of every structure to export, and the rows that an export format is replayed against."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import pytest

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.digital import Export, Units, discretize
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.vectors import Op, Operation, replay, standard_operations
from fopi_tune.spec.model import DigitalSpec

TS = 0.1
PID, FOPID = Pid(2.0, 1.0, 0.8, 0.15), FoPid(2.0, 1.0, 1.2, 0.8, 0.6, 0.15)
#: gains, measurement filter, setpoint weight, limits and rate; the first has every part
STRUCTURES = {
    "all": (PID, MeasurementFilter(2, 0.3), 0.5, (-1.0, 0.8), 2.0),
    "fopi": (FoPi(0.4, 0.4, 0.8), None, 1.0, (0.1, 0.8), None),
    "fopid": (FOPID, MeasurementFilter(1, 0.3), 1.0, None, None),
    "proportional": (FoPi(1.5, 0.0, 1.0), None, 1.0, None, None),
    "weighted": (FoPi(0.5, 0.3, 1.0), None, 0.3, (-1.0, 0.8), 0.5),
    "lagged_proportional": (FoPi(1.5, 0.0, 1.0), MeasurementFilter(1, 0.3), 0.5, (-1.0, 0.8), None),
    "derivative": (Pid(2.0, 0.0, 0.8, 0.15), None, 1.0, (-1.0, 0.8), None),
}
#: the same with numbers at the ends of what is taken
ODD = {
    "least_order": (FoPi(0.4, 0.4, 0.02), None, 1.0, (-1.0, 1.0), None),
    "largest_order": (FoPi(0.4, 0.4, 1.98), None, 0.0, (-1.0, 1.0), None),
    "negative": (FoPi(-0.4, -0.4, 0.8), None, 1.0, (-1.0, 1.0), 0.5),
    "opposed": (FoPi(0.4, -0.4, 1.2), None, 0.5, None, None),
    "no_proportional": (FoPi(0.0, 0.4, 0.8), None, 0.0, (-1.0, 1.0), 1.0),
    "negative_pid": (Pid(-2.0, -1.0, -0.8, 0.15), MeasurementFilter(2, 0.3), 0.0, (-1.0, 1.0), 2.0),
    "derivative_alone": (Pid(0.0, 0.0, 0.8, 0.15), None, 1.0, (-1.0, 1.0), None),
    "slow_filters": (Pid(2.0, 1.0, 0.8, 50.0), MeasurementFilter(2, 100.0), 1.0, (-1.0, 1.0), None),
    "ends_of_orders": (FoPid(2.0, 1.0, 1.98, 0.8, 0.98, 0.15), MeasurementFilter(1, 0.3), 0.0, (-1.0, 1.0), 1.0),
    "tiny": (FoPi(1e-9, 1e-9, 0.8), None, 1.0, (-1.0, 1.0), None),
    "huge": (FoPi(1e9, 1e9, 0.8), None, 1.0, (-1.0, 1.0), None),
    "tiny_limits": (FoPi(0.4, 0.4, 0.8), None, 1.0, (-1e-9, 1e-9), None),
    "limits_beyond_0": (FoPi(0.4, 0.4, 0.8), None, 1.0, (5.0, 6.0), 1e-3),
}


@dataclass(frozen=True)
class Row:
    """A call, and the output that follows it."""

    operation: Operation
    output: float


@cache
def exported(structure: str) -> Export:
    """An export, by its name in `STRUCTURES` or `ODD`."""
    gains, used, b, limits, rate = {**STRUCTURES, **ODD}[structure]
    controller = discretize(gains if used is None else replace(gains, measurement_filter=used), DigitalSpec(TS))
    made = Export("Brake-1.2", 'A "car"s <brake> & more', "0" * 64, "fopi-tune 0", controller, Units("km/h", "<part>"))
    return replace(made, limits=limits, rate_per_s=rate, setpoint_weight=b)


def runtime_of(export: Export, precision: Precision = Precision.FLOAT64) -> Runtime:
    """Its arithmetic in a precision."""
    used = export.controller.gains.measurement_filter
    weight, sections = export.setpoint_weight, export.controller.sections
    return Runtime.of(sections, precision, export.limits, export.rate_per_s, weight, used)


@cache
def rows_of(structure: str, precision: Precision = Precision.FLOAT64) -> tuple[Row, ...]:
    """The test vectors of an export, without `init`, which is a reset to 0, with the outputs of a precision."""
    export = exported(structure)
    operations = [
        Operation(Op.RESET) if operation.op is Op.INIT else operation
        for operation in standard_operations(runtime_of(export))
    ]
    return tuple(map(Row, operations, replay(runtime_of(export, precision), operations).tolist()))


def structures(*each_time: str) -> pytest.MarkDecorator:
    """Every structure and the odd ones, those that are not named with `-m long`."""
    marked = [pytest.param(name, marks=[pytest.mark.long] * (name not in each_time)) for name in (*STRUCTURES, *ODD)]
    return pytest.mark.parametrize("structure", marked)

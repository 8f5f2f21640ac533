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


@dataclass(frozen=True)
class Row:
    """A call, and the output that follows it."""

    operation: Operation
    output: float


@cache
def exported(structure: str) -> Export:
    """An export, by its name in `STRUCTURES`."""
    gains, used, b, limits, rate = STRUCTURES[structure]
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
    """Every structure, those that are not named with `-m long`."""
    marked = [pytest.param(name, marks=[pytest.mark.long] * (name not in each_time)) for name in STRUCTURES]
    return pytest.mark.parametrize("structure", marked)

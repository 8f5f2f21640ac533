"""Traces of the compiled simulation, compared with those of the plain one and with the controller alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.vectors import Op, Operation, replay
from fopi_tune.simulation.scenario import Traces


def assert_equal_but_for_rounding(traces: Traces, plain: Traces, rounding: float) -> None:
    """Every signal of both."""
    for name in ("output", "measured", "error", "demanded", "applied"):
        one, two = getattr(traces, name), getattr(plain, name)
        np.testing.assert_allclose(one, two, rtol=rounding, atol=rounding, err_msg=name)


def assert_demands_of_the_runtime(traces: Traces, controller: Runtime, setpoints: Any) -> None:
    """What is demanded, bit for bit, is the controller's answer to what is measured."""
    for measured, demanded in zip(traces.measured, traces.demanded, strict=True):
        steps = zip(setpoints.tolist(), measured.tolist(), strict=True)
        own = replay(controller, [Operation(Op.STEP, r, y) for r, y in steps])
        assert own.tobytes() == demanded.tobytes()

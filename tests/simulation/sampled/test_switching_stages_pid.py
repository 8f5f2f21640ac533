"""Modes with a derivative on samples: the compiled simulation against the plain one, and what a run must show."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.switching_lines import SwitchingLines
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import Actuator, InactiveController, Mode
from tests.simulation.sampled.test_simulate_rate import assert_same, made, plainly
from tests.simulation.sampled.test_switching_stages import COASTING, COASTING_MIXED, MIXED, RELATIVE, driven, modes

PID = Pid(0.09, 0.03, 0.05, 0.4), Pid(0.07, 0.05, 0.04, 0.3)
#: sections of the derivative of one number or another, and none
MIXES = {
    "both": PID,
    "first": (PID[0], FoPi(0.07, 0.11, 0.45)),
    "second": (FoPi(0.09, 0.025, 0.8), PID[1]),
    "orders": (FoPid(0.09, 0.025, 0.8, 0.04, 0.7, 0.4), PID[1]),
}


def with_derivative(mix: str, rates: tuple[float | None, float | None] = (None, None)) -> list[Mode]:
    return [
        dataclasses.replace(mode, controller=made(gains, limits, rate))
        for mode, gains, limits, rate in zip(modes(), MIXES[mix], [(0.0, 1.0), (-1.0, 0.0)], rates, strict=True)
    ]


@pytest.mark.parametrize("inactive", list(InactiveController))
@pytest.mark.parametrize("lines", [RELATIVE, MIXED, COASTING, COASTING_MIXED], ids=["r", "m", "coast", "coast-mixed"])
def test_the_compiled_run_takes_the_same_turns(lines: SwitchingLines, inactive: InactiveController) -> None:
    for mix, dwell, rates in (
        *((each, 0, (None, None)) for each in MIXES),
        ("both", 4, (0.4, None)),
        ("first", 0, (0.5, 0.3)),
    ):
        both, scenario = with_derivative(mix, rates), driven(lines, inactive, dwell)
        found = simulate(both, scenario)
        assert_same(found, plainly(both, scenario))
        assert set(np.unique(found.mode)) == ({0, 1, 2} if lines.coasts else {1, 2})


@pytest.mark.parametrize("inactive", list(InactiveController))
def test_with_a_rate_of_the_actuator_a_delay_and_a_feed_forward_too(inactive: InactiveController) -> None:
    for lines in (0.3, COASTING):
        scenario = driven(lines, inactive)
        assert scenario.hybrid is not None
        hybrid = dataclasses.replace(scenario.hybrid, fed=((0.02, 0.05), (0.05, 0.3)))
        scenario = dataclasses.replace(scenario, actuator=Actuator(0.7, 1.5), hybrid=hybrid)
        both = with_derivative("both", (0.5, None))
        assert_same(simulate(both, scenario), plainly(both, scenario))

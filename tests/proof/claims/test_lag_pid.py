"""The closed forms of the lag with a PID:  levels around the worst of a dense grid are told apart."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from cases.plants import lag
from cases.random_pids import sized
from flint import ctx

from fopi_tune.core.controller import Pid
from fopi_tune.core.peaks import Response
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.claims.bound import Bound
from fopi_tune.proof.claims.branch_and_bound import check_record, search
from fopi_tune.proof.claims.lag import LagBound, closed_form

#: neper; the grid errs by less, 0.004 in u and 1/120 of the range of tau at an extreme
APART = 1e-3


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


def dense(loop: BallLoop, response: Response, largest: bool) -> float:
    """ln|R| over 0.01 to 100 rad/s and every time constant, written down anew."""
    numbers, pid = loop.family.parameters, loop.gains
    s = 1j * np.geomspace(0.01, 100.0, 2401)[:, None]
    tau = np.linspace(numbers["time_constant_s"].min, numbers["time_constant_s"].max, 121)[None, :]
    assert isinstance(pid, Pid)
    c = pid.kp + pid.ki / s + pid.kd * s / (pid.derivative_filter_time_constant_s * s + 1.0)
    gain = c * numbers["static_gain"].nominal / (tau * s + 1.0) * np.exp(-s * numbers["dead_time_s"].nominal)
    values = {
        Response.SENSITIVITY: 1.0 / (1.0 + gain),
        Response.COMPLEMENTARY_SENSITIVITY: gain / (1.0 + gain),
        Response.CONTROL_SENSITIVITY: c / (1.0 + gain),
        Response.LOOP_GAIN: gain,
        Response.LOAD_SENSITIVITY: gain / c / (1.0 + gain),
    }[response]
    sizes = np.log(np.abs(values))
    return float(sizes.max() if largest else sizes.min())


@pytest.mark.thinned(3)
@pytest.mark.parametrize("response", list(Response))
@pytest.mark.parametrize("upper", [True, False])
def test_levels_around_the_worst_response_are_told_apart(response: Response, upper: bool) -> None:
    rng = np.random.default_rng([41, list(Response).index(response), int(upper)])
    for _ in range(4):
        tau = sized(rng, 0.5, 3.0)
        sign = float(rng.choice([1.0, -1.0], p=[0.8, 0.2]))
        family = lag(sign * sized(rng, 0.5, 2.0), (tau, 1.5 * tau), float(rng.choice([0.0, sized(rng, 0.05, 0.5)])))
        kp, ki, kd = (sign * sized(rng, 0.1, 1.5) for _ in range(3))
        loop = BallLoop(Pid(kp, ki * float(rng.choice([0.0, 1.0, 1.0])), kd, sized(rng, 0.02, 0.5)), family)
        worst = dense(loop, response, upper)
        band = loop.band(0.01, 100.0)
        for inside, shown in ((APART, True), (-APART, False)):
            level = worst + inside if upper else worst - inside
            claim = closed_form(Bound(loop, response, level, upper, (band, *loop.family_box), 0.0))
            assert isinstance(claim, LagBound)
            found = search(claim, 20_000)
            assert found.shown is shown, (loop, response, upper, worst)
            assert not shown or check_record(claim, found.record) is None

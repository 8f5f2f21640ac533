"""How many sampled loops are simulated in a second:  the compiled kernel, NumPy over plants, `control`, in one run.

    python benchmarks/simulation.py [--plants N] [--memory N]

The loop: the car with throttle and brake, uncertain plants, 300 samples, 8 controller sections a mode, saturation,
switching with hysteresis.  Ratios within one run are what to compare; other work on the machine moves the rest.
"""

from __future__ import annotations

import argparse
import dataclasses
import resource
import time
import warnings
from collections.abc import Callable
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.digital.discretize import discretize
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.simulation.sampled.plants import DiscretePlants, discretize_plants
from fopi_tune.simulation.sampled.simulate import CHUNK, measure_chunks
from fopi_tune.simulation.scenario import (
    Actuator,
    Horizon,
    Hybrid,
    InactiveController,
    Mode,
    Scenario,
    Sensor,
    Signals,
    Start,
)
from fopi_tune.spec.model import DigitalSpec

TS = 0.2
STEPS = 300
EPS = 0.5
START = 20.0
#: the first sample that is measured
FIRST = 200
#: plants a block for NumPy: as many as are fastest
NUMPY_PLANTS = 4096

Array = NDArray[np.float64]


def controllers() -> tuple[Runtime, Runtime]:
    """The throttle's and the brake's, an integrator and 7 poles each."""
    made = []
    for gains, limits in ((FoPi(0.09, 0.025, 0.8), (0.0, 1.0)), (FoPi(0.07, 0.11, 0.45), (-1.0, 0.0))):
        sections = discretize(gains, DigitalSpec(TS, "oustaloup", 7)).sections
        assert len(sections.poles) == 8
        made.append(Runtime.of(sections, Precision.FLOAT64, limits))
    return made[0], made[1]


def throttle(begin: int, end: int) -> Plants:
    """Plants of an index range; cheap pseudo-random numbers from the index."""
    part = np.modf(0.6180339887498949 * np.arange(begin, end))[0]
    return Plants((4.0 + 0.8 * part)[:, None], np.stack([np.ones_like(part), 0.15 + 0.05 * part], axis=1), 0.0 * part)


def brake(begin: int, end: int) -> Plants:
    """The same for the brake."""
    part = np.modf(0.7548776662466927 * np.arange(begin, end))[0]
    return Plants(np.ones((len(part), 1)), np.stack([1.6 + 1.5 * part, np.ones_like(part)], axis=1), 0.0 * part)


def behind_a_lag(plants: Callable[[int, int], Plants]) -> Callable[[int, int], Plants]:
    """The same plants behind a lag of 0.3 s, of second order."""

    def lagged(begin: int, end: int) -> Plants:
        of = plants(begin, end)
        slow, one = of.denominator.T
        return Plants(of.numerator, np.stack([0.3 * slow, slow + 0.3 * one, one], axis=1), of.dead_time_s)

    return lagged


def behind_a_dead_time(plants: Callable[[int, int], Plants], dead_time_s: float) -> Callable[[int, int], Plants]:
    """The same plants with a dead time."""

    def late(begin: int, end: int) -> Plants:
        return dataclasses.replace(plants(begin, end), dead_time_s=np.full(end - begin, dead_time_s))

    return late


def profile() -> Array:
    """Three levels of velocity, km/h."""
    k = np.arange(STEPS)
    return np.where(k < 100, 20.0, np.where(k < 200, 10.0, 15.0))


def by_numpy(pair: tuple[Runtime, Runtime], count: int) -> tuple[Array, Array, Array]:
    """The same loops with NumPy over plants, block by block; final errors, integrals of |e|, numbers of jumps."""
    parts = [_block(pair, begin, min(begin + NUMPY_PLANTS, count)) for begin in range(0, count, NUMPY_PLANTS)]
    error, integral, jumps = (np.concatenate(column) for column in zip(*parts, strict=True))
    return error, integral, jumps


def _block(pair: tuple[Runtime, Runtime], begin: int, end: int) -> tuple[Array, Array, Array]:
    """One block:  arrays of long rows of plants, no new ones while it runs, and a jump changes its own columns only."""
    held, m = [discretize_plants(plants(begin, end), TS) for plants in (throttle, brake)], end - begin
    of_modes = [_columns(controller, part) for controller, part in zip(pair, held, strict=True)]
    (p, w, r, one), (q, x) = (np.array(rows) for rows in of_modes[0]), np.zeros((2, 8, m))
    upwards, y, iae, jumps = np.ones(m, dtype=bool), np.full(m, START), np.zeros(m), np.zeros(m)
    e, v, u, d = np.empty((4, m))
    inner, leaving, other = np.empty((8, m)), np.empty(m, dtype=bool), np.empty(m, dtype=bool)
    for k, reference in enumerate(profile()):
        np.subtract(reference, y, out=e)
        # mode 1 (upwards) is left at e <= -eps, mode 2 at e >= eps
        np.less_equal(e, -EPS, out=leaving)
        leaving &= upwards
        np.greater_equal(e, EPS, out=other)
        leaving |= np.greater(other, upwards, out=other)
        if leaving.any():
            which = np.flatnonzero(leaving)
            x[:, which], q[:, which] = q[:, which], x[:, which]
            jumps += leaving
            upwards ^= leaving
            for mode, some in ((0, which[upwards[which]]), (1, which[~upwards[which]])):
                for mine, rows in zip((p, w, r, one), of_modes[mode], strict=True):
                    mine[:, some] = rows[:, some]
        np.multiply(one[0], e, out=v)
        for state in x:
            v += state
        np.minimum(np.maximum(v, one[2], out=u), one[3], out=u)
        np.subtract(u, v, out=d)
        d *= one[1]
        # p (x + w d) + r e
        x += np.multiply(w, d, out=inner)
        x *= p
        x += np.multiply(r, e, out=inner)
        if k >= FIRST:
            iae += np.abs(e, out=d)
        if k < STEPS - 1:
            y *= one[4]
            u *= one[5]
            y += u
    if not np.isfinite(x).all():
        raise ArithmeticError("the plain loop does not hold what is not finite")
    return e, TS * iae, jumps


def _columns(controller: Runtime, part: DiscretePlants) -> tuple[Array, Array, Array, Array]:
    """A mode's numbers for every plant: p, w, r; then direct, g, the limits and the plant's own two."""
    ones = np.ones((8, len(part)))
    transition, gain, _ = part.control.whole
    single = [controller.direct, controller.tracking_gain, *controller.limits]
    plant = np.concatenate([np.outer(single, ones[0]), transition[:, :, 0].T, gain.T])
    rows = (controller.poles, controller.weights, controller.residues)
    p, w, r = (np.array(row)[:, None] * ones for row in rows)
    return p, w, r, plant


def by_control(pair: tuple[Runtime, Runtime]) -> Array:
    """One of these loops with `control`; its output."""
    held = [discretize_plants(throttle(0, 1), TS), discretize_plants(brake(0, 1), TS)]
    phi = [float(h.control.whole[0][0, 0, 0]) for h in held]
    gain = [float(h.control.whole[1][0, 0]) for h in held]
    tables = [(c, np.array(c.poles), np.array(c.weights), np.array(c.residues)) for c in pair]

    def sample(x: Array, e: float) -> tuple[int, float, float]:
        mode = int(e <= -EPS) if x[16] == 0 else int(e < EPS)
        controller = pair[mode]
        v = controller.direct * e + x[8 * mode : 8 * mode + 8].sum()
        return mode, v, min(max(v, controller.limits[0]), controller.limits[1])

    def update(_t: float, x: Array, inputs: Array, _params: Any) -> Array:
        mode, v, u = sample(x, inputs[0])
        controller, p, w, r = tables[mode]
        following, part = x.copy(), slice(8 * mode, 8 * mode + 8)
        following[part] = p * (x[part] + w * controller.tracking_gain * (u - v)) + r * inputs[0]
        following[16] = mode
        return following

    def output(_t: float, x: Array, inputs: Array, _params: Any) -> Array:
        mode, _, u = sample(x, inputs[0])
        return np.array([u, mode])

    computer = control.nlsys(update, output, inputs=["e"], outputs=["u", "mode"], states=17, dt=TS, name="computer")
    car = control.nlsys(
        lambda _t, x, v, _p: np.array([phi[int(v[1])] * x[0] + gain[int(v[1])] * v[0]]),
        lambda _t, x, _v, _p: x, inputs=["u", "mode"], outputs=["y"], states=1, dt=TS, name="car",
    )  # fmt: skip
    difference = control.summing_junction(["r", "-y"], "e")
    loop = control.interconnect([computer, car, difference], inputs=["r"], outputs=["y"])
    start = np.zeros(18)
    start[17] = START
    respond: Any = control.input_output_response
    return np.asarray(respond(loop, TS * np.arange(STEPS), profile(), start).outputs)


def seconds(run: Callable[[], object], runs: int = 3) -> float:
    """The shortest of several runs, s."""
    times = []
    for _ in range(runs):
        begin = time.perf_counter()
        run()
        times.append(time.perf_counter() - begin)
    return min(times)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="How many sampled loops are simulated in a second.")
    parser.add_argument("--plants", type=int, default=1_000_000, help="plants of the kernel's runs")
    parser.add_argument("--memory", type=int, default=10_000_000, help="plants of the run whose memory is measured")
    count = parser.parse_args().plants
    pair = controllers()
    modes = (Mode(pair[0], throttle), Mode(pair[1], brake))
    late = (Mode(pair[0], behind_a_dead_time(throttle, 0.5)), Mode(pair[1], behind_a_dead_time(brake, 0.31)))
    second = (Mode(pair[0], behind_a_lag(throttle)), Mode(pair[1], behind_a_lag(brake)))
    signals = Signals(profile())
    plain = Scenario(TS, signals, start=Start(START), hybrid=Hybrid(EPS))
    noisy = dataclasses.replace(plain, sensor=Sensor(0.0, 0.05, 1))
    tracking = dataclasses.replace(plain, hybrid=Hybrid(EPS, InactiveController.TRACK))
    single = dataclasses.replace(plain, hybrid=None)
    delay = Actuator(2.0, 1.4)
    horizon = Horizon(0.3, FIRST)

    def run(scenario: Scenario, used: tuple[Mode, ...] = modes, plants: int = count) -> float:
        return sum(float(part.switches.sum()) for part in measure_chunks(used, scenario, horizon, plants))

    begin = time.perf_counter()
    run(plain, plants=CHUNK)
    print(f"first call, compiling or reading what was compiled: {time.perf_counter() - begin:.1f} s")
    print(f"{'plants of 300 samples, 8 sections':<52}{'per s':>12}{'per s of one core':>20}{'jumps':>8}")
    base = base_alone = 0.0
    for label, scenario, used in (
        ("throttle and brake", plain, modes),
        ("throttle only", single, modes[:1]),
        ("throttle and brake, the inactive one tracking", tracking, modes),
        ("throttle and brake, delay 1.4 samples, rate limit", dataclasses.replace(plain, actuator=delay), modes),
        ("throttle and brake, noise", noisy, modes),
        ("throttle and brake, noise, delay, rate limit", dataclasses.replace(noisy, actuator=delay), modes),
        ("throttle and brake, dead times 0.5 s and 0.31 s", plain, late),
        ("of second order", plain, second),
        ("of second order, delay 1.4 samples", dataclasses.replace(plain, actuator=delay), second),
    ):
        used_before = time.process_time()
        rate = count / seconds(lambda s=scenario, u=used: run(s, u))
        alone = 3 * count / (time.process_time() - used_before)
        base, base_alone = base or rate, base_alone or alone
        print(f"{label:<52}{rate:>12,.0f}{alone:>20,.0f}{run(scenario, used, CHUNK) / CHUNK:>8.1f}")
    many = 8 * NUMPY_PLANTS
    used_before = time.process_time()
    rate = many / seconds(lambda: by_numpy(pair, many))
    alone = 3 * many / (time.process_time() - used_before)
    label = "throttle and brake, NumPy over plants, one thread"
    print(f"{label:<52}{rate:>12,.0f}{alone:>20,.0f}   kernel {base_alone / alone:,.1f} times, core by core")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        one = 1.0 / seconds(lambda: by_control(pair))
        output = by_control(pair).ravel()[-1]
    print(f"{'throttle and brake, control':<52}{one:>12,.1f}   kernel {base / one:,.0f} times")
    ours, theirs = next(iter(measure_chunks(modes, plain, horizon, NUMPY_PLANTS))), by_numpy(pair, NUMPY_PLANTS)
    for kernel, plain_loop in zip((ours.final_error, ours.iae, ours.switches), theirs, strict=True):
        np.testing.assert_allclose(plain_loop, kernel, rtol=0.0, atol=1e-12)
    print(f"all three the same: errors, integrals and jumps of {NUMPY_PLANTS} plants to 1e-12 with NumPy, ", end="")
    print(f"one last output to {abs(profile()[-1] - ours.final_error[0] - output):.0e} with control")
    memory = parser.parse_args().memory
    if memory:
        begin = time.perf_counter()
        run(plain, plants=memory)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        print(f"{memory:,} plants: {time.perf_counter() - begin:.1f} s, peak memory of the process {peak:.0f} MB")


if __name__ == "__main__":
    main()

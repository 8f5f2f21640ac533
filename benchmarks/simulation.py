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
from fopi_tune.spec.model import DigitalSpec
from fopi_tune.validation.plants import hold
from fopi_tune.validation.scenario import Actuator, Horizon, Hybrid, Inactive, Mode, Scenario, Sensor, Signals, Start
from fopi_tune.validation.simulate import CHUNK, measure_chunks

TS = 0.2
STEPS = 300
EPS = 0.5
START = 20.0
#: numbers of plants at once for NumPy: as many as are fastest
NUMPY_PLANTS = 2000

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


def profile() -> Array:
    """Three levels of velocity, km/h."""
    k = np.arange(STEPS)
    return np.where(k < 100, 20.0, np.where(k < 200, 10.0, 15.0))


def by_numpy(count: int) -> Array:
    """The same loops with NumPy over plants; the output at the last sample."""
    pair = controllers()
    held = [hold(throttle(0, count), TS), hold(brake(0, count), TS)]
    phi = np.array([h.control.whole[0][:, 0, 0] for h in held])
    gain = np.array([h.control.whole[1][:, 0] for h in held])
    p, w, r = (np.array([getattr(c, name) for c in pair]) for name in ("poles", "weights", "residues"))
    direct, g = (np.array([getattr(c, name) for c in pair]) for name in ("direct", "tracking_gain"))
    low, high = np.array([c.limits for c in pair]).T
    x, mode, y, rows = np.zeros((2, count, 8)), np.zeros(count, dtype=int), np.full(count, START), np.arange(count)
    peak, iae = np.zeros(count), np.zeros(count)
    last, final = np.zeros(count), y
    for reference in profile():
        e = reference - y
        mode = np.where(mode == 0, y >= reference + EPS, y > reference - EPS).astype(int)
        old = x[mode, rows]
        v = direct[mode] * e
        for k in range(8):
            v = v + old[:, k]
        u = np.clip(v, low[mode], high[mode])
        new = p[mode] * (old + w[mode] * (g[mode] * (u - v))[:, None]) + r[mode] * e[:, None]
        good = np.isfinite(e) & np.isfinite(v) & np.isfinite(new).all(axis=1)
        x[mode, rows] = np.where(good[:, None], new, old)
        last = np.where(good, u, last)
        iae += np.abs(e)
        peak = np.maximum(peak, np.abs(last))
        final, y = y, phi[mode, rows] * y + gain[mode, rows] * last
    return final


def by_control() -> Array:
    """One of these loops with `control`; its output."""
    pair, held = controllers(), [hold(throttle(0, 1), TS), hold(brake(0, 1), TS)]
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
    signals = Signals(profile())
    plain = Scenario(TS, signals, start=Start(START), hybrid=Hybrid(EPS))
    noisy = dataclasses.replace(plain, sensor=Sensor(0.0, 0.05, 1))
    tracking = dataclasses.replace(plain, hybrid=Hybrid(EPS, Inactive.TRACK))
    single = dataclasses.replace(plain, hybrid=None)
    delay = Actuator(2.0, 1.4)
    horizon = Horizon(0.3, 200)

    def run(scenario: Scenario, used: tuple[Mode, ...] = modes, plants: int = count) -> float:
        return sum(float(part.switches.sum()) for part in measure_chunks(used, scenario, horizon, plants))

    begin = time.perf_counter()
    run(plain, plants=CHUNK)
    print(f"first call, compiling or reading what was compiled: {time.perf_counter() - begin:.1f} s")
    print(f"{'plants of 300 samples, 8 sections':<52}{'per s':>12}{'per s of one core':>20}{'jumps':>8}")
    base = 0.0
    for label, scenario, used in (
        ("throttle and brake", plain, modes),
        ("throttle only", single, modes[:1]),
        ("throttle and brake, the inactive one tracking", tracking, modes),
        ("throttle and brake, delay 1.4 samples, rate limit", dataclasses.replace(plain, actuator=delay), modes),
        ("throttle and brake, noise", noisy, modes),
        ("throttle and brake, noise, delay, rate limit", dataclasses.replace(noisy, actuator=delay), modes),
    ):
        used_before = time.process_time()
        rate = count / seconds(lambda s=scenario, u=used: run(s, u))
        alone = 3 * count / (time.process_time() - used_before)
        base = base or rate
        print(f"{label:<52}{rate:>12,.0f}{alone:>20,.0f}{run(scenario, used, CHUNK) / CHUNK:>8.1f}")
    by_arrays = NUMPY_PLANTS / seconds(lambda: by_numpy(NUMPY_PLANTS))
    print(f"{'throttle and brake, NumPy over plants':<52}{by_arrays:>12,.0f}   kernel {base / by_arrays:,.0f} times")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        one = 1.0 / seconds(by_control)
    print(f"{'throttle and brake, control':<52}{one:>12,.1f}   kernel {base / one:,.0f} times")
    ours = next(iter(measure_chunks(modes, plain, horizon, 4)))
    final = profile()[-1] - ours.final_error
    print(f"last outputs: kernel {final[0]:.9f}, NumPy {by_numpy(4)[0]:.9f}, control {by_control().ravel()[-1]:.9f}")
    memory = parser.parse_args().memory
    if memory:
        begin = time.perf_counter()
        run(plain, plants=memory)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        print(f"{memory:,} plants: {time.perf_counter() - begin:.1f} s, peak memory of the process {peak:.0f} MB")


if __name__ == "__main__":
    main()

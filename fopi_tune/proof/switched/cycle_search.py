"""The search for periodic orbits:  simulation over a grid of setpoints and plants, until the modes repeat.

The loop rests at a high output and is asked for a lower one: the step down that makes the lowering mode act.  What
is found is a word, which `cycles` tests.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.proof.switched.cycles import LONGEST_WORD, CycleProof, verify_cycle
from fopi_tune.proof.switched.definite import lower_triangle, midpoints
from fopi_tune.proof.switched.model import SwitchedModel
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import (
    Actuator,
    Hybrid,
    InactiveController,
    InitialInput,
    Mode,
    Scenario,
    Signals,
    Start,
)

#: samples of a simulation, and those at its end that must repeat
_SAMPLES, _TAIL = 60_000, 3 * LONGEST_WORD
#: setpoints as parts of the output that the first mode's upper limit holds (with two digits), and where it rests before
_SETPOINTS, _REST = (0.12, 0.24, 0.32, 0.4, 0.48, 0.6, 0.8), 0.995
#: such an output where there is no such limit, in distances of the farther line
_WITHOUT_LIMIT = 50.0
#: of both families, corners and nominal plants that are simulated side by side
_MOST_PLANTS = 8


def prove_cycles(model: SwitchedModel, setpoints: tuple[float, float] | None) -> tuple[CycleProof, ...]:
    """Orbits that are proved, one for each setpoint and pair of plants at most.

    Args:
        model: with `obstacle == ""`.
        setpoints: least and largest r, in the output's unit; None: most of what the first mode can hold.
    """
    top = _largest_output(model)
    if setpoints is None:
        tried: Sequence[float] = [float(f"{part * top:.2g}") for part in _SETPOINTS]
    else:
        tried = np.linspace(*setpoints, len(_SETPOINTS)).tolist()
    raising, lowering = _plants(model)
    found: list[CycleProof] = []
    for setpoint in dict.fromkeys(tried):
        start = max(_REST * top, setpoint + 4.0 * _reach(model))
        words = _words(model, setpoint, start, raising, lowering)
        proofs = (
            _proved(model, setpoint, raising[i], lowering[i], word) for i, word in enumerate(words) if word is not None
        )
        found += [proof for proof in proofs if proof is not None]
    return tuple(found)


def _reach(model: SwitchedModel) -> float:
    """Of the line that is farther from the setpoint, output unit."""
    return max(abs(model.upper), abs(model.lower))


def _largest_output(model: SwitchedModel) -> float:
    """The output that the first mode's upper limit holds, of the nominal plant."""
    loop, numbers = model.loops[0], model.loops[0].plant.parameters
    high = loop.controller.limits[1]
    lag = loop.plant.model == "lag"
    gain = numbers["static_gain"].nominal if lag else numbers["gain"].nominal / numbers["pole_rad_s"].nominal
    found = gain * high
    return found if math.isfinite(found) and found < 1e12 else _WITHOUT_LIMIT * _reach(model)


def _plants(model: SwitchedModel) -> tuple[Array, Array]:
    """Pairs of plants, corners first; shapes (m, p) and (m, q)."""
    raising, lowering = (np.roll(loop.plant.corners(4), -1, axis=0) for loop in model.loops)
    raising, lowering = (rows if rows.shape[1] else rows[:1] for rows in (raising, lowering))
    one, other = (
        rows[:, [loop.plant.uncertain_names.index(name) for name in model.shared]]
        for rows, loop in zip((raising, lowering), model.loops, strict=True)
    )
    pairs = [(i, j) for i in range(len(raising)) for j in range(len(lowering)) if np.array_equal(one[i], other[j])]
    pairs = pairs[:_MOST_PLANTS]
    return raising[[i for i, _ in pairs]], lowering[[j for _, j in pairs]]


def _words(
    model: SwitchedModel, setpoint: float, start: float, raising: Array, lowering: Array
) -> list[tuple[str, str] | None]:
    """The repeating word of each pair of plants; None where the mode stays, or nothing repeats."""
    scenario = Scenario(
        model.sample_time_s,
        Signals(np.full(_SAMPLES, setpoint)),
        start=Start(start, InitialInput.REST, bumpless=True),
        actuator=Actuator(delay_samples=model.loops[0].delay_samples),
        hybrid=Hybrid(model.hysteresis, InactiveController.of(model.memory), min_dwell_samples=model.min_dwell_samples),
    )
    modes = [
        Mode(loop.controller, Plants.members(loop.plant, points))
        for loop, points in zip(model.loops, (raising, lowering), strict=True)
    ]
    traces = simulate(modes, scenario)
    return [_word(model, traces.mode[i, -_TAIL:], traces.demanded[i, -_TAIL:]) for i in range(len(raising))]


def _word(model: SwitchedModel, mode: NDArray[np.int64], demanded: Array) -> tuple[str, str] | None:
    low, high = (np.array([loop.controller.limits[end] for loop in model.loops])[mode - 1] for end in (0, 1))
    part = (demanded >= high).astype(np.int64) - (demanded <= low).astype(np.int64)
    if np.all(mode == mode[0]):
        return None
    both = 3 * mode + part
    period = next((n for n in range(2, LONGEST_WORD + 1) if np.array_equal(both[n:], both[:-n])), None)
    if period is None:
        return None
    return "".join("TB"[m - 1] for m in mode[-period:]), "".join("-0+"[p + 1] for p in part[-period:])


def _proved(
    model: SwitchedModel, setpoint: float, raising: Array, lowering: Array, word: tuple[str, str]
) -> CycleProof | None:
    """The proof of a word with its pull, where there is one."""
    from scipy.linalg import solve_discrete_lyapunov

    plants = model.loops[0].plant.describe(raising), model.loops[1].plant.describe(lowering)
    plain = CycleProof(setpoint, plants, *word, None, 0.0, 0.0)
    orbit = verify_cycle(model, plain)
    if orbit is None:
        return None
    plain = replace(plain, lowest=orbit.lowest, highest=orbit.highest)
    matrix = midpoints(orbit.matrix)
    radius = float(np.abs(np.linalg.eigvals(matrix)).max())
    if not radius < 1.0:
        return plain
    # half of the distance to the unit circle is left for the strict inequality
    s = solve_discrete_lyapunov((matrix / (1.0 - 0.5 * (1.0 - radius))).T, np.eye(len(matrix)))
    pulled = replace(plain, attraction=lower_triangle(s))
    return pulled if verify_cycle(model, pulled) is not None else plain

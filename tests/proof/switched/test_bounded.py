"""Bounds of output and memories hold under every switching, and are not far from what switching reaches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases import switched
from oracles.switched_loop import run_any

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.switched.bounded import BoundedProof, MemoryBounds, verify_bounded
from fopi_tune.proof.switched.bounded_search import prove_bounded
from fopi_tune.proof.switched.model import Memory, SwitchedLoop, SwitchedModel, lag_range

MEMORIES = ("reset", "tracking", "held")
LANES, SAMPLES = 60, 1500


def proof_of(memory: str) -> BoundedProof:
    found = switched.certificate(memory).bounded
    assert found is not None
    return found


def bounds_of(memory: str) -> list[MemoryBounds]:
    return [each for each in proof_of(memory).memories if each is not None]


def dwells(rng: np.random.Generator) -> np.ndarray:
    """Modes that stay for a time of their own in each lane, short ones and long ones; shape (samples, lanes)."""
    found = np.zeros((SAMPLES, LANES), dtype=int)
    for lane in range(LANES):
        longest = [1, 2, 5, 20, 200, SAMPLES][lane % 6]
        lengths = rng.integers(1, longest + 1, (SAMPLES, 2)).ravel()
        found[:, lane] = np.repeat(np.arange(len(lengths)) % 2, lengths)[:SAMPLES]
    return found


def steps_between(rng: np.random.Generator, low: float, high: float) -> Array:
    """A number that jumps, often to an end; shape (samples, lanes)."""
    values = rng.choice([low, high, np.nan], (SAMPLES, LANES))
    values = np.where(np.isnan(values), rng.uniform(low, high, values.shape), values)
    stays = rng.random(values.shape) < np.resize([0.0, 0.9, 0.99, 0.999], LANES)
    stays[0] = False
    last = np.maximum.accumulate(np.where(stays, 0, np.arange(SAMPLES)[:, None]), axis=0)
    return np.take_along_axis(values, last, axis=0)


def drive(model: SwitchedModel, proof: BoundedProof, seed: int) -> tuple[Array, list[Array]]:
    rng, lags = np.random.default_rng(seed), []
    for loop in model.loops:
        ranges = lag_range(loop, model.sample_time_s)
        ends = [(float(ends[0]), float(ends[1])) for ends in (ranges.shares, ranges.gains)]
        lags.append((steps_between(rng, *ends[0]), steps_between(rng, *ends[1])))
    memories = []
    for loop in model.loops:
        x = np.zeros((len(loop.controller.poles), LANES))
        x[0] = rng.uniform(*loop.controller.limits, LANES)
        memories.append(x)
    setpoint, output = steps_between(rng, *proof.setpoints), rng.uniform(*proof.outputs, LANES)
    return run_any(model, setpoint, output, dwells(rng), memories, lags)


@pytest.mark.thinned(3)
@pytest.mark.parametrize("memory", MEMORIES)
def test_no_switching_leaves_the_bounds(memory: str) -> None:
    proof, bounds = proof_of(memory), bounds_of(memory)
    for seed in (1, 2):
        outputs, largest = drive(switched.model(memory), proof, seed)
        assert proof.outputs[0] <= outputs.min()
        assert outputs.max() <= proof.outputs[1]
        for found, each in zip(largest, bounds, strict=True):
            assert found[0] <= each.total
            assert np.all(found[1:] <= each.sections)


def worst(loop: SwitchedLoop, memory: Memory, error: float, on: int, off: int, samples: int = 12_000) -> Array:
    """The largest sum of sections, and of each, that the worst controls and errors reach under periodic switching."""
    c = loop.controller
    p, w, r = np.array(c.poles), np.array(c.weights), np.array(c.residues)
    count, largest = len(p), max(map(abs, c.limits))
    active = np.diag(p) - c.tracking_gain * np.outer(p * w, np.ones(count))
    b = c.tracking_gain * p * w
    inputs = np.array([largest * b, error * (r - c.direct * b)]).T
    idle, idle_inputs = np.eye(count), np.zeros((count, 2))
    if memory is Memory.TRACKING:
        idle = np.diag(p)
        idle[0] = -p
        idle[0, 0] = 0.0
        idle_inputs[0] = largest, -c.direct * error
    rows, found = np.vstack([np.ones(count), np.eye(count)]), np.zeros(count + 1)
    best = found
    # backwards from the last sample: what each earlier input adds to it, all with the worst sign
    for k in range(samples):
        first = k % (on + off) < on
        found = found + np.abs(rows @ (inputs if first else idle_inputs)).sum(axis=1)
        rows = rows @ (active if first else idle)
        best = found
    return best


@pytest.mark.parametrize(("memory", "within"), [("held", 1.5), ("tracking", 1.5)])
def test_the_bounds_are_near_to_what_a_switching_reaches(memory: str, within: float) -> None:
    model, proof = switched.model(memory), proof_of(memory)
    error = max(proof.setpoints[1] - proof.outputs[0], proof.outputs[1] - proof.setpoints[0])
    patterns = [(1, 1), (1, 3), (4, 1), (30, 1), (300, 1), (10**9, 0)] if memory == "tracking" else [(1, 0)]
    for loop, bounds in zip(model.loops, bounds_of(memory), strict=True):
        reached = np.max([worst(loop, model.memory, error, *each) for each in patterns], axis=0)
        stated = np.array([bounds.total, *bounds.sections])
        assert np.all(reached <= stated)
        assert stated[0] <= within * reached[0]
        assert stated[1:].max() <= within * reached[1:].max()


def test_an_integrator_alone_with_both_weights_is_bounded_by_its_closed_form() -> None:
    # one section: x <- (1 - g) x + g u + (r - direct g) e
    model = switched.model("held")
    c = replace(
        model.loops[0].controller, poles=(1.0,), residues=(0.1,), weights=(1.0,), direct=0.4, tracking_gain=0.25
    )
    loops = replace(model.loops[0], controller=c), replace(model.loops[1], controller=replace(c, limits=(-1.0, 0.0)))
    for memory in Memory:
        small = replace(model, loops=loops, memory=memory)
        found = prove_bounded(small, None)
        assert found.reason == ""
        assert found.proof is not None
        first = found.proof.memories[0]
        assert first is not None
        # r = direct g: the error alone moves nothing, |x| <= 1; while it tracks, u - direct e of before is in x
        start = 1.0 if memory is not Memory.TRACKING else 1.0 + 0.4 * 26.2
        assert first.total == pytest.approx(start, rel=1e-6)


def test_what_has_no_limits_is_told() -> None:
    model = switched.model("held")
    c = replace(model.loops[0].controller, limits=(0.0, 1.7e308))
    found = prove_bounded(replace(model, loops=(replace(model.loops[0], controller=c), model.loops[1])), None)
    assert found.proof is None
    assert found.reason == "throttle: without output_limits nothing bounds the output under every switching"


def test_a_memory_without_anti_windup_is_not_bounded_but_the_output_is() -> None:
    model = switched.model("held")
    c = replace(model.loops[1].controller, tracking_gain=0.0)
    free = replace(model, loops=(model.loops[0], replace(model.loops[1], controller=c)))
    found = prove_bounded(free, None)
    assert found.proof is not None
    assert found.proof.memories[0] is not None
    assert found.proof.memories[1] is None
    assert found.reason == "no bound of the memory of brake under every switching was found"
    assert verify_bounded(free, found.proof)


def test_asked_setpoints_are_taken_in() -> None:
    found = prove_bounded(switched.model("reset"), (10.0, 40.0)).proof
    assert found is not None
    assert found.setpoints == (-1.0, 40.0)
    assert found.outputs == (-1.0, 25.2)

"""Samples of a run between its nodes, by the exact flow from the last node before each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.zero_order_hold import matrix_expm1
from fopi_tune.simulation.hybrid.flow import Flow

#: matrices held at once
_AT_ONCE = 500


class Node(NamedTuple):
    """The state just after `time_s`, and the flow that goes on from it."""

    time_s: float
    mode: int
    flow: Flow
    w: Array


class Samples(NamedTuple):
    """Arrays of shape (m,): y, y', u within its limits, r - y, and the mode."""

    output: Array
    rate: Array
    control: Array
    error: Array
    mode: np.ndarray


def sampled(nodes: Sequence[Node], times: Array) -> Samples:
    """The samples at these times.

    Args:
        nodes: in the order of time; where several share one, the last counts.
        times: shape (m,), s, not before the first node.
    """
    output, rate, control, error = np.zeros((4, len(times)))
    last = np.searchsorted(np.array([node.time_s for node in nodes]), times, side="right") - 1
    rows_of: dict[int, list[int]] = {}
    for row, node in enumerate(last):
        rows_of.setdefault(id(nodes[node].flow), []).append(row)
    for same in rows_of.values():
        flow = nodes[last[same[0]]].flow
        for rows in (same[i : i + _AT_ONCE] for i in range(0, len(same), _AT_ONCE)):
            w = np.array([nodes[last[i]].w for i in rows])
            since = times[rows] - np.array([nodes[last[i]].time_s for i in rows])
            w = w + np.einsum("mij,mj->mi", matrix_expm1(flow.matrix * since[:, None, None]), w)
            output[rows], error[rows], rate[rows] = w[:, 0], w[:, -3] - w[:, 0], w @ flow.matrix[0]
            demand = flow.pedal.gains.kp * error[rows] + w[:, 1:-3] @ flow.pedal.weights
            control[rows] = np.clip(demand, *flow.pedal.limits)
    return Samples(output, rate, control, error, np.array([nodes[i].mode for i in last], dtype=int))

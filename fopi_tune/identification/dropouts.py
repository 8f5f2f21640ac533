"""Dropouts of a recording:  stretches of outputs that a sensor or a logger lost, longer than single outliers.

A dropout begins and ends with a jump between two samples, and lies wholly beyond what comes before and after.  A plant
answers a pulse of its input alike; so no two changes of the input may lie as far apart.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.text_tables.words import counted
from fopi_tune.identification.recording import Recording

#: outputs to each side that a dropout is compared with, and the fewest of a recording that is searched
_AROUND, _LEAST = 3, 30
#: outputs of the shortest dropout; a single one is an outlier
_SHORTEST = 2
#: share of the range of the other outputs by which all of a dropout lies beyond its surroundings
_BEYOND = 0.1
#: of the usual change from one sample to the next that the jumps exceed
_JUMP = 20.0
#: share of the outputs that a dropout, and all of them, may be
_MOST = 0.2
#: share of a jump that the output may move just outside of the dropout: a plant that jumps goes on moving
_CALM = 0.25
#: least distance of a dropout from its sides, as a share of the largest
_LEVEL = 0.25
#: jumps of the output that are looked at; a recording that has more has no dropouts but a plant that jumps
_MOST_JUMPS = 40
#: samples by which two changes of the input may lie otherwise than the jumps
_LOOSE = 2


def without_dropouts(recording: Recording) -> Recording:
    """The recording with its dropouts left out of the fit, each in a note; itself where it has none."""
    rows = np.flatnonzero(recording.used)
    found = list(_dropouts(recording.output[rows], rows, np.flatnonzero(np.diff(recording.input)) + 1))
    if not found or sum(end - begin for begin, end in found) > _MOST * len(rows):
        return recording
    used, notes = recording.used.copy(), list(recording.notes)
    for begin, end in found:
        used[rows[begin:end]] = False
        first, last = (recording.lines[rows[k]] for k in (begin, end - 1))
        values = recording.output[rows[begin:end]]
        notes.append(
            f"{'lines' if recording.from_file else 'samples'} {first} to {last}: a dropout of "
            f"{counted(end - begin, 'output')} "
            f"({values.min():g} ... {values.max():g}), which no change of the input explains, left out"
        )
    return dataclasses.replace(recording, used=used, notes=tuple(notes))


def _dropouts(output: Array, rows: NDArray[np.int64], changes: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """First output of each dropout, and the one after its last; `changes` are the rows at which the input changes."""
    steps = np.diff(output)
    if len(output) < _LEAST:
        return
    usual = float(np.median(np.abs(steps)))
    low, high = np.quantile(output, (_MOST, 1.0 - _MOST))
    # of the usual outputs at least this, so that a dropout does not set the scale itself
    jumps = np.flatnonzero(np.abs(steps) > max(_JUMP * usual, _BEYOND * float(high - low))) + 1
    if not 2 <= len(jumps) <= _MOST_JUMPS:
        return
    last = 0
    for k, begin in enumerate(jumps.tolist()):
        for end in jumps[k + 1 :].tolist():
            if begin < last or end - begin > _MOST * len(output):
                break
            if end - begin < _SHORTEST:
                continue
            if _is_lost(output, begin, end) and not _is_explained(int(rows[begin]), int(rows[end]), changes):
                yield begin, end
                last = end
                break


def _is_lost(output: Array, begin: int, end: int) -> bool:
    """Whether outputs lie wholly beyond both sides, and the sides are of one motion."""
    inside, before, after = output[begin:end], output[max(begin - _AROUND, 0) : begin], output[end : end + _AROUND]
    others = np.concatenate((output[:begin], output[end:]))
    beyond = _BEYOND * float(np.ptp(others))
    sides = np.concatenate((before, after))
    jumps = abs(inside[0] - before[-1]), abs(after[0] - inside[-1])
    moves = np.ptp(before[-2:]), np.ptp(after[:2])
    if any(move > _CALM * jump for move, jump in zip(moves, jumps, strict=True)):
        return False
    # a lost signal is a level: its least distance from the sides is not much less than its largest
    for sign in (1.0, -1.0):
        nearest = (sign * inside).min() - (sign * sides).max()
        furthest = (sign * inside).max() - (sign * sides).min()
        if nearest > max(beyond, _LEVEL * furthest):
            return True
    return False


def _is_explained(begin: int, end: int, changes: NDArray[np.int64]) -> bool:
    """Whether the input changes twice as far apart before, as a pulse does that the output follows."""
    before = changes[changes <= begin + 1]
    wanted = before[:, None] + (end - begin) + np.arange(-_LOOSE, _LOOSE + 1)
    return bool(np.isin(wanted, changes).any())

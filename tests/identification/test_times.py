"""Times of recordings: units by names and by size, clocks that pass midnight."""

from __future__ import annotations

import datetime

import numpy as np
import pytest

from fopi_tune.errors import DomainError
from fopi_tune.identification import Recording, TimeUnit, parse_recording
from fopi_tune.identification.times import in_seconds, over_midnight, unit_by_size, unit_called

EPOCH_S = 1_709_280_000


def recording(head: str, times: list[str]) -> Recording:
    """A step at the fifth line, of given times."""
    rows = [f"{time},{0 if k < 5 else 1},{max(0, k - 5)}" for k, time in enumerate(times)]
    return parse_recording("\n".join((head, *rows)), "a.csv")


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("t_ms", TimeUnit.MILLISECONDS),
        ("Time (sec)", TimeUnit.SECONDS),
        ("t_ns", TimeUnit.NANOSECONDS),
        ("Time [d]", TimeUnit.DAYS),
        ("elapsed, hrs.", TimeUnit.HOURS),
        ("min", TimeUnit.MINUTES),
        ("µs", TimeUnit.MICROSECONDS),
        ("Time (ticks)", None),
        ("timestamp", None),
    ],
)
def test_units_are_seen_from_the_end_of_a_name(name: str, unit: TimeUnit | None) -> None:
    assert unit_called(name) is unit


@pytest.mark.parametrize("unit", list(TimeUnit))
def test_a_name_with_a_unit_scales_the_times_and_is_said(unit: TimeUnit) -> None:
    found = recording(f"t_{unit.value},u,y", [f"{3 * k}" for k in range(20)])
    assert found.time_s.tolist() == pytest.approx([3 * k * unit.in_s for k in range(20)], rel=1e-15)
    said = "" if unit is TimeUnit.SECONDS else f"times are in {unit.value}, as 't_{unit.value}' says"
    assert "; ".join(found.notes) == said


@pytest.mark.parametrize(("digits", "unit"), [(3, "ms"), (6, "us"), (9, "ns")])
def test_times_since_1970_tell_their_unit_by_their_size(digits: int, unit: str) -> None:
    found = recording("timestamp,u,y", [f"{EPOCH_S + 2 * k}" + "0" * digits for k in range(20)])
    assert np.diff(found.time_s).tolist() == pytest.approx([2.0] * 19, rel=1e-6)
    assert found.notes == (f"times are in {unit} since 1970, by their size",)


def test_times_since_1970_in_seconds_and_small_numbers_are_seconds() -> None:
    found = recording("timestamp,u,y", [f"{EPOCH_S + 2 * k}" for k in range(20)])
    assert np.diff(found.time_s).tolist() == [2.0] * 19
    assert found.notes == ()
    assert [unit_by_size(first) for first in (None, 0.0, 1e5, float(EPOCH_S))] == [None] * 4


def test_a_unit_that_is_not_known_is_said() -> None:
    found = recording("Time (ticks),u,y", [f"{k}" for k in range(20)])
    assert found.time_s.tolist() == list(range(20))
    assert found.notes == ("the unit in 'Time (ticks)' is not known: s is taken, or give --time-unit",)
    # of a clock there is nothing to say
    clock = [f"08:00:{k:02d}" for k in range(20)]
    assert recording("Time (UTC),u,y", clock).notes == ()


def test_a_clock_that_passes_midnight_goes_on() -> None:
    start = datetime.datetime(2024, 3, 1, 23, 59, 50)
    found = recording("time,u,y", [f"{start + datetime.timedelta(seconds=k):%H:%M:%S}" for k in range(20)])
    assert np.diff(found.time_s).tolist() == [1.0] * 19
    assert found.notes == ("the clock passes midnight at line 12: a day is added",)


def test_a_clock_that_goes_back_otherwise_is_refused() -> None:
    times = [f"08:00:{k if k < 12 else k - 5:02d}" for k in range(20)]
    with pytest.raises(DomainError, match="line 14: time 28807 s is before 28811 s of line 13"):
        recording("time,u,y", times)
    # dates that fall by a day are no clock
    day = np.array([1.0e9, 1.0e9 - 90_000.0])
    assert over_midnight(day, np.array([1, 2]))[0] is day


def test_a_sample_of_milliseconds_is_rounded_once() -> None:
    assert in_seconds(np.array([3.0]), TimeUnit.MILLISECONDS).tolist() == [0.003]
    assert in_seconds(np.array([3.0]), TimeUnit.MINUTES).tolist() == [180.0]

"""Progress as lines of the log: one every two seconds, with the rate and what is left; the caller's own gets all."""

from __future__ import annotations

import logging

import pytest
from cases.project import ROOT

import fopi_tune as ft
from fopi_tune.montecarlo.progress import logged_progress


def test_a_line_is_logged_every_two_seconds_and_every_call_is_passed_on(caplog: pytest.LogCaptureFixture) -> None:
    now, calls = [10.0], list[tuple[int, int]]()
    told = logged_progress("plants", lambda done, of: calls.append((done, of)), clock=lambda: now[0])
    with caplog.at_level(logging.INFO, "fopi_tune"):
        for step in range(1, 9):
            now[0] = 10.0 + 0.5 * step
            told(100 * step, 1000)
    assert calls == [(100 * step, 1000) for step in range(1, 9)]
    # at 2 s 400 of 1000 are done, 200 a second
    assert caplog.messages == ["plants: 400 of 1000, 200/s, 3 s left", "plants: 800 of 1000, 200/s, 1 s left"]


def test_without_a_log_and_a_callback_nothing_happens() -> None:
    logged_progress("plants")(1, 2)


def test_a_validation_tells_its_own_callback_as_before() -> None:
    calls: list[tuple[int, int]] = []
    gains = ft.FoPi(0.44651, 0.37033, 0.83197)
    ft.validate(ROOT / "specs" / "brake.yaml", gains, samples=50, progress=lambda done, of: calls.append((done, of)))
    assert calls[-1] == (50, 50)

"""The words of a certificate."""

from __future__ import annotations

from dataclasses import replace

import pytest
from cases import switched

from fopi_tune.proof.switched import SystemVerdict


def test_settling_is_told_with_its_start_and_its_bounds() -> None:
    reset, tracking = switched.certificate("reset"), switched.certificate("tracking")
    assert reset.statements[2].startswith(
        "From every state the output settles on each setpoint from 2 to 22, after at most two"
    )
    assert "from 2 to 22" in reset.statements[2]
    # rounded upwards: 4.99300...
    assert "4.994 below" in reset.statements[2]
    assert tracking.statements[2].startswith("After a step down from rest")


@pytest.mark.parametrize(
    ("bound", "told"), [(4.99300001, "4.994 below"), (12.0, "12 below"), (5e-324, "1e-12 below"), (-1.0, "0 below")]
)
def test_bounds_are_rounded_upwards(bound: float, told: str) -> None:
    reset = switched.certificate("reset")
    assert reset.settling is not None
    said = replace(reset, settling=replace(reset.settling, undershoot=bound)).statements[2]
    assert f"stays between {told}" in said


def test_from_every_state_needs_the_throttle_with_its_limits() -> None:
    reset, tracking = switched.certificate("reset"), switched.certificate("tracking")
    without = replace(reset, loops=(None, reset.loops[1]))
    assert without.verdict is SystemVerdict.UNDECIDED
    assert without.statements[1].startswith("From every state with the brake active and the output above")
    assert replace(tracking, loops=(None, None)).verdict is SystemVerdict.SETTLES


def test_an_orbit_is_told_with_its_place() -> None:
    held = switched.certificate("held")
    (first, *_), cycle = held.statements[3:], held.cycles[0]
    assert first.startswith(
        f"At setpoint {cycle.setpoint:g}, brake.time_constant_s = {cycle.plants[1]['time_constant_s']:g}"
    )
    assert f"an attracting periodic orbit of {len(cycle.modes)} samples" in first
    assert replace(held, cycles=(replace(cycle, attraction=None),)).statements[3].count(": a periodic orbit") == 1
    assert held.statements[-1].startswith("Not proved: a held memory")


def test_ends_of_ranges_are_told_with_all_their_digits() -> None:
    reset = switched.certificate("reset")
    assert reset.settling is not None
    said = replace(reset, settling=replace(reset.settling, setpoints=(2.00000001, 22.0))).statements[2]
    assert "from 2.00000001 to 22, after" in said

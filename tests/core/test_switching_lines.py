"""Lines on which two modes take turns: what a hysteresis is, and which orders are refused."""

from __future__ import annotations

import pytest

from fopi_tune.core.switching_lines import SwitchingLines, Threshold
from fopi_tune.errors import DomainError


def test_a_hysteresis_is_the_setpoint_more_and_less_its_half_width() -> None:
    lines = SwitchingLines.of(0.3)
    assert (lines.up.level(2.0), lines.down.level(2.0)) == (2.0 + 0.3, 2.0 - 0.3)
    assert lines.half_width == 0.3
    assert not lines.coasts


def test_other_lines_have_no_half_width() -> None:
    for lines in (
        SwitchingLines(Threshold(0.3), Threshold(-0.2)),
        SwitchingLines(Threshold(0.3, True), Threshold(-0.3, True)),
        SwitchingLines(Threshold(0.3), Threshold(-0.3), Threshold(0.0), Threshold(0.0)),
    ):
        assert lines.half_width is None
        assert SwitchingLines.of(lines) is lines


def test_an_absolute_line_stays_where_it_is() -> None:
    assert Threshold(7.0, is_absolute=True).level(2.0) == 7.0
    assert Threshold(7.0).level(2.0) == 9.0


@pytest.mark.parametrize("kind", [True, False])
def test_lines_of_one_kind_in_another_order_are_refused(kind: bool) -> None:
    def line(value: float) -> Threshold:
        return Threshold(value, kind)

    with pytest.raises(DomainError, match="must lie below"):
        SwitchingLines(line(0.0), line(0.1))
    SwitchingLines(line(0.1), line(0.1))
    for wrong in ((0.5, -0.5, -0.5, 0.0), (0.5, -0.5, 0.6, 0.0), (0.5, -0.5, 0.0, 0.5), (0.5, -0.5, 0.0, -0.6)):
        with pytest.raises(DomainError, match="must lie below"):
            SwitchingLines(*map(line, wrong))
    SwitchingLines(*map(line, (0.5, -0.5, 0.5, -0.5)))


def test_lines_of_two_kinds_may_have_any_numbers() -> None:
    assert SwitchingLines(Threshold(1.0), Threshold(9.0, True)).misplaced_at(2.0) == ("down", "up")
    assert SwitchingLines(Threshold(1.0), Threshold(9.0, True)).misplaced_at(8.0) is None


@pytest.mark.parametrize("wrong", [float("nan"), float("inf")])
def test_what_is_no_number_is_refused(wrong: float) -> None:
    with pytest.raises(DomainError, match="finite"):
        Threshold(wrong)


def test_one_of_two_lines_for_coasting_is_refused() -> None:
    with pytest.raises(DomainError, match="needs both"):
        SwitchingLines(Threshold(1.0), Threshold(-1.0), Threshold(0.0))

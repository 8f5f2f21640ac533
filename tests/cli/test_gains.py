"""Gains on the command line:  what the spec fixes need not be given again."""

from __future__ import annotations

import pytest
import typer

from fopi_tune.cli.gains import GivenGains, number_option
from fopi_tune.core.controller import FoPi
from fopi_tune.errors import DomainError
from fopi_tune.spec import parse_spec

SPEC = parse_spec("""\
schema: 1
name: small
plant: {model: lag, static_gain: 1, time_constant_s: 1}
controller: {kp: 1, ki: {min: 0, max: 0.02}, alpha: 1}
requirements: [{phase_margin_deg: {at_least: 60}}]
""")


def test_gains_that_the_spec_fixes_are_taken_from_it() -> None:
    assert GivenGains(None, 0.01, None).for_spec(SPEC) == FoPi(1.0, 0.01, 1.0)
    assert GivenGains(2.0, 0.5, 0.9).for_spec(SPEC) == FoPi(2.0, 0.5, 0.9)
    assert GivenGains(None, 0.0, None).for_spec(SPEC) == FoPi(1.0, 0.0, 1.0)
    assert GivenGains(None, None, None).for_spec(SPEC) is None


def test_a_gain_that_is_left_out_and_has_a_range_is_named() -> None:
    with pytest.raises(
        DomainError, match="all three, or none of them: --ki is left out, and the spec gives ki a range"
    ):
        GivenGains(1.0, None, None).for_spec(SPEC)


@pytest.mark.parametrize(
    ("text", "said"),
    [("1e308", "too large"), ("-1e308", "too large"), ("5e-324", "too small"), ("1.1e100", "too large")],
)
def test_a_gain_that_cannot_be_computed_with_is_refused(text: str, said: str) -> None:
    option = number_option(help="A gain.")
    with pytest.raises(typer.BadParameter, match=said):
        option.parser(text)
    assert option.parser(" -1.5e2 ") == -150.0

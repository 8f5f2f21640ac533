"""The controller on a computer in the spec language: the limit of the output's rate."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fopi_tune.errors import SpecError
from fopi_tune.spec import parse_spec
from fopi_tune.spec.digests import content_digest, digests_of
from fopi_tune.spec.model import DesignSpec

HEAD = """
schema: 1
name: rate
plant: {model: lag, static_gain: 1, time_constant_s: 2}
controller: {kp: 2, ki: 2, alpha: 1}
"""
MARGIN = "requirements: [{phase_margin_deg: {at_least: 30}}]\n"
SCENARIO = """scenarios: [{name: step, duration_s: 9, reference: [{at_s: 0, value: 1}]}]
requirements: [{overshoot: {at_most: 0.1}, scenario: step}]
"""


def spec_of(digital: str, rest: str = MARGIN) -> DesignSpec:
    return parse_spec(f"{HEAD}{rest}digital: {{sample_time_s: 0.05{digital}}}\n")


def test_a_rate_is_read_and_is_none_where_it_is_left_out() -> None:
    with_rate, without = spec_of(", output_rate_per_s: 0.5").digital, spec_of("").digital
    assert with_rate is not None
    assert without is not None
    assert (with_rate.output_rate_per_s, without.output_rate_per_s) == (0.5, None)


@pytest.mark.parametrize("value", ["0", "-1", ".inf", ".nan", "fast", "null"])
def test_a_rate_that_is_none_is_refused_at_its_place(value: str) -> None:
    with pytest.raises(SpecError, match=r"7:\d+: digital\.output_rate_per_s: "):
        spec_of(f", output_rate_per_s: {value}")


def test_a_spec_without_the_word_keeps_its_digests() -> None:
    """Those of before the word was known."""
    found = digests_of(spec_of(", output_limits: [-1, 1], design: sampled"))
    assert found["digital"] == "67670a633ec55edb228773046a06c2c6719502292114b07790686dfede07d080"
    assert found["loop"] == "e009bb4ebc1a76eee63a0229f7e44a1cd6393d7f3ce50009c7a6ec3ca3997c92"


def test_the_rate_is_beside_the_loop_of_margins_and_in_that_of_scenarios() -> None:
    for rest, parts in ((MARGIN, {"digital"}), (SCENARIO, {"digital", "loop"})):
        free, slow = (spec_of(f", design: sampled{own}", rest) for own in ("", ", output_rate_per_s: 0.5"))
        one, two = digests_of(free), digests_of(slow)
        assert {name for name in one if one[name] != two[name]} == parts
        assert content_digest(free) != content_digest(slow)
        slower = replace(slow, digital=replace(slow.digital, output_rate_per_s=0.4))  # pyright: ignore
        assert content_digest(slower) != content_digest(slow)

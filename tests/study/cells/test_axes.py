"""Values of an axis: lists, and ranges in steps."""

from __future__ import annotations

from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fopi_tune.spec.yaml.composer import compose
from fopi_tune.spec.yaml.nodes import MappingNode, Place, ScalarNode
from fopi_tune.spec.yaml.problems import ProblemCollector
from fopi_tune.study.cells.axes import AxisValues, PathMapping
from fopi_tune.study.overrides import plain_value

SHAPE = AxisValues("values")


def read(text: str) -> tuple[list[Any] | None, list[str]]:
    collector = ProblemCollector("s.yaml")
    axes = PathMapping("axes", SHAPE).read(Place(compose(f"a.b: {text}\n", collector), "grid", collector))
    values = None if axes is None else [plain_value(node) for node in axes[0].nodes]
    return values, [str(problem) for problem in collector.problems]


NUMBERS = st.floats(-1e6, 1e6).filter(lambda x: x == 0.0 or abs(x) > 1e-6)


@given(NUMBERS, NUMBERS, st.integers(1, 50))
def test_a_linear_range_has_the_values_of_numpy_and_both_ends_exactly(low: float, high: float, steps: int) -> None:
    values, problems = read(f"{{from: {low!r}, to: {high!r}, steps: {steps}}}")
    if low == high:
        assert "write [" in problems[0]
        return
    assert values is not None
    assert values[0] == low
    assert steps == 1 or values[-1] == high
    assert values == np.linspace(low, high, steps).tolist()


@given(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6), st.integers(2, 50), st.sampled_from([1.0, -1.0]))
def test_a_logarithmic_range_has_equal_ratios_and_both_ends_exactly(
    low: float, high: float, steps: int, sign: float
) -> None:
    if low == high:
        return
    values, _ = read(f"{{from: {sign * low!r}, to: {sign * high!r}, steps: {steps}, scale: log}}")
    assert values is not None
    assert (values[0], values[-1], len(values)) == (sign * low, sign * high, steps)
    # relative to rounding of logarithms up to 14
    ratios = np.diff(np.log(np.abs(values)))
    np.testing.assert_allclose(ratios, np.log(high / low) / (steps - 1), rtol=1e-9, atol=1e-13)


def test_whole_numbers_between_whole_ends_stay_whole() -> None:
    values, _ = read("{from: 9, to: 3, steps: 4}")
    assert repr(values) == "[9, 7, 5, 3]"
    assert repr(read("{from: 1, to: 100, steps: 3, scale: log}")[0]) == "[1, 10, 100]"
    # geomspace has 7.999999999999999 for 8
    for low, high, ratio, steps in ((1, 256, 2, 9), (-3, -48, 2, 5), (256, 1, 0.5, 9), (7, 7 * 3**20, 3, 21)):
        values, _ = read(f"{{from: {low}, to: {high}, steps: {steps}, scale: log}}")
        assert repr(values) == repr([int(low * ratio**i) for i in range(steps)])
    assert repr(read("{from: 1, to: 63, steps: 3, scale: log}")[0]).startswith("[1.0, 7.93")
    # whole, but written as decimals, or not all whole
    assert repr(read("{from: 3.0, to: 9, steps: 3}")[0]) == "[3.0, 6.0, 9.0]"
    assert repr(read("{from: 0, to: 1, steps: 3}")[0]) == "[0.0, 0.5, 1.0]"


def test_one_step_is_the_first_end_alone() -> None:
    assert read("{from: 3, to: 9, steps: 1}")[0] == [3]


def test_a_mapping_with_other_keys_stays_a_value() -> None:
    assert read("[{min: 1, max: 2}]")[0] == [{"min": 1, "max": 2}]
    # a range inside a list is a value: the spec language judges it
    assert read("[{from: 1, to: 2, steps: 3}]")[0] == [{"from": 1, "to": 2, "steps": 3}]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{min: 1, max: 2}", "s.yaml:1:6: grid.a.b: a mapping is written where a list of values belongs; write "
         "[{...}], or a range {from: 1, to: 10, steps: 4}"),
        ("{from: 1, to: 2}", "s.yaml:1:6: grid.a.b.steps: the key is missing; add it"),
        ("{from: 1, to: 2, step: 3}", "s.yaml:1:23: grid.a.b.step: the key is not known here; did you mean 'steps'?"),
        ("{from: 1, to: 2, steps: 0}", "s.yaml:1:30: grid.a.b.steps: 0 is out of range; it must be at least 1"),
        ("{from: 1, to: 2, steps: 2.5}", "s.yaml:1:30: grid.a.b.steps: 2.5 is not a whole number"),
        ("{from: a, to: 2, steps: 2}", "s.yaml:1:13: grid.a.b.from: 'a' is not a number"),
        ("{from: 1, to: 2, steps: 2, scale: lin}", "s.yaml:1:40: grid.a.b.scale: 'lin' is not known here; "),
        ("{from: -1, to: 2, steps: 2, scale: log}", "s.yaml:1:41: grid.a.b.scale: a log scale has no way through 0; "
         "write from and to with the same sign"),
        ("{from: 0, to: 2, steps: 2, scale: log}", "a log scale has no way through 0"),
        ("{from: 2, to: 2, steps: 2}", "s.yaml:1:20: grid.a.b.to: from and to are both 2; write [2], or ends"),
    ],
)  # fmt: skip
def test_a_range_that_cannot_be_made_is_refused_with_its_place(text: str, problem: str) -> None:
    values, problems = read(text)
    assert values is None
    assert any(each.startswith(problem) or problem in each for each in problems), problems


def test_the_schema_takes_what_is_read_and_no_range_without_steps() -> None:
    validator = jsonschema.Draft202012Validator(SHAPE.json_schema())
    assert validator.is_valid({"from": 1, "to": 2, "steps": 3, "scale": "log"})
    assert validator.is_valid([1, {"min": 1}])
    assert not validator.is_valid({"from": 1, "to": 2})
    assert not validator.is_valid({"min": 1, "max": 2})


def test_values_of_a_range_have_the_place_of_the_range() -> None:
    collector = ProblemCollector("s.yaml")
    place = Place(compose("a.b: {from: 1, to: 2, steps: 3}\n", collector), "grid", collector)
    assert isinstance(place.node, MappingNode)
    nodes = SHAPE.read(place.child("a.b"))
    assert nodes is not None
    assert {(node.mark.line, node.mark.column) for node in nodes if isinstance(node, ScalarNode)} == {(1, 6)}

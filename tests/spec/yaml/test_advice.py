"""What people write instead of the language's words is answered with what to write."""

from __future__ import annotations

import pytest

from fopi_tune.errors import SpecError
from fopi_tune.spec import parse_spec

HEAD = "schema: 1\nname: a\n"
PLANT = "plant: {model: lag, static_gain: 1, time_constant_s: 2}\n"
REQUIREMENTS = "requirements: [{phase_margin_deg: {at_least: 60}}]\n"


def messages(text: str) -> list[str]:
    with pytest.raises(SpecError) as caught:
        parse_spec(text, "s.yaml")
    return [problem.message for problem in caught.value.problems]


@pytest.mark.parametrize(
    ("written", "advised"),
    [
        ("[0, 10]", "{min: 0, max: 10}"),
        ("[10, 0]", "{min: 0, max: 10}"),
        ("[-2.5, 1e3]", "{min: -2.5, max: 1e3}"),
        ("0..10", "{min: 0, max: 10}"),
        ("'0 .. 10'", "{min: 0, max: 10}"),
        ("0 to 10", "{min: 0, max: 10}"),
        ("0-10", "{min: 0, max: 10}"),
        ("0 ± 2", "{min: -2, max: 2}"),
        ("4 +- 25%", "{min: 3, max: 5}"),
        ("{0, 10}", "{min: 0, max: 10}"),
        ("{between: [0, 10]}", "{min: 0, max: 10}"),
        ("{range: [0, 10]}", "{min: 0, max: 10}"),
        ("[1, 2, 3]", "a number"),
        ("[]", "a number"),
    ],
)
def test_a_range_of_a_gain_is_written_as_min_and_max(written: str, advised: str) -> None:
    (message,) = messages(f"{HEAD}{PLANT}{REQUIREMENTS}controller: {{kp: {written}}}\n")
    assert message.endswith(f"; write {advised}")


def test_a_plants_range_in_a_list_may_have_its_nominal_value() -> None:
    plant = "plant: {model: lag, static_gain: [0.5, 2], time_constant_s: [1, 2, 3], dead_time_s: 0.1..0.3}\n"
    advised = [message.rpartition("write ")[2] for message in messages(HEAD + plant + REQUIREMENTS)]
    assert advised == ["{min: 0.5, max: 2}", "{nominal: 2, min: 1, max: 3}", "{min: 0.1, max: 0.3}"]


@pytest.mark.parametrize(
    ("key", "meant"),
    [("low", "min"), ("from", "min"), ("minimum", "min"), ("at_least", "min"), ("high", "max"), ("upper", "max")],
)
def test_other_words_for_the_ends_of_a_range(key: str, meant: str) -> None:
    (message,) = messages(f"{HEAD}{PLANT}{REQUIREMENTS}controller: {{kp: {{{key}: 1}}}}\n")
    assert message == f"the key is not known here; write {meant}"


def test_a_gain_with_its_limit_in_the_key() -> None:
    (message,) = messages(f"{HEAD}{PLANT}{REQUIREMENTS}controller: {{kp_min: 1}}\n")
    assert message == "the key is not known here; write kp: {min: ...}"


@pytest.mark.parametrize("key", ["td", "Tf", "kd", "derivative_filter_time_constant_s", "N"])
def test_a_derivative_by_another_word_names_the_structure_or_the_word_for_it(key: str) -> None:
    (message,) = messages(f"{HEAD}{PLANT}{REQUIREMENTS}controller: {{{key}: 0.1}}\n")
    assert "structure: pid" in message or "write derivative_filter_time_constant_s" in message


def test_a_pi_is_written_in_small_letters_and_an_integral_alone_is_a_special_case() -> None:
    (message,) = messages(f"{HEAD}{PLANT}{REQUIREMENTS}controller: {{structure: PI}}\n")
    assert message == "'PI' is not known here; did you mean 'pi'?"
    (message,) = messages(f"{HEAD}{PLANT}{REQUIREMENTS}controller: {{structure: I}}\n")
    assert "kp: 0" in message


@pytest.mark.parametrize(
    ("written", "advised"),
    [
        ("'>= 60'", "{at_least: 60}"),
        ("<60", "{at_most: 60}"),
        ("[60, 70]", "{between: [60, 70]}"),
        ("{min: 60}", "at_least"),
        ("{le: 60}", "at_most"),
        ("{eq: 60}", "equals"),
    ],
)
def test_a_relation_is_advised_with_the_numbers_that_are_there(written: str, advised: str) -> None:
    (message,) = messages(f"{HEAD}{PLANT}requirements:\n- phase_margin_deg: {written}\n")
    assert message.endswith(f"; write {advised}")


@pytest.mark.parametrize("written", ["ki", "maximize ki", "maximise ki"])
def test_an_objective_in_words_is_advised_as_a_mapping(written: str) -> None:
    (message,) = messages(f"{HEAD}{PLANT}objective: {written}\n")
    assert message.endswith("; write {maximize: ki}")


def test_an_ending_that_is_no_unit_is_not_converted() -> None:
    digital = "digital: {sample_time_s: 0.1}\n"
    scenario = "scenarios: [{name: a, duration_s: 10, output_min: 0, reference: [{at_s: 0, value: 1}]}]\n"
    (message,) = messages(HEAD + PLANT + REQUIREMENTS + digital + scenario)
    assert message.startswith("the key is not known here; remove it or write ")


def test_a_list_that_is_a_mapping_or_a_number() -> None:
    (message,) = messages(f"{HEAD}{PLANT}requirements: {{phase_margin_deg: {{at_least: 60}}}}\n")
    assert message.endswith("a list of at most 500 entries, each after '- '")
    (message,) = messages(
        f"{HEAD}plant: {{model: transfer_function, numerator: 2, denominator: [1, 1]}}\n{REQUIREMENTS}"
    )
    assert message.endswith("a list of 1 to 32 entries, such as [2]")

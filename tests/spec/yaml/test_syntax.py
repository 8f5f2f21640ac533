"""What is not YAML: the message points at the line of the mistake, not where the parser gave up."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from cases.project import CONTINUOUS

from fopi_tune.errors import SpecError
from fopi_tune.spec import parse_spec

HEAD = "schema: 1\nname: x\n"
#: mistake: (text, its line, its column, words of the message)
MISTAKES = {
    "bracket that stays open": (
        HEAD + "plant:\n  model: lag\n  time_constant_s: {min: 1, max: 2\n  dead_time_s: 0\n",
        (5, 20, "given up on line 6): a bracket that opens here"),
    ),
    "bracket that stays open in the last line": (HEAD + "validation: {samples: 10\n\n# end\n", (3, 13, "bracket")),
    "comma missing in a list over lines": (
        HEAD + "plant:\n  numerator: [\n    1.0,\n    2.0\n    {min: 1, max: 2}\n  ]\n",
        (6, 7, "or a comma is missing"),
    ),
    "quote that stays open": (
        HEAD + 'description: "my brake\nplant:\n  model: lag\n',
        (3, 14, "quote that opens here"),
    ),
    "quote that closes at a later one": (
        HEAD + 'description: "my brake\nplant:\n  model: lag\ndigital: {output_unit: "V"}\n',
        (3, 14, "quote that opens here"),
    ),
    "apostrophe in quotes": (HEAD + "description: 'it's mine'\nplant:\n  model: lag\n", (3, 18, "")),
    "no colon": ("schema: 1\nname x\nplant:\n  model: lag\n", (2, 1, "a colon, and a space after it, is missing")),
    "no colon above a block": (HEAD + "plant\n  model: lag\n  static_gain: 1\n", (3, 1, "a colon")),
    "no space after the colon": (HEAD + "plant:\n  static_gain:1\n  dead_time_s: 2\n", (4, 3, "a colon")),
    "no space after two colons": (HEAD + "plant:\n  model:lag\n  gain:1\n  dead_time_s: 2\n", (4, 3, "a colon")),
    "tab": (HEAD + "plant:\n  model: lag\n\tstatic_gain: 1\n", (5, 1, "indent with spaces, not with tabs")),
    "colon in text": (HEAD + "description: brake: robust\n", (3, 19, "text with a colon in it in quotes")),
    "braces left out": (HEAD + "requirements:\n  - phase_margin_deg: at_least: 60\n", (4, 31, "a mapping in braces")),
    "one line too deep": (HEAD + "plant:\n  model: lag\n   static_gain: 1\n  dead_time_s: 1\n", (5, 4, "deeper")),
    "first line too deep": (
        HEAD + "plant:\n    model: lag\n  static_gain: 1\n  dead_time_s: 1\n",
        (4, 5, "given up on line 5): this line's indentation differs"),
    ),
    "first line not deep enough": (
        HEAD + "plant:\n model: lag\n  static_gain: 1\n  dead_time_s: 1\n",
        (4, 2, "given up on line 5): this line's indentation differs"),
    ),
    "one line not deep enough": (
        HEAD + "plant:\n  model: lag\n  static_gain: 1\n dead_time_s: 1\ncontroller:\n  kp: 1\n",
        (6, 2, "this line's indentation"),
    ),
    "dash forgotten": (
        HEAD + "requirements:\n  - phase_margin_deg: {at_least: 60}\n  - gain_margin_db: {at_least: 6}\n"
        "  sensitivity_db: {at_most: 6}\n",
        (6, 3, "how it begins, differs from that of the lines above"),
    ),
    "text in many lines is no mistake": (
        HEAD + 'description: "a brake\n  of a car"\nplant\n  model: lag\n',
        (5, 1, "a colon"),
    ),
    "bracket too much": (HEAD + "plant:\n  model: lag\n  static_gain: 1]\n  dead_time_s: }\n", (6, 16, "")),
    "nothing but a bracket": ("{\n", (1, 1, "")),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_the_message_points_at_the_mistake(name: str) -> None:
    text, (line, column, words) = MISTAKES[name]
    with pytest.raises(SpecError) as caught:
        parse_spec(text, "s.yaml")
    (problem,) = [p for p in caught.value.problems if "not valid YAML" in p.message]
    assert (problem.line, problem.column) == (line, column), str(problem)
    assert words in problem.message


INSERTED = ('"', "'", "{", "]", ":", "\t", "  ", "- ", "!")


def mutations(text: str) -> Iterator[tuple[int, str]]:
    """The text with one character less or a few more in one line, and the line's number."""
    lines = text.split("\n")
    for number, line in enumerate(lines):
        for column in range(len(line) + 1):
            inserted = [line[:column] + more + line[column:] for more in INSERTED]
            deleted = [line[:column] + line[column + 1 :]] if line[column : column + 1] in "\"'{}[]:,- " else []
            for new in inserted + deleted:
                yield number + 1, "\n".join([*lines[:number], new, *lines[number + 1 :]])


@pytest.mark.parametrize("step", [41, pytest.param(13, marks=pytest.mark.long)])
def test_of_small_changes_that_break_a_file_nearly_all_are_found_in_their_line(step: int) -> None:
    broken = wrong = 0
    for line, text in list(mutations((CONTINUOUS / "brake.yaml").read_text(encoding="utf-8")))[::step]:
        try:
            parse_spec(text, "s.yaml")
        except SpecError as error:
            found = [problem.line for problem in error.problems if "not valid YAML" in problem.message]
            broken, wrong = broken + len(found), wrong + sum(one != line for one in found)
    assert broken > 150 * 13 / step
    # where a parser gives up, more than a fifth is in another line; some changes have two readings
    assert wrong < 0.05 * broken

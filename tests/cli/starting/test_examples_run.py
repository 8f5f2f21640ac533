"""What ships ends with 0, as each is meant to be run, or its first comment says with what and why."""

from __future__ import annotations

import re

import pytest
from cases.commands import fopi
from cases.project import ROOT

from fopi_tune.cli.starting.examples import examples

pytestmark = pytest.mark.usefixtures("plain_figures", "folder")

#: of a kind of example, the commands it is meant for
COMMANDS = {"run": ("run", "simulate"), "simulate": ("simulate", "validate"), "study": ("study",)}
_MORE = {"study": ("--workers", "0", "--force"), "validate": ("--samples", "500")}


def stated(path: str) -> dict[str, int]:
    """Exit codes that a file's first comment states, by command."""
    first = (ROOT / path).read_text(encoding="utf-8").splitlines()[0]
    found: dict[str, int] = {}
    for words, code in re.findall(r"((?:`fopi \w+`(?:, | and )?)+) (?:ends|end)? ?with (\d)", first):
        found |= dict.fromkeys(re.findall(r"`fopi (\w+)`", words), int(code))
    return found


def test_the_first_comments_are_understood() -> None:
    found = {name: stated(example.path) for name, example in examples().items()}
    assert {name: codes for name, codes in found.items() if codes} == {
        "car": {"simulate": 1, "validate": 1},
        "car_held": {"simulate": 1, "validate": 1, "prove": 1},
        "switching": {"simulate": 1, "validate": 1, "prove": 3},
        "manoeuvre_gain_1": {"simulate": 1},
        "manoeuvre_gain_10": {"simulate": 1},
        "filters": {"study": 3},
        "duct_heater": {"run": 1},
    }


@pytest.mark.long
@pytest.mark.parametrize("name", list(examples()))
def test_an_example_ends_with_0_or_as_it_says(name: str) -> None:
    example = examples()[name]
    assert fopi("init", "--example", name).exit_code == 0
    codes = stated(example.path)
    kind = example.command.split()[1]
    for command in dict.fromkeys([*COMMANDS[kind], *codes]):
        result = fopi(command, example.path, "-q", *_MORE.get(command, ()))
        assert result.exit_code == codes.get(command, 0), f"fopi {command} {example.path}: {result.output[-800:]}"

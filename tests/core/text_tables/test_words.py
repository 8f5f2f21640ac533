"""Counted things in words."""

import pytest

from fopi_tune.core.text_tables.words import counted


@pytest.mark.parametrize(
    ("number", "words", "told"),
    [
        (0, ("cell",), "0 cells"),
        (1, ("cell",), "1 cell"),
        (2, ("cell",), "2 cells"),
        (1, ("entry", "entries"), "1 entry"),
        (3, ("entry", "entries"), "3 entries"),
    ],
)
def test_a_number_and_its_word_agree(number: int, words: tuple[str, ...], told: str) -> None:
    assert counted(number, *words) == told

"""A property that is computed once:  on first use, for each instance, and by the subclass that has its own."""

from __future__ import annotations

from fopi_tune.proof.balls.computed_once import computed_once


class Counted:
    def __init__(self) -> None:
        self.calls = 0

    @computed_once
    def value(self) -> int:
        """The number of calls."""
        self.calls += 1
        return self.calls


class More(Counted):
    @computed_once
    def value(self) -> int:
        return super().value + 10


def test_the_method_is_called_on_first_use_and_once() -> None:
    first, second = Counted(), Counted()
    assert first.calls == 0
    assert [first.value, first.value, first.calls] == [1, 1, 1]
    assert second.calls == 0


def test_a_subclass_builds_on_the_value_of_its_base() -> None:
    found = More()
    assert [found.value, found.value, found.calls] == [11, 11, 1]


def test_the_class_shows_the_property_and_its_docstring() -> None:
    assert isinstance(Counted.value, computed_once)
    assert Counted.value.__doc__ == "The number of calls."

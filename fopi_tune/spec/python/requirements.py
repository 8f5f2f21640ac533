"""Requirements as expressions:  `ft.phase_margin_deg >= 80` is `{phase_margin_deg: {at_least: 80}}`.

A word takes a band or a scenario in parentheses, `ft.sensitivity_db(to_rad_s=0.02) <= -20`; a requirement is moved to
the nominal plant by `.on_nominal()`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fopi_tune.errors import DomainError

#: a limit: a number, or points [rad/s, limit] of a line by the frequency
Limit = float | Sequence[Sequence[float]]


@dataclass(frozen=True)
class RequirementExpression:
    """A requirement, or a limit on a measure of scenarios.

    Args:
        word: of the spec language, unit included.
        relation: at_least, at_most, equals or between.
        limit: in the word's unit; of between two numbers.
        options: keys beside it, such as `to_rad_s`.
    """

    word: str
    relation: str
    limit: Any
    options: tuple[tuple[str, Any], ...] = ()

    def on_nominal(self) -> RequirementExpression:
        """The same for the nominal plant alone."""
        return replace(self, options=(*self.options, ("on", "nominal")))

    def as_mapping(self) -> Mapping[str, Any]:
        """The entry of a spec."""
        limit = self.limit
        if self.relation != "between" and isinstance(limit, Sequence):
            limit = {"by_frequency": limit}
        return {self.word: {self.relation: limit}, **dict(self.options)}

    def __bool__(self) -> bool:
        """Refused: `0.2 <= word <= 0.3` would lose its first half.

        Raises:
            DomainError: always.
        """
        raise DomainError(
            f"{self.word} {self.relation} is a requirement, neither true nor false; write two limits as "
            f"{self.word}.between(low, high)"
        )


class RequirementWord:
    """A word of the spec language that a requirement limits.

    Args:
        name: the word, unit included.
        options: keys that go beside the limit.
    """

    def __init__(self, name: str, options: Mapping[str, Any] | None = None) -> None:
        self.name, self.options = name, dict(options or {})

    def __repr__(self) -> str:
        told = ", ".join(f"{key}={value!r}" for key, value in self.options.items())
        return self.name + (f"({told})" if told else "")

    __hash__ = object.__hash__

    def __call__(self, **options: Any) -> RequirementWord:
        """The word with a band (`from_rad_s`, `to_rad_s`, `at_rad_s`, in rad/s) or a `scenario` beside it."""
        return RequirementWord(self.name, {**self.options, **options})

    def __ge__(self, limit: Limit) -> RequirementExpression:
        return self._asked("at_least", limit)

    def __le__(self, limit: Limit) -> RequirementExpression:
        return self._asked("at_most", limit)

    def __eq__(self, limit: object) -> RequirementExpression:  # pyright: ignore[reportIncompatibleMethodOverride]
        return self._asked("equals", limit)

    def __gt__(self, limit: object) -> RequirementExpression:
        raise DomainError(f"a limit may be reached: write {self.name} >= {limit!r}")

    def __lt__(self, limit: object) -> RequirementExpression:
        raise DomainError(f"a limit may be reached: write {self.name} <= {limit!r}")

    def between(self, low: float, high: float) -> RequirementExpression:
        """At least `low` and at most `high`, in the word's unit."""
        return self._asked("between", [low, high])

    def _asked(self, relation: str, limit: Any) -> RequirementExpression:
        return RequirementExpression(self.name, relation, limit, tuple(self.options.items()))


crossover_rad_s = RequirementWord("crossover_rad_s")
phase_margin_deg = RequirementWord("phase_margin_deg")
gain_margin_db = RequirementWord("gain_margin_db")
delay_margin_s = RequirementWord("delay_margin_s")
phase_slope_deg_per_decade = RequirementWord("phase_slope_deg_per_decade")
sensitivity_db = RequirementWord("sensitivity_db")
complementary_sensitivity_db = RequirementWord("complementary_sensitivity_db")
control_sensitivity_db = RequirementWord("control_sensitivity_db")
load_sensitivity_db = RequirementWord("load_sensitivity_db")
loop_gain_db = RequirementWord("loop_gain_db")
acceleration_m_s2 = RequirementWord("acceleration_m_s2")
peak_rate_per_s = RequirementWord("peak_rate_per_s")
peak_jerk_per_s2 = RequirementWord("peak_jerk_per_s2")
overshoot = RequirementWord("overshoot")
undershoot = RequirementWord("undershoot")
settling_time_s = RequirementWord("settling_time_s")
rise_time_s = RequirementWord("rise_time_s")
iae = RequirementWord("iae")
ise = RequirementWord("ise")
saturation_time_s = RequirementWord("saturation_time_s")
peak_control = RequirementWord("peak_control")
final_error = RequirementWord("final_error")
switch_count = RequirementWord("switch_count")

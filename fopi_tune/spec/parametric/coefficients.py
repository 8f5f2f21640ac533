"""A plant's coefficients as they are written:  place -> `Written`, which becomes a rational function of parameters.

What is wrong is reported at its own line and column, and nothing is left out because of it: all mistakes of a plant are
found in one run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fopi_tune.core.parametric.polynomials import MOST_DEGREE, ParameterPolynomial
from fopi_tune.core.parametric.ranges import Point, UndecidedError, box_of, zero_inside
from fopi_tune.core.plant import Uncertain
from fopi_tune.errors import DomainError
from fopi_tune.spec.parametric.descent import ExpressionError
from fopi_tune.spec.parametric.expressions import (
    Expression,
    Name,
    Negative,
    Number,
    Operation,
    parse_expression,
)
from fopi_tune.spec.parametric.rational import Rational
from fopi_tune.spec.yaml.hints import closest
from fopi_tune.spec.yaml.nodes import Place, ScalarNode
from fopi_tune.spec.yaml.problems import Mark, quoted


@dataclass(frozen=True)
class Written:
    """A coefficient.

    Args:
        place: where it is written.
        tree: the expression; None of a range, and of what could not be read.
        number: the range.
    """

    place: Place
    tree: Expression | None = None
    number: Uncertain | None = None

    @classmethod
    def expression(cls, place: Place) -> Written:
        """The expression at a place; reports where it is none."""
        node = place.node
        assert isinstance(node, ScalarNode)
        try:
            return cls(place, parse_expression(node.text))
        except ExpressionError as wrong:
            refuse_at(place, wrong.at, str(wrong))
            return cls(place)

    def text(self, part: Expression) -> str:
        """A part of it as it is written."""
        assert isinstance(self.place.node, ScalarNode)
        return quoted(self.place.node.text[part.at : part.end])


def refuse_at(place: Place, offset: int, message: str) -> None:
    """Report a problem of one character of a scalar."""
    mark = place.mark
    if isinstance(place.node, ScalarNode) and place.node.is_verbatim:
        mark = Mark(mark.line, mark.column + offset + (0 if place.node.plain else 1))
    place.collector.add(mark, place.path, message)


class _RefusedError(Exception):
    """What is wrong was reported."""


@dataclass
class Resolver:
    """Makes rational functions of expressions.

    Args:
        parameters: every one by name, those first that have a name of their own.
        divisors: what is known of divisors: where one is 0, None where it never is.
    """

    parameters: Mapping[str, Uncertain]
    divisors: dict[ParameterPolynomial, str | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.axes = [name for name, number in self.parameters.items() if not number.is_exact]
        low, high = ([getattr(self.parameters[name], end) for name in self.axes] for end in ("min", "max"))
        self.box = box_of(low, high)

    def rational(self, written: Written) -> Rational | None:
        """The function that a coefficient is, or None after reporting."""
        if written.tree is None:
            return None
        for part in _names(written.tree):
            self._check_name(written, part)
        try:
            return self._of(written, written.tree)
        except _RefusedError:
            return None

    def parameter(self, name: str) -> Rational:
        """A parameter, or the number that it is exactly."""
        number = self.parameters[name]
        if number.is_exact:
            return Rational.constant(len(self.axes), number.nominal)
        return Rational(ParameterPolynomial.parameter(len(self.axes), self.axes.index(name)))

    def named(self, point: Point) -> str:
        """A point of the box in words."""
        return ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.axes, point, strict=True))

    def _check_name(self, written: Written, part: Name) -> None:
        if part.name in self.parameters:
            return
        meant = closest(part.name, self.parameters)
        advice = f"did you mean {meant!r}?" if meant else f"it has {', '.join(self.parameters) or 'none'}"
        refuse_at(written.place, part.at, f"{quoted(part.name)} is no parameter of this plant; {advice}")

    def _of(self, written: Written, part: Expression) -> Rational:
        if isinstance(part, Number):
            return Rational.constant(len(self.axes), part.value)
        if isinstance(part, Name):
            if part.name not in self.parameters:
                raise _RefusedError
            return self.parameter(part.name)
        if isinstance(part, Negative):
            return -self._of(written, part.part)
        try:
            return self._operation(written, part)
        except DomainError as reason:
            refuse_at(written.place, part.at, f"{written.text(part)} {reason}")
            raise _RefusedError from None

    def _operation(self, written: Written, part: Operation) -> Rational:
        found: list[Rational] = []
        for side in (part.left, part.right):
            try:
                found.append(self._of(written, side))
            except _RefusedError:
                continue  # the other side's mistakes are reported too
        if len(found) < 2:
            raise _RefusedError
        left, right = found
        if part.sign == "+":
            return left + right
        if part.sign == "-":
            return left - right
        if part.sign == "*":
            return left * right
        if part.sign == "/":
            return left * self._inverse(written, part.right, right)
        return self._power(written, part, left, right)

    def _power(self, written: Written, part: Operation, left: Rational, right: Rational) -> Rational:
        exponent = None if right.divisors else right.numerator.value
        if exponent is None or exponent.denominator != 1 or abs(exponent) > MOST_DEGREE:
            message = (
                f"the power {written.text(part.right)} must be a whole number from -{MOST_DEGREE} to {MOST_DEGREE}"
            )
            refuse_at(written.place, part.right.at, message)
            raise _RefusedError
        base = left if exponent >= 0 else self._inverse(written, part.left, left)
        return base.power(abs(int(exponent)))

    def _inverse(self, written: Written, part: Expression, value: Rational) -> Rational:
        divisor = value.numerator
        if divisor not in self.divisors:
            self.divisors[divisor] = self._zero_of(divisor)
        if (zero := self.divisors[divisor]) is not None:
            refuse_at(written.place, part.at, f"divides by {written.text(part)}, {zero}")
            raise _RefusedError
        return value.inverse()

    def _zero_of(self, divisor: ParameterPolynomial) -> str | None:
        if divisor.value is not None:
            return "which is 0" if divisor.is_zero else None
        try:
            point = zero_inside(divisor, self.box)
        except UndecidedError:
            return "which may be 0 in the parameters' ranges; narrow them, or write it in another way"
        return None if point is None else f"which is 0, or changes its sign, with {self.named(point)}"


def _names(tree: Expression) -> list[Name]:
    found: list[Name] = []
    pending: list[Expression] = [tree]
    while pending:
        part = pending.pop()
        if isinstance(part, Name):
            found.append(part)
        elif isinstance(part, Negative):
            pending.append(part.part)
        elif isinstance(part, Operation):
            pending += [part.left, part.right]
    return found

"""Statements -> a rational function and a dead time.  The grammar is that of `descent.py`, with two more rules:

    product := signed (("*" | "/") signed | power)*       a product without a sign, such as 2 s (s + 1)
    atom    := number | name | function "(" … ")" | "[" … "]" | "(" sum ")" | "e" "**" signed

A product without a sign after a division is refused: of a/b c nobody knows whether c is divided by or multiplied with.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction

from fopi_tune.errors import DomainError
from fopi_tune.spec.parametric.descent import Descent, ExpressionError, Token, exact_number
from fopi_tune.spec.transfer_functions.functions import DELAYS, FUNCTIONS, Argument, Text, Value, Vector, exponential
from fopi_tune.spec.transfer_functions.rational import MOST_EXPONENT, ONE, ZERO, Exact, RationalFunction
from fopi_tune.spec.transfer_functions.text import DISCRETE, SEVERAL, Statement
from fopi_tune.spec.yaml.problems import quoted

_S = RationalFunction((ONE, ZERO))
_UNIT = Exact(Fraction(0), Fraction(1))
_DISCRETE_NAMES = ("z", "q")


def evaluate(found: Sequence[Statement]) -> RationalFunction:
    """The value of the last statement that names no option.

    Raises:
        ExpressionError: something that is not understood, or computed with.
    """
    known: dict[str, Value] = {"s": _S, "p": _S, "i": RationalFunction((_UNIT,)), "j": RationalFunction((_UNIT,))}
    last: tuple[str, Value, Statement] | None = None
    for each in found:
        value = _value(each, known)
        if each.option:
            if last is None or each.name != last[0]:
                raise ExpressionError(each.at, f"{quoted(each.name)} is not what was just assigned; give it after that")
            value = _with_option(last[1], Argument(each.option, value, each.at))
        known[each.name] = value
        last = (each.name, value, each)
    assert last is not None
    _, value, statement = last
    if not isinstance(value, RationalFunction):
        raise ExpressionError(statement.at, "this is no transfer function; write one such as 4.39/(s + 0.1746)")
    return value


def _with_option(value: Value, option: Argument) -> Value:
    if option.name.lower() not in DELAYS:
        known = "InputDelay, OutputDelay or IODelay"
        raise ExpressionError(option.at, f"{quoted(option.name)} is no property that is understood; {known} are")
    if not isinstance(value, RationalFunction):
        raise ExpressionError(option.at, "only a transfer function has a dead time")
    return value * option.as_delay()


def _value(statement: Statement, known: Mapping[str, Value]) -> Value:
    parser = _Parser(statement.tokens, known)
    value = parser.sum(0)
    parser.expect_end()
    return value


class _Parser(Descent[Value]):
    """Computes while it reads."""

    def __init__(self, tokens: Sequence[Token], known: Mapping[str, Value]) -> None:
        super().__init__(tokens)
        self.known = known

    def operation(self, sign: Token, left: Value, right: Value) -> Value:
        a, b = (self._function_of_s(each, sign) for each in (left, right))
        return self._computed(sign, lambda: self._operated(sign, a, b))

    def negative(self, sign: Token, part: Value) -> Value:
        if isinstance(part, Vector):
            return Vector(tuple(-each for each in part.entries))
        return -self._function_of_s(part, sign)

    def _computed(self, at: Token, what: Callable[[], RationalFunction]) -> RationalFunction:
        try:
            return what()
        except DomainError as wrong:
            raise ExpressionError(at.at, str(wrong)) from None

    def _operated(self, sign: Token, a: RationalFunction, b: RationalFunction) -> RationalFunction:
        match sign.text:
            case "+":
                return a + b
            case "-":
                return a + -b
            case "*":
                return a * b
            case "/":
                return a * b.inverse()
            case _:
                return self._power(a, b)

    def _power(self, base: RationalFunction, exponent: RationalFunction) -> RationalFunction:
        value = exponent.value
        if value is None or value.im or value.re.denominator != 1:
            raise DomainError("a power must be a whole number; fractional powers of s are no plant of this tool")
        if abs(value.re) > MOST_EXPONENT:
            raise DomainError(f"a power must be from -{MOST_EXPONENT} to {MOST_EXPONENT}")
        return base.power(int(value.re))

    def _function_of_s(self, value: Value, at: Token) -> RationalFunction:
        if isinstance(value, RationalFunction):
            return value
        what = "a list" if isinstance(value, Vector) else f"the text {quoted(value.text)}"
        raise ExpressionError(at.at, f"{what} cannot be computed with; lists are for tf(…), zpk(…) and conv(…)")

    def expect_end(self) -> None:
        if self.has(","):
            raise ExpressionError(self.now.at, "a comma does not belong here; the decimal sign is a point")
        super().expect_end()

    # -- products without a sign, powers of e --------------------------------------------------------------------------

    def product(self, depth: int) -> Value:
        left, divided = self.signed(depth), False
        while True:
            if self.has("*", "/"):
                sign = self.take()
                left, divided = self.operation(sign, left, self.signed(depth)), sign.text == "/"
                continue
            if self.now.kind != "name" and not self.has("("):
                return left
            sign = Token("sign", "*", self.now.at)
            right = self.power(depth)
            if divided and not (isinstance(right, RationalFunction) and right.is_pure_delay):
                advice = "write a/(b*c), or (a/b)*c"
                raise ExpressionError(
                    sign.at, f"it is not clear whether this is divided by or multiplied with; {advice}"
                )
            left = self.operation(sign, left, right)

    def power(self, depth: int) -> Value:
        after = self.tokens[min(self.place + 1, len(self.tokens) - 1)]
        if self.now.text == "e" and self.now.kind == "name" and after.text == "**" and "e" not in self.known:
            base = self.take()
            self.take()
            exponent = self._function_of_s(self.signed(depth + 1), base)
            return self._computed(base, lambda: exponential(exponent))
        return super().power(depth)

    # -- atoms ---------------------------------------------------------------------------------------------------------

    def atom(self, depth: int) -> Value:
        token = self.take()
        if token.kind == "number":
            return self._imaginary(RationalFunction.constant(Exact(exact_number(token))), token)
        if token.kind == "text":
            return Text(token.text[1:-1])
        if token.kind == "name":
            return self._named(token, depth)
        if token.text == "(":
            return self.parenthesis(token, depth)
        if token.text == "[":
            return self._vector(token, depth)
        self.place -= 1
        return self.refuse("a number, s or a parenthesis is missing")

    def _imaginary(self, value: RationalFunction, token: Token) -> RationalFunction:
        # 2i and 2j, as the languages write them
        if self.now.kind == "name" and self.now.text in ("i", "j") and self.now.at == token.end:
            self.take()
            return value * RationalFunction((_UNIT,))
        return value

    def _named(self, token: Token, depth: int) -> Value:
        # a module's name, as in control.tf
        while self.has(".") and self.tokens[self.place + 1].kind == "name" and token.text not in self.known:
            self.take()
            token = self.take()
        name = token.text
        if name in FUNCTIONS and self.has("("):
            opened = self.take()
            arguments = self._arguments(opened, depth)
            try:
                return FUNCTIONS[name](arguments)
            except DomainError as wrong:
                raise ExpressionError(token.at, f"{name}: {wrong}") from None
        if name in self.known:
            return self.known[name]
        if name in _DISCRETE_NAMES:
            raise ExpressionError(token.at, f"{name}: {DISCRETE}")
        if self.has("("):
            known = ", ".join(sorted(FUNCTIONS))
            raise ExpressionError(token.at, f"{quoted(name)} is no function that is known; {known} are")
        advice = "write e^(-L*s) with L a number" if name == "e" else "give its value, or assign it before"
        raise ExpressionError(token.at, f"{quoted(name)} is not known; {advice}")

    def _arguments(self, opened: Token, depth: int) -> list[Argument]:
        found: list[Argument] = []
        while not self.has(")"):
            if found:
                self._comma(opened)
            token, after = self.now, self.tokens[min(self.place + 1, len(self.tokens) - 1)]
            name = ""
            if token.kind == "name" and after.text == "=":
                name = token.text
                self.place += 2
            found.append(Argument(name, self.sum(depth + 1), token.at))
        self.take()
        return _options_named(found)

    def _vector(self, opened: Token, depth: int) -> Vector:
        found: list[RationalFunction] = []
        while not self.has("]"):
            if found:
                self._comma(opened)
            at = self.now
            value = self.sum(depth + 1)
            # a list of one list is that list: [[1, 2]]
            more = value.entries if isinstance(value, Vector) else (self._function_of_s(value, at),)
            if found and isinstance(value, Vector):
                raise ExpressionError(at.at, SEVERAL)
            found.extend(more)
        self.take()
        return Vector(tuple(found))

    def _comma(self, opened: Token) -> None:
        if not self.has(","):
            self.refuse(f"a comma or the end of what column {opened.at + 1} opens is missing")
        self.take()


def _options_named(arguments: Sequence[Argument]) -> list[Argument]:
    """MATLAB's pairs, 'InputDelay', 0.3, as named arguments."""
    found: list[Argument] = []
    waiting = list(arguments)
    while waiting:
        first = waiting.pop(0)
        if isinstance(first.value, Text) and waiting and not first.name:
            first = Argument(first.value.text, waiting.pop(0).value, first.at)
        found.append(first)
    return found

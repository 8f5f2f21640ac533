"""Expressions in parameters:  text -> a tree with the place of each part.

    sum     := product (("+" | "-") product)*
    product := signed (("*" | "/") signed)*
    signed  := ("+" | "-") signed | power
    power   := atom ("**" signed)?
    atom    := number | name | "(" sum ")"

Nothing else is an expression, and nothing of it is ever run as a program.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from fractions import Fraction

from fopi_tune.spec.yaml.problems import quoted
from fopi_tune.spec.yaml.scalars import NotANumberError, parse_number

MAX_LENGTH, MAX_DEPTH = 400, 40
NAME_PATTERN = r"[A-Za-z][A-Za-z0-9_]{0,39}"
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*)|(?P<sign>\*\*|[-+*/()]))"
)
_WRITE_INSTEAD = {"^": "**", "×": "*", "·": "*", "÷": "/", "−": "-", "–": "-", "²": "**2", "³": "**3"}
_ALLOWED = "an expression has numbers, parameters, + - * / ** and parentheses"


class ExpressionError(ValueError):
    """What is wrong with a text, and where.

    Args:
        at: offset of the character, from 0.
        message: what is wrong, and what to write.
    """

    def __init__(self, at: int, message: str) -> None:
        super().__init__(message)
        self.at = at


@dataclass(frozen=True)
class Number:
    """A number, the decimal as it is written; `at` and `end` are offsets of a part's text."""

    value: Fraction
    at: int
    end: int


@dataclass(frozen=True)
class Name:
    """A parameter."""

    name: str
    at: int
    end: int


@dataclass(frozen=True)
class Negative:
    """The negative of a part."""

    part: Expression
    at: int
    end: int


@dataclass(frozen=True)
class Operation:
    """left SIGN right; `sign_at` is the offset of the sign, `at` and `end` hold its parentheses."""

    sign: str
    left: Expression
    right: Expression
    sign_at: int
    at: int
    end: int

    @classmethod
    def of(cls, sign: str, left: Expression, right: Expression, sign_at: int) -> Operation:
        """Without parentheses."""
        return cls(sign, left, right, sign_at, left.at, right.end)


Expression = Number | Name | Negative | Operation


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    at: int


def parse_expression(text: str) -> Expression:
    """The tree of a text.

    Raises:
        ExpressionError: no expression.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(0, f"the expression has {len(text)} characters; write at most {MAX_LENGTH}")
    parser = _Parser(_tokens(text))
    found = parser.sum(0)
    parser.expect_end()
    return found


def names_in(text: str) -> set[str]:
    """Every word of a text, whether it is an expression or not."""
    return set(re.findall(r"[A-Za-z_][A-Za-z0-9_]*", text))


def _tokens(text: str) -> list[_Token]:
    found: list[_Token] = []
    at, end = 0, len(text.rstrip())
    while at < end:
        match = _TOKEN.match(text, at)
        if match is None:
            at += len(text[at:]) - len(text[at:].lstrip())
            raise ExpressionError(at, _about_character(text[at]))
        kind = str(match.lastgroup)
        found.append(_Token(kind, match.group(kind), match.start(kind)))
        at = match.end()
    if not found:
        raise ExpressionError(0, "the expression is empty; write a number or a parameter")
    return [*found, _Token("end", "", end)]


def _about_character(character: str) -> str:
    if character in _WRITE_INSTEAD:
        return f"{character!r} is no sign of an expression; write {_WRITE_INSTEAD[character]}"
    return f"{character!r} does not belong here; {_ALLOWED}"


class _Parser:
    """Recursive descent; every level of parentheses and signs counts towards the depth."""

    def __init__(self, tokens: list[_Token]) -> None:
        self.tokens, self.place = tokens, 0

    @property
    def now(self) -> _Token:
        return self.tokens[self.place]

    def _take(self) -> _Token:
        token = self.now
        self.place += 1
        return token

    def _is(self, *signs: str) -> bool:
        return self.now.kind == "sign" and self.now.text in signs

    def sum(self, depth: int) -> Expression:
        left = self.product(depth)
        while self._is("+", "-"):
            sign = self._take()
            left = Operation.of(sign.text, left, self.product(depth), sign.at)
        return left

    def product(self, depth: int) -> Expression:
        left = self.signed(depth)
        while self._is("*", "/"):
            sign = self._take()
            left = Operation.of(sign.text, left, self.signed(depth), sign.at)
        return left

    def signed(self, depth: int) -> Expression:
        if depth > MAX_DEPTH:
            raise ExpressionError(self.now.at, f"more than {MAX_DEPTH} parentheses or signs lie within each other")
        if not self._is("+", "-"):
            return self.power(depth)
        sign = self._take()
        part = self.signed(depth + 1)
        return part if sign.text == "+" else Negative(part, sign.at, part.end)

    def power(self, depth: int) -> Expression:
        base = self.atom(depth)
        if not self._is("**"):
            return base
        sign = self._take()
        return Operation.of("**", base, self.signed(depth + 1), sign.at)

    def atom(self, depth: int) -> Expression:
        token = self._take()
        if token.kind == "number":
            try:
                parse_number(token.text)
            except NotANumberError as reason:
                raise ExpressionError(token.at, str(reason)) from None
            # rounded here, 0.1 + 0.2 - 0.3 would not be 0
            return Number(Fraction(token.text), token.at, token.at + len(token.text))
        if token.kind == "name":
            if self._is("("):
                raise ExpressionError(token.at, f"{quoted(token.text)} is no function; {_ALLOWED}")
            return Name(token.text, token.at, token.at + len(token.text))
        if token.text == "(":
            inner = self.sum(depth + 1)
            if not self._is(")"):
                self._refuse(f"the parenthesis of column {token.at + 1} of the expression is not closed")
            end = self._take().at + 1
            return replace(inner, at=token.at, end=end) if isinstance(inner, Operation | Negative) else inner
        self.place -= 1
        return self._refuse("a number or a parameter is missing")

    def expect_end(self) -> None:
        if self.now.kind != "end":
            self._refuse("a sign is missing")

    def _refuse(self, otherwise: str) -> Expression:
        token = self.now
        if token.kind == "end":
            raise ExpressionError(token.at, f"{otherwise} at the end")
        if token.text == ")":
            raise ExpressionError(token.at, f"{otherwise} before ')'" if "closed" not in otherwise else otherwise)
        advice = "; write * between factors" if token.kind != "sign" and "sign" in otherwise else ""
        raise ExpressionError(token.at, f"{otherwise} before {quoted(token.text)}{advice}")

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
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache

from fopi_tune.spec.parametric.descent import Descent, ExpressionError, Token, exact_number
from fopi_tune.spec.yaml.problems import quoted

MAX_LENGTH = 400
NAME_PATTERN = r"[A-Za-z][A-Za-z0-9_]{0,39}"
_WRITE_INSTEAD = {"^": "**", "×": "*", "·": "*", "÷": "/", "−": "-", "–": "-", "²": "**2", "³": "**3"}


@dataclass(frozen=True)
class Names:
    """What names are in an expression.

    Args:
        pattern: of one, a regular expression.
        one: what messages call one.
        many: the same of several.
    """

    pattern: str
    one: str
    many: str

    @property
    def allowed(self) -> str:
        """What an expression may have."""
        return f"an expression has numbers, {self.many}, + - * / ** and parentheses"


PARAMETERS = Names(r"[A-Za-z_][A-Za-z0-9_]*", "a parameter", "parameters")


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


def parse_expression(text: str, names: Names = PARAMETERS, start: int = 0) -> Expression:
    """The tree of a text.

    Args:
        text: with the expression.
        names: that it may have.
        start: offset at which it begins; all offsets count from the text's beginning.

    Raises:
        ExpressionError: no expression.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(0, f"the expression has {len(text)} characters; write at most {MAX_LENGTH}")
    parser = _Parser(_tokens(text, names, start), names)
    found = parser.sum(0)
    parser.expect_end()
    return found


def names_in(text: str) -> set[str]:
    """Every word of a text, whether it is an expression or not."""
    # the e of 1e-3 is none
    return set(re.findall(r"(?<![A-Za-z0-9_.])[A-Za-z_][A-Za-z0-9_]*", text))


@lru_cache
def _token_pattern(names: Names) -> re.Pattern[str]:
    return re.compile(
        r"\s*(?:(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
        rf"|(?P<name>{names.pattern})|(?P<sign>\*\*|[-+*/()]))"
    )


def _tokens(text: str, names: Names, start: int) -> list[Token]:
    found: list[Token] = []
    at, end = start, len(text.rstrip())
    while at < end:
        match = _token_pattern(names).match(text, at)
        if match is None:
            at += len(text[at:]) - len(text[at:].lstrip())
            raise ExpressionError(at, _about_character(text[at], names))
        kind = str(match.lastgroup)
        found.append(Token(kind, match.group(kind), match.start(kind)))
        at = match.end()
    if not found:
        raise ExpressionError(0, f"the expression is empty; write a number or {names.one}")
    return [*found, Token("end", "", end)]


def _about_character(character: str, names: Names) -> str:
    if character in _WRITE_INSTEAD:
        return f"{character!r} is no sign of an expression; write {_WRITE_INSTEAD[character]}"
    return f"{character!r} does not belong here; {names.allowed}"


class _Parser(Descent[Expression]):
    """Builds the tree."""

    def __init__(self, tokens: Sequence[Token], names: Names) -> None:
        super().__init__(tokens)
        self.names = names

    def operation(self, sign: Token, left: Expression, right: Expression) -> Expression:
        return Operation.of(sign.text, left, right, sign.at)

    def negative(self, sign: Token, part: Expression) -> Expression:
        return Negative(part, sign.at, part.end)

    def parenthesis(self, opened: Token, depth: int, closed: str = ")") -> Expression:
        """A part's place is with its parentheses."""
        inner = super().parenthesis(opened, depth, closed)
        end = self.tokens[self.place - 1].end
        return replace(inner, at=opened.at, end=end) if isinstance(inner, Operation | Negative) else inner

    def atom(self, depth: int) -> Expression:
        token = self.take()
        if token.kind == "number":
            return Number(exact_number(token), token.at, token.end)
        if token.kind == "name":
            if self.has("("):
                raise ExpressionError(token.at, f"{quoted(token.text)} is no function; {self.names.allowed}")
            return Name(token.text, token.at, token.end)
        if token.text == "(":
            return self.parenthesis(token, depth)
        self.place -= 1
        return self.refuse(f"a number or {self.names.one} is missing")

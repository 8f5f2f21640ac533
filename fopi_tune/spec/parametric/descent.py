"""Recursive descent over sums, products, signs and powers; what is built of them, and what an atom is, subclasses say.

sum     := product (("+" | "-") product)*
product := signed (("*" | "/") signed)*
signed  := ("+" | "-") signed | power
power   := atom ("**" signed)?
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Generic, NoReturn, TypeVar

from fopi_tune.spec.yaml.problems import quoted
from fopi_tune.spec.yaml.scalars import NotANumberError, parse_number

MAX_DEPTH = 40
Built = TypeVar("Built")


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
class Token:
    """A word, number or sign of a text; `at` is the offset of its first character.  The last one's kind is "end"."""

    kind: str
    text: str
    at: int

    @property
    def end(self) -> int:
        """Offset of the character after it."""
        return self.at + len(self.text)


def exact_number(token: Token) -> Fraction:
    """The decimal as it is written; rounded, 0.1 + 0.2 - 0.3 would not be 0.

    Raises:
        ExpressionError: too large, small or long for a number that is computed with.
    """
    try:
        parse_number(token.text)
    except NotANumberError as reason:
        raise ExpressionError(token.at, str(reason)) from None
    return Fraction(token.text)


class Descent(ABC, Generic[Built]):
    """Every level of parentheses and signs counts towards the depth."""

    def __init__(self, tokens: Sequence[Token]) -> None:
        self.tokens, self.place = tokens, 0

    @abstractmethod
    def operation(self, sign: Token, left: Built, right: Built) -> Built:
        """left SIGN right, of + - * / **."""

    @abstractmethod
    def negative(self, sign: Token, part: Built) -> Built:
        """The negative of a part."""

    @abstractmethod
    def atom(self, depth: int) -> Built:
        """A number, a name, a parenthesis, or whatever else stands between signs."""

    @property
    def now(self) -> Token:
        """The token that is next."""
        return self.tokens[self.place]

    def take(self) -> Token:
        """The next token, which then lies behind."""
        token = self.now
        self.place += 1
        return token

    def has(self, *signs: str) -> bool:
        """Whether one of these signs is next."""
        return self.now.kind == "sign" and self.now.text in signs

    def sum(self, depth: int) -> Built:
        """A sum of products."""
        left = self.product(depth)
        while self.has("+", "-"):
            sign = self.take()
            left = self.operation(sign, left, self.product(depth))
        return left

    def product(self, depth: int) -> Built:
        """A product of signed powers."""
        left = self.signed(depth)
        while self.has("*", "/"):
            sign = self.take()
            left = self.operation(sign, left, self.signed(depth))
        return left

    def signed(self, depth: int) -> Built:
        """A power behind signs."""
        if depth > MAX_DEPTH:
            raise ExpressionError(self.now.at, f"more than {MAX_DEPTH} parentheses or signs lie within each other")
        if not self.has("+", "-"):
            return self.power(depth)
        sign = self.take()
        part = self.signed(depth + 1)
        return part if sign.text == "+" else self.negative(sign, part)

    def power(self, depth: int) -> Built:
        """An atom, or a power of it."""
        base = self.atom(depth)
        if not self.has("**"):
            return base
        sign = self.take()
        return self.operation(sign, base, self.signed(depth + 1))

    def parenthesis(self, opened: Token, depth: int, closed: str = ")") -> Built:
        """What stands in parentheses, of which `opened` lies behind."""
        inner = self.sum(depth + 1)
        if not self.has(closed):
            self.refuse(f"the parenthesis of column {opened.at + 1} of the expression is not closed")
        self.take()
        return inner

    def expect_end(self) -> None:
        """Refuse whatever follows."""
        if self.now.kind != "end":
            self.refuse("a sign is missing")

    def refuse(self, otherwise: str) -> NoReturn:
        """Raise what is wrong with the next token."""
        token = self.now
        if token.kind == "end":
            raise ExpressionError(token.at, f"{otherwise} at the end")
        if token.text == ")":
            raise ExpressionError(token.at, f"{otherwise} before ')'" if "closed" not in otherwise else otherwise)
        advice = "; write * between factors" if token.kind != "sign" and "sign" in otherwise else ""
        raise ExpressionError(token.at, f"{otherwise} before {quoted(token.text)}{advice}")

"""Expressions as values:  "= 0.5 * plant.dead_time_s.max" -> the number, from the cell's spec with all other values.

    atom := number | path | "(" sum ")"          sums, products, signs and powers as in expressions of parameters

A path is one of the spec with the overrides of its cell; of a number in place of a range, `min`, `nominal` and `max`
are the number.  For the spec that gains are checked against (`check.`), a path is one of the spec of the design, and
one that begins with `check.` one of the spec of the check.  Decimals are exact; nothing is ever run as a program.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache

from fopi_tune.spec.parametric.descent import ExpressionError, Token, exact_number
from fopi_tune.spec.parametric.expressions import (
    Expression,
    Name,
    Names,
    Negative,
    Number,
    Operation,
    parse_expression,
)
from fopi_tune.spec.yaml.hints import closest
from fopi_tune.spec.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode, kind_of
from fopi_tune.spec.yaml.problems import Mark
from fopi_tune.spec.yaml.scalars import LARGEST, SMALLEST, is_number
from fopi_tune.study.cells.axes import CHECK, EXPRESSION_SIGN, MadeNumber
from fopi_tune.study.overrides import PATH_PATTERN, Override, Path, format_path, parse_path

_PATHS = Names(PATH_PATTERN, "a path", "paths such as plant.time_constant_s.max")
#: of a number that is written in place of a range
_OF_A_RANGE = ("min", "nominal", "max")
_IF_WHOLE = "the value of {!r}; write an expression whose value is whole in each cell, or whole numbers as a list"
#: bits of a power that is computed exactly
_MOST_BITS = 4096
#: whole numbers that a float tells apart
_MOST_WHOLE = 2**53


class UncomputableError(ValueError):
    """A value that cannot be computed:  the path of its override, the place, and what to write."""

    def __init__(self, path: str, mark: Mark, message: str) -> None:
        super().__init__(message)
        self.path, self.mark, self.message = path, mark, message


def is_expression(node: Node) -> bool:
    """Whether a value is to be computed."""
    return isinstance(node, ScalarNode) and node.text.startswith(EXPRESSION_SIGN)


def with_values(
    tree: Node, overrides: Sequence[Override], design: Node | None = None
) -> tuple[Node, list[Override], list[UncomputableError]]:
    """A tree and its overrides with numbers in place of expressions.

    Args:
        tree: with the overrides put in.
        overrides: where expressions are.
        design: the tree of the design, whose numbers were computed, where `tree` is that of a check.

    Returns:
        The tree, the overrides, and what cannot be computed.
    """
    pending = {
        (*(parse_path(each.path) or ()), *inner): node
        for each in overrides
        for inner, node in _expressions_in(each.node, ())
    }
    # a later override may have replaced an earlier one's value
    pending = {path: node for path, node in pending.items() if node_at(tree, path) is node}
    if not pending:
        return tree, list(overrides), []
    values = _Values(tree, design, pending)
    found = {path: values.node_of(path) for path in pending}
    computed = [
        replace(each, node=_with_nodes(each.node, parse_path(each.path) or (), found)) for each in overrides
    ]  # fmt: skip
    return _with_nodes(tree, (), found), computed, list(values.problems.values())


def _expressions_in(node: Node, path: Path) -> Iterator[tuple[Path, ScalarNode]]:
    if isinstance(node, ScalarNode) and is_expression(node):
        yield path, node
    elif isinstance(node, MappingNode):
        for key, (_, inner) in node.entries.items():
            yield from _expressions_in(inner, (*path, key))
    elif isinstance(node, SequenceNode):
        for index, inner in enumerate(node.nodes):
            yield from _expressions_in(inner, (*path, index))


def _with_nodes(node: Node, path: Path, nodes: dict[Path, Node]) -> Node:
    """A node at a path with others in place of those that are listed."""
    if path in nodes:
        return nodes[path]
    if isinstance(node, MappingNode):
        entries = {key: (mark, _with_nodes(each, (*path, key), nodes)) for key, (mark, each) in node.entries.items()}
        return replace(node, entries=entries)
    if isinstance(node, SequenceNode):
        return replace(node, nodes=tuple(_with_nodes(each, (*path, i), nodes) for i, each in enumerate(node.nodes)))
    return node


def node_at(tree: Node, path: Path) -> Node | None:
    """The node at a path of a tree; None where there is none."""
    for step in path:
        if isinstance(tree, MappingNode) and step in tree.entries:
            tree = tree.entries[str(step)][1]
        elif isinstance(tree, SequenceNode) and isinstance(step, int) and step < len(tree.nodes):
            tree = tree.nodes[step]
        else:
            return None
    return tree


@dataclass
class _Values:
    """Computes expressions in the order in which they need each other."""

    tree: Node
    design: Node | None
    pending: dict[Path, ScalarNode]
    problems: dict[Path, UncomputableError] = field(default_factory=dict)
    found: dict[Path, Fraction] = field(default_factory=dict)
    #: expressions that are being computed, each for the one before
    begun: list[Path] = field(default_factory=list)

    def node_of(self, path: Path) -> Node:
        """The number as a node; the expression itself after keeping what is wrong."""
        node = self.pending[path]
        try:
            value = self._value_of(path)
        except UncomputableError as problem:
            self.problems.setdefault(parse_path(problem.path) or (), problem)
            return node
        whole = value.denominator == 1 and abs(value) <= _MOST_WHOLE
        text = str(value.numerator) if whole else repr(float(value))
        return MadeNumber(node.mark, text, plain=True, if_whole=_IF_WHOLE.format(node.text))

    def _value_of(self, path: Path) -> Fraction:
        if path in self.found:
            return self.found[path]
        if path in self.problems:
            raise self.problems[path]
        node = self.pending[path]
        try:
            self.begun.append(path)
            value = self._evaluated(_parsed(node.text))
            _refuse_size(value)
        except ExpressionError as error:
            mark = node.mark
            if node.is_verbatim:
                mark = Mark(mark.line, mark.column + error.at + (0 if node.plain else 1))
            self.problems[path] = UncomputableError(format_path(path), mark, str(error))
            raise self.problems[path] from None
        finally:
            self.begun.pop()
        self.found[path] = value
        return value

    def _evaluated(self, part: Expression) -> Fraction:
        if isinstance(part, Number):
            return part.value
        if isinstance(part, Name):
            return self._named(part)
        if isinstance(part, Negative):
            return -self._evaluated(part.part)
        return _operated(part, self._evaluated(part.left), self._evaluated(part.right))

    def _named(self, name: Name) -> Fraction:
        inside = name.name.startswith(CHECK)
        if inside and self.design is None:
            raise ExpressionError(name.at, f"{name.name} is of the check; a value of the design cannot depend on it")
        path = parse_path(name.name.removeprefix(CHECK))
        assert path, "the grammar takes no other names"
        if self.design is not None and not inside:
            return _number_at(self.design, path, name)
        for known in (path, path[:-1] if path[-1] in _OF_A_RANGE else path):
            if known in self.begun:
                circle = [*self.begun[self.begun.index(known) :], known]
                told = " needs ".join(format_path(each) for each in circle)
                raise ExpressionError(name.at, f"the values need each other in a circle: {told}; write a number in one")
            if known in self.pending:
                return self._value_of(known)
        return _number_at(self.tree, path, name)


def _number_at(tree: Node, path: Path, name: Name) -> Fraction:
    """The number at a path."""
    node = node_at(tree, path)
    outer = node_at(tree, path[:-1])
    if node is None and path[-1] in _OF_A_RANGE and isinstance(outer, ScalarNode):
        node = outer
    if node is None:
        raise ExpressionError(name.at, _about_missing(tree, path))
    if not isinstance(node, ScalarNode) or not node.plain or not is_number(node.text):
        raise ExpressionError(name.at, f"{format_path(path)} is {kind_of(node)} in the spec, no number")
    return exact_number(Token("number", node.text.lstrip("+-"), name.at)) * (-1 if node.text[0] == "-" else 1)


def _about_missing(tree: Node, path: Path) -> str:
    """Which step of a path the spec has not, and what it may mean."""
    depth = next(depth for depth in range(len(path)) if node_at(tree, path[: depth + 1]) is None)
    where, last = node_at(tree, path[:depth]), path[depth]
    meant = closest(str(last), where.entries) if isinstance(where, MappingNode) else None
    hint = f"did you mean {meant!r}?" if meant else "an expression knows what is written there, and no defaults"
    return f"{format_path(path[: depth + 1])} is not in the spec; {hint}"


def _operated(part: Operation, left: Fraction, right: Fraction) -> Fraction:
    if part.sign == "+":
        return left + right
    if part.sign == "-":
        return left - right
    if part.sign == "*":
        return left * right
    if (part.sign == "/" and right == 0) or (part.sign == "**" and left == 0 and right < 0):
        raise ExpressionError(part.sign_at, "this divides by 0")
    return left / right if part.sign == "/" else _power(part, left, right)


def _power(part: Operation, base: Fraction, exponent: Fraction) -> Fraction:
    bits = max(base.numerator.bit_length(), base.denominator.bit_length())
    if exponent.denominator == 1 and bits * abs(exponent) <= _MOST_BITS:
        return base ** int(exponent)
    if base < 0 and exponent.denominator != 1:
        raise ExpressionError(
            part.sign_at, f"a power of {float(base):g} with an exponent that is not whole is no number"
        )
    try:
        value = float(base) ** float(exponent)
    except (OverflowError, ZeroDivisionError):
        value = math.inf
    if not math.isfinite(value):
        raise ExpressionError(part.sign_at, f"the power is too large to compute with; a value is at most {LARGEST:g}")
    return Fraction(value)


def _refuse_size(value: Fraction) -> None:
    if abs(value) > LARGEST:
        raise ExpressionError(
            0, f"the value is too large to compute with; at most {LARGEST:g} can be written in a spec"
        )
    if value != 0 and abs(value) < SMALLEST:
        raise ExpressionError(
            0, f"the value is too small to compute with; at least {SMALLEST:g} can be written in a spec"
        )


@lru_cache(256)
def _parsed(text: str) -> Expression:
    """The tree of an expression behind its sign; offsets count from the sign."""
    start = len(EXPRESSION_SIGN)
    if not text[start:].strip():
        raise ExpressionError(0, f"nothing follows {EXPRESSION_SIGN}; {_PATHS.allowed}")
    return parse_expression(text, _PATHS, start)

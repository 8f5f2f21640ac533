"""Function blocks of IEC 61131-3 run from their text:  blark's parse tree -> closures over NumPy's scalars.

The part of the language that exported controllers use: declarations with initial values, arrays of one index, :=, IF,
FOR, arithmetic, comparisons and logic.  It is strictly typed: LREAL, REAL, INT and BOOL are never mixed, constants and
inputs never written, every name declared, whatever the case of its letters; what is not known here is an error.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from blark import transform as tree
from blark.parse import parse_source_code

Memory = dict[str, Any]
Run = Callable[[Memory], Any]

DTYPES = {"LREAL": np.float64, "REAL": np.float32}
ARITHMETIC = {"+": operator.add, "-": operator.sub, "*": operator.mul}
COMPARISONS = {"<": operator.lt, ">": operator.gt, "<=": operator.le, ">=": operator.ge}
LOGIC = {"AND": operator.and_, "OR": operator.or_}


@dataclass(frozen=True)
class Variable:
    """A declaration: its elementary type, number of elements or None, section, and initial value."""

    type: str
    count: int | None
    section: str
    initial: Any


@dataclass
class Expression:
    """What an expression's type is and how its value is found."""

    type: str
    value: Run


@dataclass
class FunctionBlock:
    """An instance: a call sets inputs, runs the body once and returns the output.

    Args:
        name: of the block.
        variables: by names in lower case.
        body: a closure a statement.
        memory: values of variables.
    """

    name: str
    variables: dict[str, Variable]
    body: list[Run] = field(default_factory=list)
    memory: Memory = field(default_factory=dict)

    @classmethod
    def of(cls, text: str) -> FunctionBlock:
        """The one block of a text, with initial values."""
        parsed = parse_source_code(text)
        assert parsed.exception is None, parsed.exception
        (block,) = parsed.transform().items
        assert isinstance(block, tree.FunctionBlock)
        made = cls(str(block.name), {})
        for section in block.declarations:
            made._declare(section)
        assert block.body is not None
        made.body = made._statements(block.body)
        made.start()
        return made

    def start(self) -> None:
        """As a new instance is."""
        copied = {name: list(v.initial) if v.count else v.initial for name, v in self.variables.items()}
        self.memory.clear()
        self.memory.update(copied)

    def __call__(self, **inputs: float | bool) -> Any:
        """One call.  Overflow and NaN are values."""
        for name, value in inputs.items():
            variable = self.variables[name]
            assert variable.section == "input", name
            self.memory[name] = bool(value) if variable.type == "BOOL" else DTYPES[variable.type](value)
        for statement in self.body:
            statement(self.memory)
        return self.memory["output"]

    def _declare(self, section: Any) -> None:
        constant = getattr(section, "attrs", None) is tree.VariableAttributes.constant
        kinds = {tree.InputDeclarations: "input", tree.OutputDeclarations: "output"}
        kind = kinds.get(type(section), "constant" if constant else "local")
        for item in section.items:
            type_, count = self._type(item.init.spec)
            given = item.init.value
            assert kind != "constant" or given is not None
            for declared in item.variables:
                name = declared.variable.name.lower()
                assert name not in self.variables, f"{name} is declared twice"
                initial = self._initial(given, type_, count)
                self.variables[name] = Variable(type_, count, kind, initial)

    def _type(self, spec: Any) -> tuple[str, int | None]:
        if not isinstance(spec, tree.ArraySpecification):
            return str(spec.type), None
        element: Any = spec.type
        one: Any = spec.subranges[0]
        assert len(spec.subranges) == 1
        assert self._expression(one.start).value({}) == 0
        return str(element.type_name), 1 + self._expression(one.stop).value({})

    def _initial(self, given: Any, type_: str, count: int | None) -> Any:
        zero = {"BOOL": False, "INT": 0}.get(type_) if type_ not in DTYPES else DTYPES[type_](0.0)
        assert zero is not None, type_
        if given is None:
            return zero if count is None else [zero] * count
        if count is None:
            return self._of_type(given, type_).value({})
        values = [self._of_type(element, type_).value({}) for element in _elements(given)]
        assert len(values) == count
        return values

    def _statements(self, listed: Any) -> list[Run]:
        return [self._statement(one) for one in (listed.statements if listed is not None else [])]

    def _statement(self, node: Any) -> Run:
        if isinstance(node, tree.AssignmentStatement):
            return self._assignment(node)
        if isinstance(node, tree.IfStatement):
            return self._if(node)
        assert isinstance(node, tree.ForStatement), f"{type(node).__name__} is not known"
        return self._for(node)

    def _assignment(self, node: tree.AssignmentStatement) -> Run:
        target: Any = node.variables[0]
        assert len(node.variables) == 1
        if isinstance(target, tree.SimpleVariable):
            name = self._written(target)
            assert self.variables[name].count is None, name
            value = self._of_type(node.expression, self.variables[name].type).value

            def assign(memory: Memory) -> None:
                memory[name] = value(memory)

            return assign
        name, index = self._element(target)
        self._written(target.name)
        value = self._of_type(node.expression, self.variables[name].type).value

        def assign_element(memory: Memory) -> None:
            at = index(memory)
            assert at >= 0
            memory[name][at] = value(memory)

        return assign_element

    def _written(self, target: Any) -> str:
        name = target.name.lower()
        assert self.variables[name].section in ("output", "local"), f"{name} is written"
        return name

    def _if(self, node: tree.IfStatement) -> Run:
        branches = [(self._of_type(node.if_expression, "BOOL").value, self._statements(node.statements))]
        for other in node.else_ifs:
            branches.append((self._of_type(other.if_expression, "BOOL").value, self._statements(other.statements)))
        rest = [] if node.else_clause is None else self._statements(node.else_clause.statements)

        def branch(memory: Memory) -> None:
            body = next((statements for condition, statements in branches if condition(memory)), rest)
            for statement in body:
                statement(memory)

        return branch

    def _for(self, node: tree.ForStatement) -> Run:
        assert node.step is None
        name, body = self._written(node.control), self._statements(node.statements)
        first, last = (self._of_type(bound, "INT").value for bound in (node.from_, node.to))
        assert self.variables[name].type == "INT"

        def loop(memory: Memory) -> None:
            for at in range(first(memory), last(memory) + 1):
                memory[name] = at
                for statement in body:
                    statement(memory)

        return loop

    def _of_type(self, node: Any, type_: str) -> Expression:
        made = self._expression(node)
        assert made.type == type_, f"{made.type} in place of {type_}: {node}"
        return made

    def _expression(self, node: Any) -> Expression:
        if isinstance(node, tree.ParenthesizedExpression):
            return self._expression(node.expr)
        if isinstance(node, tree.Real | tree.Integer | tree.Boolean):
            return _literal(node)
        if isinstance(node, tree.SimpleVariable):
            name = node.name.lower()
            assert self.variables[name].count is None, name
            return Expression(self.variables[name].type, operator.itemgetter(name))
        if isinstance(node, tree.MultiElementVariable):
            name, index = self._element(node)
            return Expression(self.variables[name].type, lambda memory: memory[name][index(memory)])
        if isinstance(node, tree.UnaryOperation):
            return self._unary(node)
        assert isinstance(node, tree.BinaryOperation), f"{type(node).__name__} is not known"
        return self._binary(node)

    def _element(self, node: Any) -> tuple[str, Run]:
        name = node.name.name.lower()
        assert self.variables[name].count is not None, name
        (listed,) = node.elements
        (subscript,) = listed.subscripts
        return name, self._of_type(subscript, "INT").value

    def _unary(self, node: tree.UnaryOperation) -> Expression:
        of, op = self._expression(node.expr), str(node.op).upper()
        if op == "NOT":
            assert of.type == "BOOL"
            return Expression("BOOL", lambda memory: not of.value(memory))
        assert op == "-"
        assert of.type in DTYPES
        return Expression(of.type, lambda memory: -of.value(memory))

    def _binary(self, node: tree.BinaryOperation) -> Expression:
        left, right, op = self._expression(node.left), self._expression(node.right), str(node.op).upper()
        assert left.type == right.type, f"{left.type} {op} {right.type}"
        known = ARITHMETIC | COMPARISONS if left.type in DTYPES else LOGIC if left.type == "BOOL" else {}
        compute, one, other = known[op], left.value, right.value
        type_ = left.type if op in ARITHMETIC else "BOOL"
        return Expression(type_, lambda memory: compute(one(memory), other(memory)))


def _elements(given: tree.ArrayInitialization) -> list[Any]:
    """The elements of a list, which blark has as a list of lists."""
    found: list[Any] = []
    for one in given.elements:
        assert isinstance(one, tree.ArrayInitialElement)
        assert one.count is None
        found += _elements(one.element) if isinstance(one.element, tree.ArrayInitialization) else [one.element]
    return found


def _literal(node: tree.Real | tree.Integer | tree.Boolean) -> Expression:
    """Reals have their type in front, integers are INT."""
    if isinstance(node, tree.Boolean):
        value: Any = str(node.value).upper() == "TRUE"
        type_ = "BOOL"
    elif isinstance(node, tree.Integer):
        assert node.type_name is None
        value, type_ = int(node.value), "INT"
    else:
        type_ = str(node.type_name)
        value = DTYPES[type_](str(node.value))
    return Expression(type_, lambda memory: value)

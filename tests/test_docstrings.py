"""Docstrings of what is public:  there for each, with parameters, units or shapes, errors, and sources of formulas.

Public is what `fopi_tune` and its sub-packages export (of a module without `__all__`: what it defines), and the public
methods of the classes among them.
"""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import re
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from fopi_tune.spec.python.requirements import RequirementWord

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "fopi_tune"
MODULES = [
    "fopi_tune",
    *sorted(
        "fopi_tune." + path.parent.relative_to(PACKAGE).as_posix().replace("/", ".")
        for path in PACKAGE.rglob("__init__.py")
        if path.parent != PACKAGE
    ),
    "fopi_tune.results.candidate",
    "fopi_tune.results.status",
    "fopi_tune.study.load",
]
#: what a name says of its unit; and what words of a docstring do
UNIT_IN_NAME = re.compile(r"_(s|deg|db|rad|rad_s|per_s|neper|natural|inches|m_s2|per_decade)$")
UNIT_IN_WORDS = re.compile(
    r"\b(shapes?|units?|scalar|rad|rad/s|deg|dB|s|inches|neper|radian|relative|dimensionless|probability|seconds)\b"
    r"|\bof each\b|\(0, |\[0, |0 < |between 0 and 1|spec's"
)
#: annotations of parameters that speak for themselves: objects of the package, and functions that are told something
NUMBERS = re.compile(r"\b(float|Array)\b")
PLAIN = re.compile(r"\b(float|int|str|bool|Array|Mapping|Sequence|Iterable|dict|list|tuple|object|Any)\b")


def exported(module: str) -> Iterator[tuple[str, Any]]:
    """Classes and functions that a module exports, under the name of where they are written."""
    found = importlib.import_module(module)
    names = getattr(found, "__all__", None) or [n for n in vars(found) if not n.startswith("_")]
    for name in names:
        value = getattr(found, name)
        foreign = not hasattr(found, "__all__") and getattr(value, "__module__", "") != module
        if not foreign and (inspect.isclass(value) or inspect.isfunction(value)):
            yield f"{value.__module__}.{value.__qualname__}", value


EXPORTED = dict(sorted({name: value for module in MODULES for name, value in exported(module)}.items()))
CLASSES = {name: value for name, value in EXPORTED.items() if inspect.isclass(value)}


def methods(owner: type) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Public methods and properties that a class defines itself."""
    for name, value in vars(owner).items():
        function = getattr(value, "fget", None) or getattr(value, "__func__", value)
        if not name.startswith("_") and inspect.isfunction(function):
            yield name, function


FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: value for name, value in EXPORTED.items() if inspect.isfunction(value)},
    **{f"{owner}.{name}": value for owner, each in CLASSES.items() for name, value in methods(each)},
}
FIELDS = {
    f"{owner}.{field.name}": (each, field)
    for owner, each in CLASSES.items()
    if dataclasses.is_dataclass(each)
    for field in dataclasses.fields(each)
    if not field.name.startswith("_")
}


def entries(text: str, section: str = "Args") -> dict[str, str]:
    """The entries of a docstring's section: name to words."""
    inside = re.search(rf"^{section}:\n((?:[ ]{{4}}.*\n?|\n)*)", text, re.MULTILINE)
    if inside is None:
        return {}
    parts = re.split(r"^(\w+(?:, \w+)*): ?", textwrap.dedent(inside[1]), flags=re.MULTILINE)[1:]
    told = zip(parts[::2], parts[1::2], strict=True)
    return {name: words for names, words in told for name in names.split(", ")}


def words_of(text: str, name: str) -> str:
    """What a docstring says of a parameter or field: its entry, or the sentences that name it in `code`."""
    entry = entries(text).get(name)
    if entry is not None:
        return entry
    return text if f"`{name}`" in text else ""


def doc(value: object) -> str:
    return inspect.getdoc(value) or ""


def raised(function: Callable[..., Any]) -> set[str]:
    """Exceptions of this package that a function raises, itself or in a private function of its module it calls."""
    module = ast.parse(inspect.getsource(importlib.import_module(function.__module__)))
    private = {n.name: n for n in module.body if isinstance(n, ast.FunctionDef) and n.name.startswith("_")}
    (own,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
    called = {n.func.id for n in ast.walk(own) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
    bodies = [own, *(private[name] for name in called & set(private))]
    return {
        node.exc.func.id
        for body in bodies
        for node in ast.walk(body)
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and isinstance(node.exc.func, ast.Name)
    } & {"DomainError", "SpecError", "CertificateError", "TooManyCellsError"}


def test_what_is_public_is_counted() -> None:
    # a floor, so that the other tests cannot pass by looking at nothing
    assert len(EXPORTED) >= 110
    assert len(FUNCTIONS) >= 130
    assert len(FIELDS) >= 200
    root = importlib.import_module("fopi_tune")
    # words such as `phase_margin_deg` are objects of one class, which has its docstring
    named = {name for name in root.__all__ if not isinstance(getattr(root, name), RequirementWord)}
    assert named <= {name.rpartition(".")[2] for name in EXPORTED}


@pytest.mark.parametrize("name", [*EXPORTED, *(name for name in FUNCTIONS if name not in EXPORTED)])
def test_everything_public_has_a_docstring(name: str) -> None:
    value = EXPORTED.get(name) or FUNCTIONS[name]
    said = value.__doc__ or ""
    assert said, name
    # what a dataclass without a docstring gets by itself
    assert not said.startswith(f"{getattr(value, '__name__', '')}("), name


@pytest.mark.parametrize("name", FUNCTIONS)
def test_parameters_are_told_and_numbers_have_units_or_shapes(name: str) -> None:
    function, said = FUNCTIONS[name], doc(FUNCTIONS[name])
    for parameter in inspect.signature(function).parameters.values():
        kind = str(parameter.annotation)
        if parameter.name in ("self", "cls") or not PLAIN.search(kind):
            continue
        words = words_of(said, parameter.name)
        assert words, f"{name} does not tell {parameter.name}: {kind}"
        if NUMBERS.search(kind):
            assert UNIT_IN_NAME.search(parameter.name) or UNIT_IN_WORDS.search(words), (
                f"{name}: {parameter.name} has no unit or shape: {words!r}"
            )


@pytest.mark.parametrize("name", FIELDS)
def test_fields_of_dataclasses_are_told_and_numbers_have_units_or_shapes(name: str) -> None:
    owner, field = FIELDS[name]
    words = words_of(doc(owner), field.name)
    assert words, f"{name} is not told"
    if NUMBERS.search(str(field.type)):
        assert UNIT_IN_NAME.search(field.name) or UNIT_IN_WORDS.search(words), f"{name} has no unit or shape: {words!r}"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_errors_that_are_raised_are_told(name: str) -> None:
    told = "\n".join(entries(doc(FUNCTIONS[name]), "Raises"))
    assert [error for error in raised(FUNCTIONS[name]) if error not in told] == []


@pytest.mark.parametrize("name", FUNCTIONS)
def test_arrays_tuples_and_missing_results_are_told(name: str) -> None:
    kind, said = str(inspect.signature(FUNCTIONS[name]).return_annotation), doc(FUNCTIONS[name])
    if re.search(r"\bArray\b", kind):
        assert re.search(r"shape|\((m|n|p)[,)]", said), f"{name} returns an array of no shape"
    if kind.endswith("| None"):
        assert "None" in said, f"{name} does not say when it returns None"
    if re.fullmatch(r"tuple\[(?!.*\.\.\.\]).*,.*\]", kind):
        assert "Returns:" in said, f"{name} does not say what its tuple holds"


def numbered() -> Iterator[tuple[str, str]]:
    """Docstrings of the whole package that have a numbered formula."""
    formula = re.compile(r"^ +\S.* {2,}\(\d+a?\)$", re.MULTILINE)
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        # most files have none, and need not be parsed
        for node in ast.walk(ast.parse(text)) if re.search(r" {2}\(\d+a?\)", text) else ():
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                said = ast.get_docstring(node)
                if said and formula.search(said):
                    yield f"{path.relative_to(ROOT).as_posix()}:{getattr(node, 'name', 'module')}", said


NUMBERED = dict(numbered())


def test_formulas_that_are_numbered_are_found() -> None:
    assert len(NUMBERED) >= 25


@pytest.mark.parametrize("name", NUMBERED)
def test_a_numbered_formula_names_its_source_or_derivation(name: str) -> None:
    # a publication with its year, or a line that says from what it is derived
    said = NUMBERED[name]
    assert re.search(r"^Source: \S+", said, re.MULTILINE) or re.search(r"\b(19|20)\d\d\b", said), name


def test_a_docstring_that_lacks_something_is_found_out() -> None:
    assert words_of("The plant.", "limit") == ""
    assert words_of("Where `limit` is.", "limit")
    assert entries("A.\n\nArgs:\n    a: one,\n        in s.\n    b: two.\n\nRaises:\n    E: no.\n") == {
        "a": "one,\n    in s.\n",
        "b": "two.\n\n",
    }
    assert not UNIT_IN_WORDS.search("the largest one")
    assert raised(FUNCTIONS["fopi_tune.paper.figures.figure_png"]) == {"DomainError"}

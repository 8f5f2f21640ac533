"""Conventions that ten lines can hold us to: who may import whom, who may print, docstrings, nothing of one machine."""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "fopi_tune"
MODULES = {".".join(p.relative_to(ROOT).with_suffix("").parts): p for p in sorted(PACKAGE.rglob("*.py"))}

#: from the ground up, as in CONTRIBUTING.md: a folder imports from itself and from those before it.  A registry of
#: claims and figures is named by text (`study/registry.py`), which is what travels to a worker: no import
LAYERS = (
    "errors",
    "core",
    "quantities",
    "spec",
    "identification",
    "digital",
    "simulation",
    "proof",
    "optimum",
    "montecarlo",
    "results",
    "design",
    "convex",
    "prices",
    "pipeline",
    "study",
    "report",
    "paper",
    "cli",
)
#: what the package's root may hold beside the folders
AT_THE_ROOT = {"__init__.py", "__main__.py", "errors.py", "py.typed"}
#: of the root, what folders may ask for: a string
VERSION = "fopi_tune.__version__"
#: opinions of their own: neither ever looks at the other
APART = (
    ("proof", "design"), ("proof", "convex"), ("design", "proof"), ("design", "convex"), ("convex", "design"),
    ("optimum", "design"),
)  # fmt: skip
MOST_FILES = 16
LEAST_LINES = 25
#: these print or write; one module reads what people give, and the ledger of a study is a database
LEDGER = "fopi_tune.study.ledger"
MAY_TOUCH_THE_DISK = {
    "fopi_tune.cli.output": {"print", "open"},
    "fopi_tune.results.saved.writing": {"open"},
    "fopi_tune.spec.files": {"open"},
    # this package's own files
    "fopi_tune.spec.load": {"read_bytes"},
    "fopi_tune.results.stamp": {"read_bytes"},
    LEDGER: {"open"},
}


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def imports(module: ast.Module) -> Iterator[str]:
    """Full names of what a module imports, from inside functions too."""
    for node in ast.walk(module):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def inside(name: str, allowed: str) -> bool:
    return name == allowed or name.startswith(f"{allowed}.")


def module_of(imported: str) -> str:
    """The module that an imported name is, or stands in."""
    while imported not in MODULES and f"{imported}.__init__" not in MODULES:
        imported = imported.rpartition(".")[0]
    return imported


@cache
def own_imports(name: str) -> frozenset[str]:
    """The modules of this package that a module imports, for types and inside functions too."""
    found = (imported for imported in imports(tree(MODULES[name])) if imported.split(".")[0] == "fopi_tune")
    return frozenset(module_of(imported) for imported in found if imported != VERSION)


def folder_of(module: str) -> str:
    """The folder of a module; a package is its own."""
    return module if f"{module}.__init__" in MODULES else module.removesuffix(".__init__").rpartition(".")[0]


def circles(graph: Mapping[str, set[str] | frozenset[str]]) -> list[str]:
    """What is left of a graph when everything that leads to no circle is taken away."""
    left = {node: {other for other in others if other in graph and other != node} for node, others in graph.items()}
    while ends := [node for node, others in left.items() if not others]:
        for node in ends:
            del left[node]
        left = {node: others - set(ends) for node, others in left.items()}
    return sorted(left)


@pytest.mark.parametrize("name", [name for name in MODULES if name.count(".") > 1])
def test_a_folder_imports_only_from_those_below_it(name: str) -> None:
    own = LAYERS.index(name.split(".")[1])
    for imported in own_imports(name):
        assert imported != "fopi_tune", f"{name} imports the package's root"
        assert LAYERS.index(imported.split(".")[1]) <= own, f"{name} imports {imported}"


def test_every_folder_has_its_place_among_the_layers() -> None:
    assert set(LAYERS) == {name.split(".")[1] for name in MODULES} - {"__init__", "__main__"}


def test_no_module_needs_itself_by_a_detour() -> None:
    # a package's __init__ lists names of its own modules: it counts as the folder, below
    graph = {name: own_imports(name) for name in MODULES if not name.endswith("__init__")}
    assert circles(graph) == []


def test_no_folder_needs_itself_by_a_detour() -> None:
    graph: dict[str, set[str]] = {}
    for name in MODULES:
        if name.count(".") > 1:
            graph.setdefault(folder_of(name), set()).update(folder_of(found) for found in own_imports(name))
    # a folder may use its own subfolders, and they what lies beside them in it: modules are held apart above
    for folder, others in graph.items():
        others -= {other for other in others if inside(other, folder) or inside(folder, other)}
    assert circles(graph) == []


def test_nothing_lies_loose_at_the_root() -> None:
    assert {path.name for path in PACKAGE.iterdir() if path.is_file()} == AT_THE_ROOT


def test_folders_and_files_have_a_readable_size() -> None:
    folders = {path.parent for path in MODULES.values()}
    assert {folder.name: n for folder in folders if (n := len(list(folder.glob("*.py")))) > MOST_FILES} == {}
    short = {name for name, path in MODULES.items() if len(path.read_text(encoding="utf-8").splitlines()) < LEAST_LINES}
    assert {name for name in short if not name.endswith("__init__")} == {"fopi_tune.__main__"}


def test_design_proof_and_the_convex_path_are_opinions_of_their_own() -> None:
    for name in MODULES:
        for one, other in APART:
            if inside(name, f"fopi_tune.{one}"):
                assert not any(inside(found, f"fopi_tune.{other}") for found in own_imports(name)), name


@pytest.mark.parametrize("name", MODULES)
def test_only_the_command_line_prints_or_touches_the_disk(name: str) -> None:
    calls = {"print", "open", "input"}
    methods = {"write_text", "write_bytes", "read_text", "read_bytes", "open", "mkdir", "unlink", "replace", "savefig"}
    methods |= {"write"}
    allowed = MAY_TOUCH_THE_DISK.get(name, set())
    for node in ast.walk(tree(MODULES[name])):
        if not isinstance(node, ast.Call):
            continue
        called = node.func
        if isinstance(called, ast.Name):
            assert called.id not in calls - allowed, f"{name}:{node.lineno} calls {called.id}"
        elif isinstance(called, ast.Attribute) and called.attr in methods - allowed and "open" not in allowed:
            # str.replace(old, new) and dataclasses.replace(...) are not os.replace
            owner = called.value.id if isinstance(called.value, ast.Name) else ""
            harmless = called.attr == "replace" and owner != "os"
            assert harmless, f"{name}:{node.lineno} calls {called.attr}"


@pytest.mark.parametrize("name", MODULES)
def test_only_the_ledger_has_a_database(name: str) -> None:
    assert name == LEDGER or not any(found.startswith("sqlite3") for found in imports(tree(MODULES[name])))


def public_definitions(body: list[ast.stmt]) -> Iterator[ast.FunctionDef | ast.ClassDef]:
    """Public functions and classes of a module, and the public functions of its classes that are no overrides."""
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node
            if isinstance(node, ast.ClassDef) and not node.bases:
                yield from (n for n in node.body if isinstance(n, ast.FunctionDef) and not n.name.startswith("_"))


@pytest.mark.parametrize("name", MODULES)
def test_modules_and_public_definitions_have_docstrings(name: str) -> None:
    module = tree(MODULES[name])
    if module.body:
        assert ast.get_docstring(module), name
    # A quantity's class says what it is by its attributes, the sentence `meaning` among them.
    quantities = inside(name, "fopi_tune.quantities")
    for node in public_definitions(module.body):
        if not (quantities and isinstance(node, ast.ClassDef) and node.bases):
            assert ast.get_docstring(node), f"{name}.{node.name} has no docstring"


@pytest.mark.parametrize("name", MODULES)
def test_files_stay_small(name: str) -> None:
    module = MODULES[name]
    assert len(module.read_text(encoding="utf-8").splitlines()) <= 400, "a file above 300 lines is questioned"


def test_tests_lie_as_what_they_test() -> None:
    """Tests of `fopi_tune/core/margins.py` are in `tests/core/test_margins.py`, or in a file that begins so."""
    tests = ROOT / "tests"
    for path in sorted(tests.rglob("test_*.py")):
        folder = PACKAGE / path.parent.relative_to(tests)
        names = [p.stem for p in folder.iterdir()] if folder.is_dir() else []
        known = any(path.stem == f"test_{name}" or path.stem.startswith(f"test_{name}_") for name in names)
        assert known or path.parent == tests, f"{path.relative_to(ROOT)} is the test of no module"


def checked_in() -> list[Path]:
    """The files of the project; those git would take where there is a repository."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode == 0 and listed.stdout:
        return [path for path in (ROOT / line for line in listed.stdout.splitlines()) if path.is_file()]
    hidden = re.compile(r"^/results/|/(\.(?!ci)[^/]*|build|dist|__pycache__|[^/]*\.egg-info)/")
    found = (path for path in ROOT.rglob("*") if not hidden.search(f"/{path.relative_to(ROOT).as_posix()}/"))
    return [path for path in found if path.is_file()]


def test_no_file_knows_a_machine_or_a_registry() -> None:
    # pieces, so that this file does not contain what it looks for
    roots = "|".join(("home", "root", "work", "Users", "opt"))
    hosts = "|".join(("pypi" + r"\.org", "python" + r"hosted", "index-" + "url", "file:" + "//", "local" + "host"))
    place = re.compile(rf"(?<![\w.}}/:])/(?:{roots})/|{hosts}|\b\d{{1,3}}(?:\.\d{{1,3}}){{3}}\b")
    for path in checked_in():
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        found = place.search(text)
        assert found is None, f"{path.relative_to(ROOT)} says {found.group()!r}"


def test_the_constraints_pin_one_version_each() -> None:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [line for line in lines if not line.startswith("#")]
    names = [pin.partition("==")[0] for pin in pins]
    assert names == sorted(set(names))
    assert all(re.fullmatch(r"[a-z0-9-]+==[0-9][0-9a-z.]*", pin) for pin in pins)

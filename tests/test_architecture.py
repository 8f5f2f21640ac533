"""Conventions that ten lines can hold us to: who may import whom, who may print, docstrings, nothing of one machine."""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "fopi_tune"
MODULES = {".".join(p.relative_to(ROOT).with_suffix("").parts): p for p in sorted(PACKAGE.rglob("*.py"))}

STAGES = ("core", "quantities", "spec")
#: folder (or module) -> what of this package it may import, besides itself
ALLOWED = {
    "__init__": (
        *STAGES,
        "candidate",
        "errors",
        "optimum",
        "outcome",
        "prices",
        "proof",
        "pipeline",
        "pipeline_optimum",
        "pipeline_systems",
        "pipeline_time",
        "result",
        "simulated",
        "systems",
    ),
    "errors": (),
    "core": ("errors",),
    "quantities": ("core", "errors"),
    "identify": ("core", "errors"),
    "spec": ("quantities", "core", "errors"),
    "outcome": (),
    "candidate": ("outcome", "core"),
    "convex": ("candidate", "outcome", "proof", "spec.model", "quantities", "core", "errors"),
    "design": ("candidate", "outcome", "spec.model", "quantities", "core", "errors"),
    "proof": ("spec.model", "quantities", "core", "errors"),
    "optimum": ("proof", "spec.model", "quantities", "core", "errors"),
    "digital": ("spec.model", "core", "errors"),
    "validation": ("digital", "proof", "quantities", "spec.model", "core", "errors"),
    "stamp": ("__version__",),
    "convert": ("core", "errors"),
    "dicts": ("core", "outcome", "proof", "spec.model"),
    "prices": (
        *("core", "design", "dicts", "errors", "outcome", "proof"),
        *("quantities", "spec.model", "stamp"),
    ),
    "result": (
        *("convert", "core", "dicts", "digital", "optimum", "outcome", "proof", "quantities"),
        *("spec.model", "stamp", "validation"),
    ),
    "report": (
        "core",
        "errors",
        "optimum",
        "outcome",
        "prices",
        "proof",
        "quantities",
        "simulated",
        "spec.model",
        "study",
        "systems",
        "result",
        "validation",
    ),
    "study": (
        *("core", "design", "errors", "outcome", "pipeline", "pipeline_time", "proof", "result", "spec", "stamp"),
        "validation",
    ),
    "simulated": ("core", "errors", "spec.model", "stamp", "validation"),
    "systems": ("core", "simulated", "spec.model", "stamp", "validation"),
    "pipeline_optimum": ("core", "optimum", "spec", "validation"),
    "pipeline_systems": (
        *("core", "errors", "implement", "outcome", "pipeline", "pipeline_time", "spec", "stamp", "systems"),
        "validation",
    ),
    "pipeline_time": (
        *("core", "errors", "implement", "pipeline", "result", "simulated", "spec", "stamp", "validation"),
    ),
    "advice": ("outcome", "quantities", "spec.model"),
    "assemble": ("candidate", "outcome", "proof", "result", "spec.model", "stamp"),
    "implement": (
        *("assemble", "core", "design", "digital", "errors", "outcome", "proof"),
        *("quantities", "spec.model", "stamp"),
    ),
    "pipeline": (
        *("advice", "assemble", "candidate", "convex", "core", "design", "digital", "errors", "implement", "outcome"),
        *("prices", "proof", "result", "simulated", "spec", "stamp", "validation"),
    ),
    "paper": (
        *("core", "digital", "errors", "outcome", "pipeline", "pipeline_systems", "pipeline_time", "report"),
        *("result", "simulated", "spec", "validation"),
    ),
    "__main__": ("cli",),
    "cli": (
        *(
            "__version__",
            "candidate",
            "core",
            "digital",
            "errors",
            "identify",
            "optimum",
            "pipeline",
            "pipeline_optimum",
            "pipeline_systems",
            "pipeline_time",
            "prices",
            "proof",
        ),
        *("report", "result", "simulated", "spec", "study", "systems"),
    ),
}
#: these print or write; the loader of specs reads, and the ledger of a study is a database
LEDGER = "fopi_tune.study.ledger"
MAY_TOUCH_THE_DISK = {
    "fopi_tune.cli.output": {"print", "open"},
    "fopi_tune.spec.load": {"open"},
    # this package's own sources
    "fopi_tune.stamp": {"open"},
    LEDGER: {"open"},
}


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


@pytest.mark.parametrize("name", MODULES)
def test_imports_point_towards_the_core(name: str) -> None:
    own = name.split(".")[1]
    for imported in imports(tree(MODULES[name])):
        if imported.split(".")[0] != "fopi_tune":
            continue
        target = imported.partition(".")[2]
        assert any(inside(target, allowed) for allowed in (own, *ALLOWED[own])), f"{name} imports {imported}"


def test_design_proof_and_the_convex_path_are_opinions_of_their_own() -> None:
    for name, path in MODULES.items():
        pairs = (
            ("design", "proof"),
            ("proof", "design"),
            ("convex", "design"),
            ("design", "convex"),
            ("proof", "convex"),
        )
        for one, other in pairs:
            if inside(name, f"fopi_tune.{one}"):
                assert not any(inside(found, f"fopi_tune.{other}") for found in imports(tree(path))), name


@pytest.mark.parametrize("name", MODULES)
def test_only_the_command_line_prints_or_touches_the_disk(name: str) -> None:
    calls = {"print", "open", "input"}
    methods = {"write_text", "write_bytes", "read_text", "read_bytes", "mkdir", "unlink", "replace", "savefig", "write"}
    allowed = MAY_TOUCH_THE_DISK.get(name, set())
    for node in ast.walk(tree(MODULES[name])):
        if not isinstance(node, ast.Call):
            continue
        called = node.func
        if isinstance(called, ast.Name):
            assert called.id not in calls - allowed, f"{name}:{node.lineno} calls {called.id}"
        elif isinstance(called, ast.Attribute) and called.attr in methods and "open" not in allowed:
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
    hidden = re.compile(r"/(\.(?!ci)[^/]*|results|build|dist|__pycache__|[^/]*\.egg-info)/")
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

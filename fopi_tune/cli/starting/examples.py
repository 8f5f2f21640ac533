"""The examples that ship:  a name -> its file and those that it names, as they lie in the project's folders.

An installation has `specs`, `systems` and `studies` in the package's folder `examples`; in a clone of the repository,
also one that is installed editable, they are where they are written, beside the package.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path, PurePosixPath
from typing import Any

from fopi_tune.cli.output import Exit, bad_input, print_out, say
from fopi_tune.results.saved.writing import obstacle, write_file

#: folder of the examples -> the command that is tried first with what is in it
_COMMANDS = {"specs": "run", "systems": "simulate", "studies": "study"}
#: a file that an example names ends so
_ENDINGS = (".yaml", ".csv")
_MOST_BYTES = 16 * 1024 * 1024


@dataclass(frozen=True)
class Example:
    """A spec, system or study that ships.

    Args:
        name: as its file says.
        path: from the folder of all examples, with "/".
        description: one line, as its file says.
    """

    name: str
    path: str
    description: str

    @property
    def command(self) -> str:
        """What to try first."""
        kind = self.path.partition("/")[0]
        # plants and controllers of systems lie beside them, and are specs
        return f"fopi {_COMMANDS[kind] if kind != 'systems' or _is_system(self.path) else 'run'} {self.path}"


def examples() -> dict[str, Example]:
    """All examples by name, as the folders have them in order."""
    found: dict[str, Example] = {}
    root = _root()
    for folder in _COMMANDS:
        for path in sorted((root / folder).rglob("*.yaml")):
            inside = path.relative_to(root).as_posix()
            document = _document(inside)
            found[document["name"]] = Example(document["name"], inside, document.get("description", ""))
    return found


def files_of_example(example: Example) -> dict[str, bytes]:
    """The example's file and all that it names, directly or through others, by their paths; its own is the last."""
    found: dict[str, bytes] = {}

    def add(path: str) -> None:
        if path in found:
            return
        found[path] = _bytes(path)
        for text in _texts(_document(path)) if path.endswith(".yaml") else ():
            beside = _beside(path, text)
            if beside is not None:
                add(beside)

    add(example.path)
    return {**{path: data for path, data in found.items() if path != example.path}, example.path: found[example.path]}


def list_examples() -> Exit:
    """Print a line for each example."""
    return print_out(_lines())


def write_example(name: str, force: bool) -> None:
    """Write an example and what it names into the current folder.

    Args:
        name: of the example.
        force: overwrite files that differ.

    Raises:
        typer.Exit: there is no such example, a file is in the way or cannot be written.
    """
    from fopi_tune.spec.yaml.hints import closest
    from fopi_tune.spec.yaml.problems import quoted

    known = examples()
    if name not in known:
        for line in _lines().splitlines():
            say(line)
        meant = closest(name, known)
        advice = f"did you mean {meant}?" if meant else "give one of the names above"
        raise bad_input(f"there is no example {quoted(name)}; {advice}")
    example = known[name]
    wanted = files_of_example(example)
    for path, content in wanted.items():
        if not force and os.path.lexists(path) and not _holds(path, content):
            raise bad_input(f"{path} exists already and is another file; go to another folder, or overwrite by --force")
    for path, content in wanted.items():
        try:
            write_file(Path(path), content)
        except OSError as error:
            raise bad_input(f"cannot write {path} ({obstacle(Path(path), error)}); go to another folder") from None
        say(f"wrote {path}")
    say(f"next: {example.command}")


def _lines() -> str:
    known = examples().values()
    width = max(len(example.name) for example in known)
    return "\n".join(f"{example.name:<{width}}  {example.description}" for example in known)


def _holds(path: str, content: bytes) -> bool:
    from fopi_tune.spec.files import read_bytes

    try:
        return read_bytes(path, len(content)) == content
    except OSError:
        return False


@cache
def _root() -> Path:
    """The folder that has `specs`, `systems` and `studies`."""
    package = Path(str(files("fopi_tune")))
    for folder in (package / "examples", package.parent):
        if all((folder / name).is_dir() for name in _COMMANDS):
            return folder
    raise bad_input(f"the examples are not there, neither in {package} nor beside it; install fopi-tune again")


def _bytes(path: str) -> bytes:
    from fopi_tune.spec.files import read_bytes

    return read_bytes(_root() / path, _MOST_BYTES)


@cache
def _document(path: str) -> dict[str, Any]:
    from ruamel.yaml import YAML

    return YAML(typ="safe", pure=True).load(_bytes(path))


def _is_system(path: str) -> bool:
    return "system" in _document(path)


def _texts(value: object) -> Iterator[str]:
    """All texts in a document."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for inner in value.values():
            yield from _texts(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _texts(inner)


def _beside(path: str, text: str) -> str | None:
    """The path of the file that a text in a file names as seen from there; None where it names none."""
    if not text.endswith(_ENDINGS):
        return None
    joined = os.path.normpath(PurePosixPath(path).parent / text).replace(os.sep, "/")
    return joined if not joined.startswith("..") and (_root() / joined).is_file() else None

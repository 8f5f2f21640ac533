"""Blocks of code in Markdown pages, run as a reader would:  in order, in one folder, with what is printed compared.

```sh, ```python         run, one after the other
```text                  what the block before it printed; a line "…" stands for any lines, "…" in a line for its rest
```yaml                  a whole spec, system or study
```{code-block} LANG     with a `:caption: FILE`: the reader's file of that name
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cases.project import IMPORTED, ROOT
from ruamel.yaml import YAML
from typer.main import get_command

from fopi_tune.cli import app
from fopi_tune.spec import load_any
from fopi_tune.study.load import load_study

INSTALL = "python3 -m venv .venv && .venv/bin/pip install -q -c constraints.txt "
_BLOCK = re.compile(r"^```(\{code-block\} )?(\w+)\n(?::caption: (\S+)\n\n)?(.*?)^```$", re.DOTALL | re.MULTILINE)
_ANY = "…"


@dataclass(frozen=True)
class Block:
    """One fenced block.

    Args:
        language: the word behind the fence.
        text: what is in it.
        line: of the fence, from 1.
        file: what the reader calls it, empty where it is no file.
    """

    language: str
    text: str
    line: int
    file: str = ""


def blocks_of(page: str) -> list[Block]:
    """Every fenced block of a page, but for those of the page's own machinery (tables of contents, raw HTML)."""
    found = []
    for match in _BLOCK.finditer(page):
        directive, language, file, text = match.groups()
        assert bool(directive) == bool(file), f"a file without a name: {match[0][:80]}"
        found.append(Block(language, text, page.count("\n", 0, match.start()) + 1, file or ""))
    return found


def looks_like(printed: str, shown: str) -> bool:
    """Whether what was printed is what a page shows, up to what the page leaves out."""
    lines = (
        r"(?:.*\n)*?" if line == _ANY else ".*".join(map(re.escape, line.split(_ANY))) + r"\n"
        for line in shown.splitlines()
    )
    return re.fullmatch("".join(lines), printed.rstrip("\n") + "\n") is not None


def load(path: Path) -> object:
    """What a YAML file of a page says, by whatever reads such files: a spec, a system or a study.

    Raises:
        SpecError: it has mistakes.
    """
    document = YAML(typ="safe").load(path)
    is_study = any(key in document for key in ("specs", "claims", "figures"))
    return load_study(path) if is_study else load_any(path)


def copy_the_clone(folder: Path) -> None:
    """What a page's commands find in a clone of the repository."""
    for name in ("specs", "systems", "studies"):
        shutil.copytree(ROOT / name, folder / name)


def run_page(blocks: Sequence[Block], folder: Path) -> list[tuple[Block, str]]:
    """Runs a page's commands and programs in one shell, as its reader would.

    Returns:
        Each block that was run, with what it printed.  An installation is not run: `.ci/run` does that.

    Raises:
        AssertionError: a block ended with another exit code than 0.
    """
    # what runs in the background ends with the page
    script = ["set -euo pipefail", "trap 'jobs -p | xargs -r kill' EXIT"]
    ran: list[tuple[Block, Path]] = []
    for number, block in enumerate(blocks):
        if block.file:
            (folder / block.file).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            name = f"block_{number}.py"
            (folder / name).write_text(block.text, encoding="utf-8")
            script += [f"{{ python -W error {name}; }} >block_{number}.out"]
            ran.append((block, folder / f"block_{number}.out"))
        elif block.language == "sh" and not block.text.startswith(INSTALL):
            # not in a subshell: what is started in the background can be stopped by a later block
            script += [f"{{\n{block.text}}} >block_{number}.out"]
            ran.append((block, folder / f"block_{number}.out"))
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(IMPORTED), "PYTHONSAFEPATH": "1", "COLUMNS": "80"}
    done = subprocess.run(
        ["bash", "-m", "-c", "\n".join(script)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, f"{done.stdout}{done.stderr}"
    return [(block, path.read_text(encoding="utf-8")) for block, path in ran]


def unknown_words(page: str) -> list[str]:
    """Commands and options that a page's sentences name in `code` and that `fopi` does not have."""
    whole = get_command(app)
    commands = {name: _options(command) for name, command in whole.commands.items()}  # type: ignore[attr-defined]
    every = {option for options in commands.values() for option in options} | _options(whole)
    wrong = []
    for code in re.findall(r"(?<!`)`([^`\n]+)`(?!`)", _BLOCK.sub("", page)):
        words = code.split()
        if words[0] == "fopi" and len(words) > 1:
            options = commands.get(words[1], set())
            wrong += [code] if words[1] not in commands or not _named(words) <= options else []
        elif words[0].startswith("--"):
            wrong += [code] if not _named(words) <= every else []
    return wrong


def _named(words: Sequence[str]) -> set[str]:
    return {word for word in words if word.startswith("-")}


def _options(command: object) -> set[str]:
    return {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)} | {"--help"}  # type: ignore[attr-defined]

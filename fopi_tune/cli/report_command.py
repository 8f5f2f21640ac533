"""`fopi report`:  the reports of specs made again from what `fopi run` left, or several designs on one page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fopi_tune.cli.batch import OutputOptions, load_specs, write_files
from fopi_tune.cli.output import Exit, print_out, report_failure, say
from fopi_tune.cli.result_files import CHECK, COMPARISON_FOLDER, COMPARISON_PAGE, DESIGN, REPORT, SPEC
from fopi_tune.errors import DomainError, SpecError

if TYPE_CHECKING:
    from fopi_tune.spec.model import DesignSpec
from fopi_tune.cli.report_files import comparison_of, report_from_folder


def remake_reports(files: Sequence[str], handling: OutputOptions) -> Exit:
    """Make the report of every spec again, print where it is, and end with the worst of the exit codes.

    Args:
        files: specs, or folders of results with the specs they are of.
        handling: where results are, and what to say.
    """

    folders: dict[str, Path] = {}

    def load(file: str) -> DesignSpec:
        from fopi_tune.spec import load_spec

        if not os.path.isdir(file):
            return load_spec(file)
        spec = load_spec(Path(file, SPEC))
        folders[spec.name] = Path(file)
        return spec

    specs, code = load_specs(files, load, handling)
    for spec in specs:
        handling.note(f"{spec.name}: reporting ...")
        folder = folders.get(spec.name) if handling.out is None else None
        code = max(code, _one(spec, folder or handling.folder(spec), handling))
    return code


def _one(spec: DesignSpec, folder: Path, handling: OutputOptions) -> Exit:
    try:
        made = report_from_folder(spec, folder)
    except DomainError as error:
        say(f"{spec.name}: {error}")
        return Exit.BAD_INPUT
    except Exception as error:
        return report_failure(spec.name, error, handling.debug)
    code = write_files(folder, list(made.items()), spec.name, handling)
    return code if code is not Exit.MET else print_out(folder / REPORT)


#: designs on a page
_LEAST, _MOST = 2, 6


def compare_results(sources: Sequence[str], handling: OutputOptions) -> Exit:
    """Put designs side by side on one page and print where it is.

    Args:
        sources: folders of results with their specs, files of results in such folders, or specs with results.
        handling: where the page goes, and what to say.
    """
    if not _LEAST <= len(sources) <= _MOST:
        say(f"--compare takes {_LEAST} to {_MOST} designs, not {len(sources)}; name their folders of results")
        return Exit.BAD_INPUT
    try:
        named = [found for source in sources if (found := _located(source, handling)) is not None]
        if len(named) < len(sources):
            return Exit.BAD_INPUT
        handling.note(f"comparing {len(named)} designs ...")
        made = comparison_of(named)
    except DomainError as error:
        say(str(error))
        return Exit.BAD_INPUT
    except Exception as error:
        return report_failure("compare", error, handling.debug)
    folder = Path("results", COMPARISON_FOLDER) if handling.out is None else Path(handling.out)
    code = write_files(folder, list(made.items()), COMPARISON_FOLDER, handling)
    return code if code is not Exit.MET else print_out(folder / COMPARISON_PAGE)


def _located(source: str, handling: OutputOptions) -> tuple[str, DesignSpec, Path, str] | None:
    """The name as given, the spec, the folder of its results and the file of its gains; None after saying why not."""
    from fopi_tune.spec import load_spec

    path = Path(source)
    is_result = path.name in (DESIGN, CHECK)
    try:
        if is_result or os.path.isdir(source):
            folder = path.parent if is_result else path
            spec = load_spec(folder / SPEC)
        else:
            spec = load_spec(source)
            folder = Path("results", spec.name)
    except SpecError as error:
        for problem in error.problems:
            say(str(problem))
        return None
    if is_result:
        return source, spec, folder, path.name
    both = (folder / DESIGN).exists() and (folder / CHECK).exists()
    if both:
        handling.note(f"{source}: of the design; {folder / CHECK} is there too, name it to compare its gains")
    return source, spec, folder, CHECK if (folder / CHECK).exists() and not both else DESIGN

"""The command `fopi report`:  reports made again from results in folders, or a page that compares several designs."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fopi_tune.cli.batch import OutputOptions, load_specs, write_files
from fopi_tune.cli.output import Exit, print_out, report_failure, say
from fopi_tune.cli.report_files import comparison_of, report_from_folder, system_report_from_folder
from fopi_tune.errors import DomainError, SpecError
from fopi_tune.results.saved.names import (
    CHECK,
    COMPARISON_FOLDER,
    COMPARISON_PAGE,
    DESIGN,
    REPORT,
    SPEC,
    SYSTEM_CERTIFICATE,
    SYSTEM_REPORT,
)

if TYPE_CHECKING:
    from fopi_tune.spec.model import DesignSpec, SystemSpec


def remake_reports(files: Sequence[str], options: OutputOptions) -> Exit:
    """Make the report of every spec again and print its path; returns the worst exit code.

    Args:
        files: specs or systems, or folders of results with the specs they are of.
        options: where results are, and what is printed.
    """

    folders: dict[str, Path] = {}

    def load(file: str) -> DesignSpec | SystemSpec:
        from fopi_tune.spec import load_any, load_spec

        if not os.path.isdir(file):
            return load_any(file)
        spec = load_spec(Path(file, SPEC))
        folders[spec.name] = Path(file)
        return spec

    proved = [file for file in files if _holds_system(file)]
    specs, code = load_specs([file for file in files if file not in proved], load, options)
    for file in proved:
        code = max(code, _remake_one(None, Path(file), options))
    for spec in specs:
        options.note(f"{spec.name}: reporting ...")
        folder = folders.get(spec.name) if options.out is None else None
        code = max(code, _remake_one(spec, folder or options.folder(spec), options))
    return code


def _holds_system(file: str) -> bool:
    """Whether a folder has the certificate of a system and no spec."""
    return os.path.isfile(Path(file, SYSTEM_CERTIFICATE)) and not os.path.exists(Path(file, SPEC))


def _remake_one(spec: DesignSpec | SystemSpec | None, folder: Path, options: OutputOptions) -> Exit:
    from fopi_tune.spec.model import DesignSpec

    name = str(folder) if spec is None else spec.name
    try:
        if isinstance(spec, DesignSpec):
            made, page = report_from_folder(spec, folder), REPORT
        else:
            made, page = system_report_from_folder(folder, spec), SYSTEM_REPORT
    except DomainError as error:
        say(f"{name}: {error}")
        return Exit.BAD_INPUT
    except Exception as error:
        return report_failure(name, error, options.debug)
    for why in made.left_out:
        say(f"{name}: {why}")
    written_to = folder if spec is not None or options.out is None else Path(options.out)
    code = write_files(written_to, list(made.files.items()), name, options)
    return code if code is not Exit.MET else print_out(written_to / page)


#: fewest and most designs on a page
_FEWEST, _MOST = 2, 6


def compare_results(sources: Sequence[str], options: OutputOptions) -> Exit:
    """Compare designs on one page and print its path.

    Args:
        sources: folders of results with their specs, files of results in such folders, or specs with results.
        options: where the page goes, and what is printed.
    """
    if not _FEWEST <= len(sources) <= _MOST:
        say(f"--compare takes {_FEWEST} to {_MOST} designs, not {len(sources)}; name their folders of results")
        return Exit.BAD_INPUT
    try:
        named = [found for source in sources if (found := _locate_results(source, options)) is not None]
        if len(named) < len(sources):
            return Exit.BAD_INPUT
        options.note(f"comparing {len(named)} designs ...")
        made = comparison_of(named)
    except DomainError as error:
        say(str(error))
        return Exit.BAD_INPUT
    except Exception as error:
        return report_failure("compare", error, options.debug)
    folder = Path("results", COMPARISON_FOLDER) if options.out is None else Path(options.out)
    for why in made.left_out:
        say(why)
    code = write_files(folder, list(made.files.items()), COMPARISON_FOLDER, options)
    return code if code is not Exit.MET else print_out(folder / COMPARISON_PAGE)


def _locate_results(source: str, options: OutputOptions) -> tuple[str, DesignSpec, Path, str] | None:
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
        options.note(f"{source}: of the design; {folder / CHECK} is there too, name it to compare its gains")
    return source, spec, folder, CHECK if (folder / CHECK).exists() and not both else DESIGN

"""`fopi study`:  a study file, run on all cores or on a cluster, into a folder that can be resumed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Annotated

import typer

from fopi_tune.cli.output import Exit, bad_input, print_out, print_styled, report_failure, say
from fopi_tune.cli.progress import ProgressStyle, progress_display
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError, FopiError, SpecError
from fopi_tune.results.saved.writing import obstacle, to_json, write_file

# Solvers and Dask are imported where they are needed, so that errors in a study are reported quickly.
if TYPE_CHECKING:
    from fopi_tune.study import Machines, StudyResult
    from fopi_tune.study.model import Study
    from fopi_tune.study.table import StudyTable

TABLE, PARQUET = "table.csv", "table.parquet"
_MOST_FAILURES = 20
#: the shell's exit code of an interrupted process
_INTERRUPTED = 130


@dataclass(frozen=True)
class _StudyOptions:
    """Options of `fopi study` about its results."""

    out: str | None
    parquet: bool
    as_json: bool
    quiet: bool
    progress: ProgressStyle
    resume: bool
    retry_failed: bool
    only_failed: bool
    debug: bool

    def folder(self, study: Study) -> Path:
        """The folder of the ledger and the tables."""
        return Path("results", study.name) if self.out is None else Path(self.out)

    def note(self, message: str) -> None:
        """Print a note on stderr, unless --quiet is given; with JSON lines there, only progress is printed."""
        if not self.quiet and self.progress is not ProgressStyle.JSONL:
            say(message)


def study(
    file: Annotated[str | None, typer.Argument(metavar="[STUDY]", help="Study file.")] = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Processes to start; 0: run in this one. Default: one a core.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Run on this Dask scheduler's workers, as tcp://host:8786.")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List the cells and stop.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Run more cells than the study's limit_cells.")] = False,
    status: Annotated[
        str | None, typer.Option(metavar="DIR", help="Say how far the study in this folder is, and stop.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on, and refuse where there is nothing yet; going on is the default.")
    ] = False,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Run cells again that failed.")] = False,
    only_failed: Annotated[
        bool, typer.Option("--only-failed", help="Print the rows of failed cells alone; files have all rows.")
    ] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="Write the table as Parquet, too; needs pyarrow.")] = False,
    progress: Annotated[
        ProgressStyle, typer.Option(help="What is shown on stderr while cells run.")
    ] = ProgressStyle.AUTO,
    out: Annotated[str | None, typer.Option(metavar="DIR", help="Folder, instead of results/NAME.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON on stdout.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No notes on stderr.")] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback when the tool itself fails.")] = False,
) -> None:
    """Run many specs, on all cores or on a cluster.

    A study file says which: a grid or a list of overrides of specs.

    What is done is kept in DIR/ledger.sqlite: the same command goes on where it was stopped, and runs only cells that
    have changed.  Ends with 0 when every cell has an answer (infeasible is one), 3 when some failed or are undecided.
    """
    if status is not None:
        raise typer.Exit(_print_status(status, as_json))
    if file is None:
        raise bad_input("there is no STUDY to run; name a study file, or a folder with --status")
    if workers is not None and scheduler is not None:
        raise bad_input("--workers are of this machine, --scheduler has its own; leave one of them out")
    options = _StudyOptions(out, parquet, as_json, quiet, progress, resume, retry_failed, only_failed, debug)
    try:
        loaded = _load_study(file, force, options)
        if dry_run:
            raise typer.Exit(_list_cells(loaded, options))
        from fopi_tune.study import Machines

        raise typer.Exit(_run_study(loaded, Machines(workers, scheduler), options))
    except SpecError as error:
        for problem in error.problems:
            say(str(problem))
        raise typer.Exit(Exit.BAD_INPUT) from None
    except DomainError as error:
        raise bad_input(str(error)) from None
    except FopiError as error:
        say(str(error))
        raise typer.Exit(Exit.TOOL_FAILED) from None
    except KeyboardInterrupt:
        say("stopped; what was done is kept: run the same command again to go on")
        raise typer.Exit(_INTERRUPTED) from None
    except typer.Exit:
        raise
    except Exception as error:
        raise typer.Exit(report_failure(file, error, debug)) from None


def _load_study(file: str, force: bool, options: _StudyOptions) -> Study:
    from fopi_tune.study.load import load_study

    return load_study(file, force, told=lambda count: options.note(f"{file}: {counted(count, 'cell')}"))


def _list_cells(loaded: Study, options: _StudyOptions) -> Exit:
    """Print every cell on a line."""
    if options.as_json:
        cells = [{"cell": c.index + 1, c.kind.value: c.name, "overrides": dict(c.overrides)} for c in loaded.cells]
        return print_out(to_json({"schema": 1, "name": loaded.name, "cells": cells}))
    return print_out("\n".join(f"{cell.index + 1}  {cell.label}" for cell in loaded.cells))


def _run_study(loaded: Study, machines: Machines, options: _StudyOptions) -> Exit:
    from fopi_tune.study import run
    from fopi_tune.study.table import require_parquet

    if options.parquet:
        require_parquet()
    folder = options.folder(loaded)
    with progress_display(options.progress, options.quiet) as told:
        result = run(
            loaded,
            folder,
            machines,
            retry_failed=options.retry_failed,
            resume=options.resume,
            told=told,
            say=options.note,
        )
    code = max(_write_files(result, folder, options), _write_page(result, folder, options))
    _print_failures(result, options)
    shown = replace(result, table=result.table.only_failed()) if options.only_failed else result
    if options.as_json:
        code = max(code, print_out(to_json(_document(shown))))
    else:
        from fopi_tune.report import study_text

        code = max(code, print_styled(study_text(shown, str(folder / TABLE))))
    decided = not result.counts.failed and not result.table.undecided
    return max(code, Exit.MET if decided else Exit.TOOL_FAILED)


def _write_files(result: StudyResult, folder: Path, options: _StudyOptions) -> Exit:
    from fopi_tune.study.best import BEST_YAML

    files: dict[str, str | bytes] = {TABLE: result.table.to_csv()}
    if options.parquet:
        files[PARQUET] = result.table.to_parquet()
    # names of a registry are used as file names
    files |= {PurePosixPath(name).name: text for name, text in result.table.files.items()}
    for name, content in files.items():
        try:
            write_file(folder / name, content)
        except OSError as error:
            say(f"cannot write {folder / name} ({obstacle(folder / name, error)}); choose another folder with --out")
            return Exit.BAD_INPUT
        options.note(f"{result.study.name}: wrote {folder / name}")
    if result.table.best is not None and BEST_YAML not in files and (folder / BEST_YAML).exists():
        say(f"{result.study.name}: {BEST_YAML} in {folder} is of an earlier result, not of this one")
    return Exit.MET


def _write_page(result: StudyResult, folder: Path, options: _StudyOptions) -> Exit:
    """Write the page of the study and its figures; what was computed is kept even if that fails."""
    from fopi_tune.report.study_page import STUDY_REPORT, study_page_files

    path = folder / STUDY_REPORT
    try:
        files = study_page_files(result)
        if not files and path.exists():
            say(f"{result.study.name}: {STUDY_REPORT} in {folder} is of an earlier result, not of this one")
        for name, content in files.items():
            path = folder / name
            write_file(path, content)
            if name == STUDY_REPORT:
                options.note(f"{result.study.name}: wrote {path}")
    except OSError as error:
        say(f"cannot write {path} ({obstacle(path, error)}); choose another folder with --out")
        return Exit.BAD_INPUT
    except Exception as error:
        return report_failure(f"{result.study.name}: report", error, options.debug)
    return Exit.MET


def _print_failures(result: StudyResult, options: _StudyOptions) -> None:
    """Print failed cells with their reasons, and columns that are empty."""
    for index, label, reason in result.failures[:_MOST_FAILURES]:
        say(f"cell {index + 1} ({label}) failed: {reason}")
    if len(result.failures) > _MOST_FAILURES:
        say(f"{counted(len(result.failures) - _MOST_FAILURES, 'more cell')} failed; the table has the reasons")
    if len(result.failures) == result.counts.total:
        return  # columns are empty for that reason
    for name in result.table.empty:
        options.note(f"column {name} is empty in every row; is its path right?")


def _document(result: StudyResult) -> dict[str, object]:
    counts = result.counts
    return {
        "schema": 1,
        "name": result.study.name,
        "cells": {"total": counts.total, "done": counts.done, "failed": counts.failed},
        "undecided": result.table.undecided,
        **_best(result.table),
        "rows": result.table.to_dicts(),
    }


def _best(table: StudyTable) -> dict[str, object]:
    """The best cell, in a study that asks for one."""
    best = table.best
    if best is None:
        return {}
    cell = None if best.index is None else best.index + 1
    return {"best": {"cell": cell, "value": best.value, "message": best.message}}


def _print_status(folder: str, as_json: bool) -> Exit:
    """Print the progress that a ledger holds; returns 0 when all is done, 1 when cells are left, 3 when some failed."""
    from fopi_tune.study.ledger import read_ledger

    try:
        with read_ledger(Path(folder)) as ledger:
            progress, name, seconds = ledger.progress(), ledger.name, ledger.seconds()
    except DomainError as error:
        raise bad_input(str(error)) from None
    counts, failures = progress.counts, progress.failures
    code = Exit.TOOL_FAILED if counts.failed else Exit.NOT_MET if counts.left else Exit.MET
    if as_json:
        failed = [{"cell": index + 1, "label": label, "reason": reason} for index, label, reason in failures]
        told = {"total": counts.total, "done": counts.done, "failed": counts.failed, "left": counts.left}
        damaged = [{"cell": index + 1, "label": label} for index, label in progress.damaged]
        document = {"schema": 1, "name": name, "cells": told, "cell_seconds": seconds, "failures": failed}
        document["damaged"] = damaged
        return max(code, print_out(to_json(document)))
    words = f"{name}: {counts.done} of {counted(counts.total, 'cell')} done, {counts.failed} failed, {counts.left} left"
    lines = [words, *(f"cell {index + 1} ({label}) failed: {reason}" for index, label, reason in failures)]
    again = "its result was damaged on the disk and counts as none; the study's command runs it again"
    lines += [f"cell {index + 1} ({label}): {again}" for index, label in progress.damaged]
    return max(code, print_out("\n".join(lines)))

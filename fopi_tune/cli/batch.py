"""Specs to results:  load each spec, compute, write and print its result, and end with the worst exit code."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from fopi_tune.cli.output import Exit, print_out, print_styled, report_failure, say, still_running_notes
from fopi_tune.cli.report_files import report_of_run
from fopi_tune.cli.result_files import files_of
from fopi_tune.core.text_tables.words import agreeing
from fopi_tune.errors import DomainError, SpecError, UnstableLoopError
from fopi_tune.results.saved.names import (
    CERTIFICATE,
    CHECK,
    CODE_FOLDER,
    CONTROLLER_FIGURE,
    DESIGN,
    DIGITAL,
    DIGITAL_CERTIFICATE,
    EXACT,
    FIGURES_FOLDER,
    OPTIMUM,
    REPORT,
    REPORT_FIGURES,
    SIMULATION,
    SYSTEM_FIGURES,
    SYSTEM_REPORT,
    TARGETS_FOLDER,
)
from fopi_tune.results.saved.writing import obstacle, to_json, write_file

# Solver, NumPy and Rich are imported where they are needed, so that errors in a spec are reported quickly.
if TYPE_CHECKING:
    from rich.text import Text

    from fopi_tune.cli.result_files import Result
    from fopi_tune.prices import Tradeoff
    from fopi_tune.results.design import Validated
    from fopi_tune.results.proved_system import ProvedSystem
    from fopi_tune.results.simulation import Simulated
    from fopi_tune.results.system import DiscretizedSystem, SimulatedSystem, ValidatedSystem
    from fopi_tune.results.system_design import DesignedSystem
    from fopi_tune.spec.model import DesignSpec, SystemSpec


#: a spec, or a spec or a system
Loaded = TypeVar("Loaded", "DesignSpec", "DesignSpec | SystemSpec")


@dataclass(frozen=True)
class OutputOptions:
    """Where results go, and what is printed."""

    out: str | None
    as_json: bool
    quiet: bool
    debug: bool
    several: bool = False
    #: whether what is only checked counts as undecided
    require_proof: bool = False
    #: of a result: names and contents that are written before its own
    further_files: Callable[[Result], Mapping[str, str | bytes]] | None = None

    def folder(self, spec: DesignSpec | SystemSpec) -> Path:
        """The folder of a spec's results."""
        if self.out is None:
            return Path("results", spec.name)
        return Path(self.out, spec.name) if self.several else Path(self.out)

    def note(self, message: str) -> None:
        """Print a note on stderr, unless --quiet is given."""
        if not self.quiet:
            say(message)


def process_specs(
    files: Sequence[str], compute: Callable[[DesignSpec], Result], options: OutputOptions, activity: str
) -> Exit:
    """Load every spec, then compute, write and print a result of each; returns the worst exit code."""

    def load(file: str) -> DesignSpec:
        from fopi_tune.spec import load_spec

        return load_spec(file)

    return _process(files, load, compute, options, activity)


def process_specs_or_systems(
    files: Sequence[str], compute: Callable[[DesignSpec | SystemSpec], Result], options: OutputOptions, activity: str
) -> Exit:
    """As `process_specs`, of files that hold a spec or a system."""

    def load(file: str) -> DesignSpec | SystemSpec:
        from fopi_tune.spec import load_any

        return load_any(file)

    return _process(files, load, compute, options, activity)


def _process(
    files: Sequence[str],
    load: Callable[[str], Loaded],
    compute: Callable[[Loaded], Result],
    options: OutputOptions,
    activity: str,
) -> Exit:
    """Load with a loader that may raise SpecError, compute, write and print; the worst exit code."""
    specs, code = load_specs(files, load, options)
    documents: list[dict[str, Any]] = []
    for spec in specs:
        options.note(f"{spec.name}: {activity} ...")
        with still_running_notes(f"{spec.name}: still {activity}", options.quiet) as stop_notes:
            code = max(code, _process_one(spec, compute, options, documents, stop_notes))
    if options.as_json and (documents or options.several):
        code = max(code, print_out(to_json(documents if options.several else documents[0])))
    return code


def load_specs(
    files: Sequence[str], load: Callable[[str], Loaded], options: OutputOptions
) -> tuple[list[Loaded], Exit]:
    """The valid specs; the problems of the others are printed."""
    code, specs = Exit.MET, dict[str, tuple[str, Loaded]]()
    for file in files:
        try:
            spec = load(file)
        except SpecError as error:
            for problem in error.problems:
                say(str(problem))
            code = max(code, Exit.BAD_INPUT)
            continue
        except Exception as error:
            code = max(code, report_failure(file, error, options.debug))
            continue
        # Folders are named after specs, and some file systems do not distinguish upper and lower case.
        other, _ = specs.setdefault(spec.name.casefold(), (file, spec))
        if specs[spec.name.casefold()][1] is not spec:
            say(f"{file}: {other} has the same name, {spec.name}; their results would overwrite each other")
            code = max(code, Exit.BAD_INPUT)
    return [spec for _, spec in specs.values()], code


def _process_one(
    spec: Loaded,
    compute: Callable[[Loaded], Result],
    options: OutputOptions,
    documents: list[dict[str, Any]],
    stop_notes: Callable[[], None],
) -> Exit:
    """Compute one result, write its files, and print it or add it to the documents."""
    start = time.perf_counter()
    try:
        result = compute(spec)
        document = result.to_dict()
        files = list(options.further_files(result).items() if options.further_files else ())
        files += files_of(result)
        table = None if options.as_json else _result_text(result)
    except UnstableLoopError as error:
        say(f"{spec.name}: violated, the loop is not stable: {error}")
        return Exit.NOT_MET
    except DomainError as error:
        say(f"{spec.name}: {error}")
        return Exit.BAD_INPUT
    except Exception as error:
        return report_failure(spec.name, error, options.debug)
    failed = Exit.MET
    try:
        files += report_of_run(result, options.folder(spec)).items()
    except Exception as error:  # the result is kept even if its report fails
        failed = report_failure(f"{spec.name}: report", error, options.debug)
    stop_notes()
    # with the report, for which "still running after 5 s" was said too
    options.note(f"{spec.name}: {result.status} after {time.perf_counter() - start:.1f} s")
    # The files are written before the table is printed, so that a closed stdout loses no result.
    problem = getattr(result, "problem", "")
    if problem:
        say(f"{spec.name}: {problem}")
    code = max(exit_code_of(result, options.require_proof), failed, Exit.BAD_INPUT if problem else Exit.MET)
    code = max(code, write_files(options.folder(spec), files, spec.name, options))
    if table is not None:
        if documents:
            print_out("")
        code = max(code, print_styled(table))
    documents.append(document)
    return code


def write_files(folder: Path, files: Sequence[tuple[str, str | bytes]], name: str, options: OutputOptions) -> Exit:
    """Write each file atomically, and note files in the folder that belong to an earlier result."""
    for file, content in files:
        path = folder / file
        try:
            write_file(path, content)
        except OSError as error:
            say(f"{name}: cannot write {path} ({obstacle(path, error)}); choose another folder with --out")
            return Exit.BAD_INPUT
        if path.parent == folder:
            options.note(f"{name}: wrote {path}")
    written = {file for file, _ in files}
    for inner in (CODE_FOLDER, TARGETS_FOLDER, FIGURES_FOLDER):
        if any(file.startswith(f"{inner}/") for file in written):
            options.note(f"{name}: wrote {folder / inner}")
    stale = [file for file in _obsolete_files(written) if (folder / file).exists()]
    if DIGITAL in written:  # in formats that were not asked for now
        found = (path.relative_to(folder).as_posix() for path in (folder / TARGETS_FOLDER).glob("*"))
        stale += sorted(set(found) - written)
    for kind in (SIMULATION, EXACT):
        if f"{kind}.json" in written:  # of scenarios that are not simulated now
            stale += sorted({path.name for path in folder.glob(f"{kind}_*.[cs][sv][vg]")} - written)
    if stale:
        are = agreeing(len(stale), "is", "are")
        say(f"{name}: {', '.join(stale)} in {folder} {are} of an earlier result, not of this one")
    return Exit.MET


def _obsolete_files(written: set[str]) -> list[str]:
    """Files that an earlier result of the same kind may have left and that were not written now."""
    digital = [DIGITAL, DIGITAL_CERTIFICATE, CONTROLLER_FIGURE, CODE_FOLDER, TARGETS_FOLDER]
    figures = (
        [f"{FIGURES_FOLDER}/{name}.{kind}" for name in REPORT_FIGURES for kind in ("svg", "png")]
        if REPORT in written
        else []
    )
    if SYSTEM_REPORT in written:
        figures = [f"{FIGURES_FOLDER}/{name}.{kind}" for name in SYSTEM_FIGURES for kind in ("svg", "png")]
    undrawn = [file for file in figures if file not in written]
    if DIGITAL in written:
        return undrawn + ([] if DIGITAL_CERTIFICATE in written else [DIGITAL_CERTIFICATE])
    if DESIGN in written:
        unwritten = [file for file in (CERTIFICATE, OPTIMUM, REPORT) if file not in written]
        return [*unwritten, *undrawn, *digital]
    return undrawn + ([CERTIFICATE] if CHECK in written and CERTIFICATE not in written else [])


def exit_code_of(result: Result, require_proof: bool) -> Exit:
    """The exit code of a result.

    Args:
        result: of a command.
        require_proof: whether what is only checked counts as undecided.
    """
    if result.status in ("solved", "met", "settles", "made"):
        if not require_proof:
            return Exit.MET
        from fopi_tune.results.system_design import DesignedSystem

        reports = getattr(getattr(result, "design", result), "measures", ())
        # of a system's design nothing is proved, nor of measured responses
        measured = getattr(getattr(result, "spec", None), "is_measured", False)
        checked = measured or isinstance(result, DesignedSystem) or any(r.verdict == "checked" for r in reports)
        return Exit.TOOL_FAILED if checked else Exit.MET
    return Exit.TOOL_FAILED if result.status in ("failed", "undecided", "contradiction") else Exit.NOT_MET


def _result_text(result: Result) -> Text:
    from fopi_tune.results.design import Check, Design, Discretized, Run

    if isinstance(result, Design | Check):
        from fopi_tune.report.text.design import check_text, design_text

        return design_text(result) if isinstance(result, Design) else check_text(result)
    if isinstance(result, Discretized | Run):
        from fopi_tune.report import design_text, digital_text

        if isinstance(result, Discretized):
            return digital_text(result)
        text = design_text(result.design)
        return text if result.digital is None else text.append("\n\n").append_text(digital_text(result.digital))
    return _other_text(result)


def _other_text(
    result: Validated | Simulated | Tradeoff | SimulatedSystem | ValidatedSystem | DesignedSystem | ProvedSystem
    | DiscretizedSystem,
) -> Text:  # fmt: skip
    """Of what is not about one design; its modules are loaded for it alone."""
    from fopi_tune.prices.result import Tradeoff
    from fopi_tune.report import (
        evidence_text,
        simulation_text,
        system_design_text,
        system_evidence_text,
        system_proof_text,
        tradeoff_text,
    )
    from fopi_tune.results.design import Validated
    from fopi_tune.results.proved_system import ProvedSystem
    from fopi_tune.results.system import DiscretizedSystem, ValidatedSystem
    from fopi_tune.results.system_design import DesignedSystem

    if isinstance(result, DiscretizedSystem):
        from fopi_tune.report.text.system_digital import system_digital_text

        return system_digital_text(result)
    if isinstance(result, ProvedSystem):
        return system_proof_text(result)
    if isinstance(result, DesignedSystem):
        return system_design_text(result)
    if isinstance(result, Tradeoff):
        return tradeoff_text(result)
    if isinstance(result, Validated):
        return evidence_text(result)
    if isinstance(result, ValidatedSystem):
        return system_evidence_text(result)
    return simulation_text(result)

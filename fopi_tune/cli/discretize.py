"""`fopi discretize`, of a spec's gains or of a system, and the formats it exports."""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from fopi_tune.cli.batch import OutputOptions, process_specs_or_systems
from fopi_tune.cli.gains import GivenGains, given_or_tuned_gains
from fopi_tune.cli.output import Exit, bad_input, made_in_a_folder
from fopi_tune.cli.simulations import gains_of_modes
from fopi_tune.core.controller import FoPi
from fopi_tune.errors import DomainError
from fopi_tune.results.saved.names import TARGETS_FOLDER

if TYPE_CHECKING:
    from fopi_tune.cli.result_files import Result
    from fopi_tune.digital import Export
    from fopi_tune.digital.targets import Target
    from fopi_tune.spec.model import DesignSpec, SystemSpec

ExportOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="FORMAT",
        help="Beside C, in `targets/`: fmu (FMI 3.0, with sources), cmsis (CMSIS-DSP), st (structured text of"
        " IEC 61131-3). May be repeated.",
    ),
]
_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-s")
_LONGEST_S = 60.0


def discretize_file(
    file: str, given: GivenGains, proof: bool, options: OutputOptions, words: Sequence[str] = ()
) -> Exit:
    """Make a spec's digital controller and prove its loop, or those of a system; write and print the result.

    Args:
        file: of the spec or system.
        given: gains of a spec's controller.
        proof: of a spec's requirements for the loop on samples; of a system nothing is proved.
        options: where results go.
        words: formats to export beside C.

    Raises:
        Exit: a word that is no format.
    """
    targets = _targets(words)

    def compute(loaded: DesignSpec | SystemSpec) -> Result:
        from fopi_tune.pipeline.discretize import discretize, discretize_system
        from fopi_tune.spec.model import SystemSpec

        if isinstance(loaded, SystemSpec):
            if targets:
                raise DomainError("--export is of one controller; a system is exported as C alone, without the option")
            return discretize_system(loaded, gains_of_modes(loaded, given, options))
        gains = given_or_tuned_gains(loaded, given, options)
        return gains if not isinstance(gains, FoPi) else discretize(loaded, gains, proof)

    def further(result: Result) -> Mapping[str, str | bytes]:
        return target_files(result, targets, options)

    return process_specs_or_systems([file], compute, replace(options, further_files=further), "discretizing")


def target_files(result: Result, targets: Sequence[Target], options: OutputOptions) -> dict[str, str | bytes]:
    """The files of a digital controller in other formats than C, by their names in the folder of results.

    Args:
        result: of `discretize`; others have none.
        targets: the formats.
        options: whether notes are printed.

    Raises:
        DomainError: the controller cannot be exported so.
    """
    from fopi_tune.results.design import Discretized

    found: dict[str, str | bytes] = {}
    if not targets or not isinstance(result, Discretized):
        return found
    from fopi_tune.digital import Export
    from fopi_tune.digital.targets import Target, export_target

    export = Export.of(result.spec, result.controller)
    for target in targets:
        made = _compiled_fmu(export, options) if target is Target.FMU else export_target(export, target)
        found |= {f"{TARGETS_FOLDER}/{name}": content for name, content in made.items()}
    return found


def _targets(words: Sequence[str]) -> tuple[Target, ...]:
    if not words:
        return ()
    from fopi_tune.digital.targets import Target

    known = {target.value: target for target in Target}
    for word in words:
        if word not in known:
            raise bad_input(f"--export {word}: there are {', '.join(known)}")
    return tuple(dict.fromkeys(known[word] for word in words))


def _compiled_fmu(export: Export, options: OutputOptions) -> dict[str, str | bytes]:
    """The FMU with a binary of this machine, if that is x86-64 Linux with a C compiler; with sources alone if not."""
    from fopi_tune.digital.targets.fmu import fmu_files, model_identifier, packed

    files, name = fmu_files(export), f"{model_identifier(export)}.so"
    compiler = next((path for path in map(shutil.which, ("cc", "gcc", "clang")) if path), None)
    if (sys.platform, platform.machine()) != ("linux", "x86_64") or compiler is None:
        why = "it is compiled on x86-64 Linux alone" if compiler else "no C compiler is found"
        options.note(f"{export.name}.fmu has sources and no binary: {why}")
    else:
        sources = [file for file in sorted(files) if file.endswith(".c")]
        try:
            command = [compiler, *_FLAGS, "-o", name, *sources]
            files[f"binaries/x86_64-linux/{name}"] = made_in_a_folder(command, files, name, _LONGEST_S)
        except (OSError, subprocess.SubprocessError) as error:
            options.note(f"{export.name}.fmu has sources and no binary: {compiler} failed ({type(error).__name__})")
    return {f"{export.name}.fmu": packed(files)}

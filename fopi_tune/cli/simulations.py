"""`fopi simulate` and `fopi validate`, of a spec or a system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from fopi_tune.cli.batch import OutputOptions, process_specs_or_systems
from fopi_tune.cli.gains import GivenGains, gains_of_document, gains_of_earlier_design, given_or_tuned_gains
from fopi_tune.cli.output import Exit, bad_input, progress_bar
from fopi_tune.core.controller import FoPi
from fopi_tune.errors import CertificateError, DomainError

if TYPE_CHECKING:
    from fopi_tune.cli.result_files import Result
    from fopi_tune.spec.model import DesignSpec, SystemSpec


@dataclass(frozen=True)
class SimulationOptions:
    """Options of `fopi simulate`: what is simulated.

    Args:
        scenario: name of the only one; None for all.
        plant: uncertain numbers by name.
        replay: index of a draw, instead.
        samples, seed: what that draw was made with, in place of the file's.
        exact: in continuous time.
        accuracy: of that, in the output's unit; None as it is.
        member: name of the plant of a list; None for the first.
    """

    scenario: str | None
    plant: Mapping[str, float]
    replay: int | None
    samples: int | None
    seed: int | None
    exact: bool
    accuracy: float | None = None
    member: str | None = None

    def refuse_contradictions(self) -> None:
        """Refuse options that belong to others, which are not there.

        Raises:
            Exit: bad input.
        """
        for option, given in (("--plant", bool(self.plant)), ("--member", self.member is not None)):
            if self.replay is not None and given:
                raise bad_input(f"--replay makes a plant again that was drawn; leave {option} out")
        if self.replay is None and self.samples is not None:
            raise bad_input(
                "--samples says of which draws --replay makes one again; give --replay, or leave --samples out"
            )
        if self.accuracy is not None and not self.exact:
            raise bad_input("--accuracy is of the loop in continuous time; give --exact too, or leave it out")


def parameters_from_options(pairs: Sequence[str]) -> dict[str, float]:
    """Plant parameters of --plant NAME=VALUE as a mapping."""
    from fopi_tune.spec.yaml.scalars import NotANumberError, parse_number  # --version reads no specs

    numbers: dict[str, float] = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not equals:
            raise bad_input(f"--plant {pair} is not NAME=VALUE, as in --plant time_constant_s=3.1")
        try:
            numbers[name] = parse_number(value.strip())
        except NotANumberError as error:
            raise bad_input(f"--plant {name}: {error}") from None
    return numbers


def validate_file(file: str, given: GivenGains, samples: int | None, seed: int | None, options: OutputOptions) -> Exit:
    """Run `fopi validate`: draw plants, simulate and evaluate them, write and print the result."""

    def compute(loaded: DesignSpec | SystemSpec) -> Result:
        from fopi_tune.pipeline.systems import validate_system
        from fopi_tune.pipeline.validate import validate
        from fopi_tune.spec.model import SystemSpec

        if isinstance(loaded, SystemSpec):
            gains = gains_of_modes(loaded, given, options)
            with progress_bar("loops", options.quiet) as progress:
                return validate_system(loaded, gains, samples=samples, seed=seed, progress=progress)
        found = given_or_tuned_gains(loaded, given, options)
        if not isinstance(found, FoPi):
            return found
        with progress_bar("loops", options.quiet) as progress:
            return validate(loaded, found, samples=samples, seed=seed, progress=progress)

    return process_specs_or_systems([file], compute, options, "validating")


def simulate_file(file: str, given: GivenGains, selection: SimulationOptions, options: OutputOptions) -> Exit:
    """Run `fopi simulate`: simulate one plant, or one of each mode, write and print the result."""

    def compute(loaded: DesignSpec | SystemSpec) -> Result:
        from fopi_tune.pipeline.simulate import refuse_simulation, simulate
        from fopi_tune.pipeline.systems import refuse_system_simulation, simulate_system
        from fopi_tune.spec.model import SystemSpec

        arguments: dict[str, Any] = {
            "scenario": selection.scenario,
            "plant": selection.plant,
            "replay": selection.replay,
            "samples": selection.samples,
            "seed": selection.seed,
            "exact": selection.exact,
            "accuracy": selection.accuracy,
        }
        if isinstance(loaded, SystemSpec):
            if selection.member is not None:
                raise DomainError("--member names a plant of a spec's list; a system has none")
            refuse_system_simulation(loaded, **arguments)
            return simulate_system(loaded, gains_of_modes(loaded, given, options), **arguments)
        arguments["member"] = selection.member
        refuse_simulation(loaded, **arguments)
        found = given_or_tuned_gains(loaded, given, options)
        return found if not isinstance(found, FoPi) else simulate(loaded, found, **arguments)

    return process_specs_or_systems([file], compute, options, "simulating")


def _gains_of_system_design(system: SystemSpec, options: OutputOptions) -> dict[str, FoPi]:
    """The gains of a solved design of the same system in the default folder of results; none without one."""
    from fopi_tune.results.saved.names import SYSTEM_DESIGN
    from fopi_tune.spec.files import read_json

    wanted = [mode.name for mode in system.modes if mode.name in system.tuned and mode.gains is None]
    if not wanted:
        return {}
    path = replace(options, out=None, several=False).folder(system) / SYSTEM_DESIGN
    try:
        document = read_json(path)
        if document["status"] != "solved" or document["stamp"]["spec_sha256"] != system.sha256:
            raise KeyError
        found = {name: gains_of_document(document["gains"][name]) for name in wanted}
    except (OSError, DomainError, CertificateError, KeyError, TypeError):
        options.note(f"{system.name}: no design of this system there; tuning first ...")
        return {}
    options.note(f"{system.name}: gains from {path}")
    return found


def gains_of_modes(system: SystemSpec, given: GivenGains, options: OutputOptions) -> dict[str, FoPi]:
    """Gains of earlier designs for modes without gains in the system; modes without such a design are tuned later."""
    if given:
        raise DomainError("this is a system; its modes' gains belong into its file: MODE: {spec: ..., gains: ...}")
    found = _gains_of_system_design(system, options)
    for mode in system.modes:
        if mode.name in system.tuned:
            continue
        if mode.gains is None:
            # the default folder of `fopi tune`
            gains = gains_of_earlier_design(mode.spec, replace(options, out=None, several=False))
            if gains is not None:
                found[mode.name] = gains
            else:
                options.note(f"{mode.name}: no gains given, and no design of {mode.spec.name} there; tuning ...")
    return found

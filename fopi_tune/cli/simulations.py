"""`fopi simulate` and `fopi validate`:  a spec or a system, driven."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from fopi_tune.cli.batch import OutputOptions, process_with_loader
from fopi_tune.cli.gains import earlier_or_tuned_gains, gains_of_earlier_design
from fopi_tune.cli.output import Exit, bad_input, progress_bar
from fopi_tune.core.controller import FoPi
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    from fopi_tune.cli.result_files import Result
    from fopi_tune.spec.model import DesignSpec, SystemSpec


@dataclass(frozen=True)
class SimulationOptions:
    """What of a spec or a system is simulated.

    Args:
        scenario: name of the only one; None for all.
        plant: uncertain numbers by name.
        replay: index of a draw, instead.
        samples, seed: what that draw was made with, in place of the file's.
        exact: in continuous time.
    """

    scenario: str | None
    plant: Mapping[str, float]
    replay: int | None
    samples: int | None
    seed: int | None
    exact: bool


def parameters_from_options(pairs: Sequence[str]) -> dict[str, float]:
    """NAME=VALUE as a mapping."""
    numbers: dict[str, float] = {}
    for pair in pairs:
        name, _, value = pair.partition("=")
        try:
            numbers[name] = float(value)
        except ValueError:
            raise bad_input(f"--plant {pair} is not NAME=VALUE, as in --plant time_constant_s=3.1") from None
    return numbers


def validate_file(
    file: str, given: FoPi | None, samples: int | None, seed: int | None, handling: OutputOptions
) -> Exit:
    """Draw plants, judge and report."""

    def make(loaded: DesignSpec | SystemSpec) -> Result:
        from fopi_tune.pipeline.systems import validate_system
        from fopi_tune.pipeline.validate import validate
        from fopi_tune.spec.model import SystemSpec

        if isinstance(loaded, SystemSpec):
            gains = _gains_of_modes(loaded, given, handling)
            with progress_bar("loops", handling.quiet) as progress:
                return validate_system(loaded, gains, samples=samples, seed=seed, progress=progress)
        found = given if given is not None else earlier_or_tuned_gains(loaded, handling)
        if not isinstance(found, FoPi):
            return found
        with progress_bar("loops", handling.quiet) as progress:
            return validate(loaded, found, samples=samples, seed=seed, progress=progress)

    return process_with_loader([file], _load, make, handling, "validating")


def simulate_file(file: str, given: FoPi | None, course: SimulationOptions, handling: OutputOptions) -> Exit:
    """Drive one plant, or one pair of them, and report."""

    def make(loaded: DesignSpec | SystemSpec) -> Result:
        from fopi_tune.pipeline.simulate import simulate
        from fopi_tune.pipeline.systems import simulate_system
        from fopi_tune.spec.model import SystemSpec

        wanted: dict[str, Any] = {
            "scenario": course.scenario,
            "plant": course.plant,
            "replay": course.replay,
            "samples": course.samples,
            "seed": course.seed,
            "exact": course.exact,
        }
        if isinstance(loaded, SystemSpec):
            return simulate_system(loaded, _gains_of_modes(loaded, given, handling), **wanted)
        found = given if given is not None else earlier_or_tuned_gains(loaded, handling)
        return found if not isinstance(found, FoPi) else simulate(loaded, found, **wanted)

    return process_with_loader([file], _load, make, handling, "simulating")


def _load(file: str) -> DesignSpec | SystemSpec:
    from fopi_tune.spec import load_any

    return load_any(file)


def _gains_of_modes(system: SystemSpec, given: FoPi | None, handling: OutputOptions) -> dict[str, FoPi]:
    """Gains of earlier designs, for modes whose gains the system leaves open; the others are tuned."""
    if given is not None:
        raise DomainError("this is a system; its modes' gains belong into its file: brake: {spec: ..., gains: ...}")
    found = {}
    for mode in system.modes:
        if mode.gains is None:
            # where `fopi tune` leaves them when nothing else is said
            gains = gains_of_earlier_design(mode.spec, replace(handling, out=None, several=False))
            if gains is not None:
                found[mode.name] = gains
            else:
                handling.note(f"{mode.name}: no gains given, and no design of {mode.spec.name} there; tuning ...")
    return found

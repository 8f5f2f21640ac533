"""`fopi discretize`, of a spec's gains or of a system."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fopi_tune.cli.batch import OutputOptions, process_specs_or_systems
from fopi_tune.cli.gains import GivenGains, given_or_tuned_gains
from fopi_tune.cli.output import Exit
from fopi_tune.cli.simulations import gains_of_modes
from fopi_tune.core.controller import FoPi

if TYPE_CHECKING:
    from fopi_tune.cli.result_files import Result
    from fopi_tune.spec.model import DesignSpec, SystemSpec


def discretize_file(file: str, given: GivenGains, proof: bool, options: OutputOptions) -> Exit:
    """Make a spec's digital controller and prove its loop, or those of a system; write and print the result.

    Args:
        file: of the spec or system.
        given: gains of a spec's controller.
        proof: of a spec's requirements for the loop on samples; of a system nothing is proved.
        options: where results go.
    """

    def compute(loaded: DesignSpec | SystemSpec) -> Result:
        from fopi_tune.pipeline.discretize import discretize, discretize_system
        from fopi_tune.spec.model import SystemSpec

        if isinstance(loaded, SystemSpec):
            return discretize_system(loaded, gains_of_modes(loaded, given, options))
        gains = given_or_tuned_gains(loaded, given, options)
        return gains if not isinstance(gains, FoPi) else discretize(loaded, gains, proof)

    return process_specs_or_systems([file], compute, options, "discretizing")

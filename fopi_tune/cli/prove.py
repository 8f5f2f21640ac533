"""`fopi prove`, of a spec's gains or of a system."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fopi_tune.cli.batch import OutputOptions, process_specs_or_systems
from fopi_tune.cli.gains import GivenGains, given_or_tuned_gains
from fopi_tune.cli.output import Exit
from fopi_tune.cli.simulations import gains_of_modes
from fopi_tune.core.controller import FoPi
from fopi_tune.errors import DomainError

#: of a spec's requirements, where none is given; neper or radian
TOLERANCE = 1e-6

if TYPE_CHECKING:
    from fopi_tune.cli.result_files import Result
    from fopi_tune.spec.model import DesignSpec, SystemSpec


def prove_file(file: str, given: GivenGains, tolerance: float, options: OutputOptions) -> Exit:
    """Prove a spec's requirements, or that a system settles; write and print the result.

    Args:
        file: of the spec or system.
        given: gains of a spec's controller.
        tolerance: of a spec's requirements, in neper or radian.
        options: where results go.
    """

    def compute(loaded: DesignSpec | SystemSpec) -> Result:
        from fopi_tune.spec.model import SystemSpec

        if isinstance(loaded, SystemSpec):
            from fopi_tune.pipeline.prove_system import prove_system

            if tolerance != TOLERANCE:
                raise DomainError("this is a system, which has no requirements to miss; leave --tolerance out")
            return prove_system(loaded, gains_of_modes(loaded, given, options))
        from fopi_tune.pipeline.prove import prove

        gains = given_or_tuned_gains(loaded, given, options)
        return gains if not isinstance(gains, FoPi) else prove(loaded, gains, tolerance)

    return process_specs_or_systems([file], compute, options, "proving")

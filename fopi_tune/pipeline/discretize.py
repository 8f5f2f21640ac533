"""The digital controller:  spec, gains -> Discretized;  system, gains -> DiscretizedSystem."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from fopi_tune.core.controller import FoPi, refuse_no_gains
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.terms.numbers import refuse_no_flag
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.tune_system import mode_gains
from fopi_tune.proof import Verification, certify, verify
from fopi_tune.results.design import Discretized
from fopi_tune.results.stamp import certificate_versions, stamp
from fopi_tune.results.system import DiscretizedSystem
from fopi_tune.simulation.notes import dwell_notes
from fopi_tune.spec import load_spec, load_system
from fopi_tune.spec.digests import digests_of
from fopi_tune.spec.load import Source, SystemSource
from fopi_tune.spec.model import DesignSpec

_log = logging.getLogger(__name__)


def discretize(source: Source, gains: FoPi, proof: bool = True) -> Discretized:
    """Make the digital controller that a spec's `digital:` section asks for, and check the loop on samples with it.

    Args:
        source: a spec file, or a spec.
        gains: the controller, usually from a design.
        proof: False leaves the certificate out.

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: the spec has no such section, it cannot be met (band, sample time, precision), or kp = ki = 0.
    """
    spec = load_spec(source)
    refuse_no_gains(gains)
    refuse_no_flag("proof", proof)
    spec.controller.refuse_other_weight(gains)
    return discretized(spec, gains, proof)


def discretized(spec: DesignSpec, gains: FoPi, proof: bool, found: Verification | None = None) -> Discretized:
    """The digital controller of a spec; `found` is the verification of its loop, where there is one already."""
    from fopi_tune.digital import discretize
    from fopi_tune.digital.implementation import digital_section_of, nominal_crossover

    digital = digital_section_of(spec)
    controller = discretize(gains, digital, nominal_crossover(spec, gains))
    _log.info("%s: digital controller of %d sections", spec.name, len(controller.sections.poles))
    implementation = Implementation(controller.sections, digital.delay_samples) if spec.has_loop_on_samples else None
    if found is None:
        found = verify(spec, gains, implementation=implementation)
    proved = proof and not spec.is_measured
    certificate = certify(spec, found, certificate_versions(), implementation) if proved else None
    return Discretized(spec, controller, found, certificate, stamp(spec.text_sha256, None, digests_of(spec)))


def discretize_system(source: SystemSource, gains: Mapping[str, FoPi] | None = None) -> DiscretizedSystem:
    """Make the digital controllers of a system's modes; `code()` of the result has them and their switching as C.

    Nothing is judged or proved here; `prove_system` says whether the system settles.

    Args:
        source: a system file, or a system.
        gains: by mode's name; those of the file where left out, and tuned where the file has none.

    Raises:
        SpecError: the file, or a spec it names, cannot be read, or has mistakes.
        DomainError: a mode's digital section cannot be met (band, sample time, precision), or its spec has no solution.
    """
    from fopi_tune.digital import discretize
    from fopi_tune.digital.implementation import digital_section_of, nominal_crossover

    system = load_system(source)
    every_gains = mode_gains(system, gains)
    for name, found in every_gains.items():
        if found.is_zero:
            raise DomainError(
                f"{name}: all gains are 0, and code of a mode is that of its controller; give one a value"
            )
    raising, lowering = (
        discretize(
            every_gains[mode.name], digital_section_of(mode.spec), nominal_crossover(mode.spec, every_gains[mode.name])
        )
        for mode in system.modes
    )
    notes = tuple(dwell_notes(system))
    return DiscretizedSystem(system, every_gains, (raising, lowering), notes, stamp(system.sha256, None))

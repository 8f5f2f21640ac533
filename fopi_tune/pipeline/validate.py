"""Monte Carlo:  spec, gains -> Validated, how often the digital loop of a drawn plant meets the spec."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi, refuse_no_gains
from fopi_tune.core.fractional_plants.family import ON_SAMPLES, refuse_fractional_family
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.terms.numbers import whole_number
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError
from fopi_tune.montecarlo.progress import logged_progress
from fopi_tune.pipeline.discretize import discretize
from fopi_tune.pipeline.scenario_results import refuse_start
from fopi_tune.results.design import Validated
from fopi_tune.spec import load_spec
from fopi_tune.spec.lists.members import refuse_measured
from fopi_tune.spec.load import Source
from fopi_tune.spec.model import ValidationSpec

if TYPE_CHECKING:
    from fopi_tune.montecarlo.montecarlo import Block
    from fopi_tune.montecarlo.outcomes import Progress

#: the most that the spec language allows
_MOST_SAMPLES = 10**8


def validate(
    source: Source,
    gains: FoPi,
    *,
    samples: int | None = None,
    seed: int | None = None,
    progress: Progress | None = None,
    blocks: Sequence[Block] = (),
) -> Validated:
    """Draw plants from the family and count how often the loop with the digital controller meets the spec.

    Args:
        source: a spec file, or a spec, with a section `digital`.
        gains: the controller, usually from a design.
        samples: plants to draw, in place of the spec's; of a file of samples, its first rows.
        seed: in place of the spec's.
        progress: called with the number of plants done, and of all.
        blocks: of all these plants, from `validate_block`, where they were drawn elsewhere; empty: draw them here.

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: as for `discretize`, a number of samples that cannot be drawn, or no draw that is a plant.
    """
    from fopi_tune.montecarlo.contradiction import contradictions
    from fopi_tune.montecarlo.montecarlo import evidence_of, monte_carlo

    spec = load_spec(source)
    refuse_no_gains(gains)
    refuse_measured(spec, "drawing plants")
    refuse_fractional_family(spec.plant, "Monte Carlo", ON_SAMPLES)
    spec = replace(spec, validation=override_validation(spec.validation, samples, seed))
    if spec.digital is not None:
        nominal = Plants.of(spec.plant.member(spec.plant.nominal_point))
        for scenario in spec.scenarios:
            refuse_start(scenario, nominal, spec.digital.sample_time_s)
    digital = discretize(spec, gains)
    implementation = Implementation(digital.controller.sections, digital.controller.digital.delay_samples)
    told = logged_progress(f"{spec.name}: plants drawn", progress)
    evidence = evidence_of(spec, blocks) if blocks else monte_carlo(spec, gains, implementation, told)
    return Validated(digital, evidence, contradictions(evidence, digital.certificate))


def validate_block(source: Source, gains: FoPi, first: int, end: int) -> Block:
    """The outcomes of the plants of indices first to end - 1; `validate` puts blocks together.

    Args:
        source: a spec file, or a spec, with a section `digital`; its section `validation` says how plants are drawn.
        gains: the controller, usually from a design.
        first: index of the first plant.
        end: index after the last.

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: as for `validate`.
    """
    from fopi_tune.montecarlo.montecarlo import sample_block

    spec = load_spec(source)
    controller = discretize(spec, gains, proof=False).controller
    return sample_block(spec, gains, Implementation(controller.sections, controller.digital.delay_samples), first, end)


def override_validation(validation: ValidationSpec | None, samples: int | None, seed: int | None) -> ValidationSpec:
    """A section `validation` with the command line's numbers in place of the file's.

    Raises:
        DomainError: a number of samples that is not positive, or more than the rows of a file of samples.
    """
    wanted = validation or ValidationSpec()
    drawn, listed = wanted.samples if samples is None else whole_number("samples", samples), wanted.samples_file
    if not 1 <= drawn <= _MOST_SAMPLES:
        raise DomainError(f"samples = {drawn} must be at least 1 and at most {_MOST_SAMPLES}")
    if listed is not None and drawn > len(listed.table.rows):
        raise DomainError(
            f"samples = {drawn} are more than the {counted(len(listed.table.rows), 'row')} of {listed.name}"
        )
    return replace(wanted, samples=drawn, seed=wanted.seed if seed is None else whole_number("seed", seed))

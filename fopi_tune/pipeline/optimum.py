"""The global optimum:  spec, gains -> Optimum, a bound that no gains can beat, and the check of its file."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi, refuse_no_gains, refuse_zero_gains
from fopi_tune.core.fractional_plants.family import refuse_fractional_family
from fopi_tune.core.terms.numbers import plain_number
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.prove import other_text, with_digest_of
from fopi_tune.spec import load_spec
from fopi_tune.spec.lists.members import refuse_list, refuse_measured
from fopi_tune.spec.load import Source
from fopi_tune.spec.model import DesignSpec

if TYPE_CHECKING:
    from fopi_tune.montecarlo.outcomes import Progress
    from fopi_tune.optimum import Optimum, OptimumRecheck


def certify_optimum(
    source: Source,
    gains: FoPi | None = None,
    *,
    gap: float = 1e-3,
    time_limit_s: float = 60.0,
    progress: Progress | None = None,
) -> Optimum:
    """Prove how far gains can be from the global optimum; without gains, that the spec is infeasible.

    Args:
        source: a spec file, or a spec.
        gains: a design of it; None asks for the proof that no gains in the box meet the requirements.
        gap: the search stops at this relative distance of the bound from the gains' objective.
        time_limit_s: after it, the gap reached so far is returned.
        progress: called with the number of boxes evaluated, and of those still open.

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: gains that are all 0, or a gap or a limit that is not positive.
    """
    from fopi_tune.optimum import certify_optimum

    spec = load_spec(source)
    if gains is not None:
        refuse_no_gains(gains)
        refuse_zero_gains(gains)
    gap, time_limit_s = plain_number("gap", gap), plain_number("time_limit_s", time_limit_s)
    refuse_without_bound(spec)
    spec.controller.refuse_derivative_order("the proof of the optimum")
    return certify_optimum(spec, gains, gap=gap, time_limit_s=time_limit_s, progress=progress)


def refuse_without_bound(spec: DesignSpec) -> None:
    """Refuse plants and measures that the proof of the optimum does not know, before gains are searched for it.

    Raises:
        DomainError: a list, a fractional plant, measured responses, or a requirement or objective of a scenario.
    """
    what = "the proof of the optimum"
    refuse_list(spec, what)
    refuse_fractional_family(spec.plant, what, "it bounds polynomials in s")
    refuse_measured(spec, what)
    _refuse_scenarios(spec)


def _refuse_scenarios(spec: DesignSpec) -> None:
    # without them "better gains" may miss a requirement, and the objective has no value
    if spec.designs_scenarios:
        raise DomainError(
            "the proof of the optimum knows nothing of what scenarios measure; leave it out, or write requirements "
            "and an objective of the frequency response"
        )


def recheck_optimum(document: object, source: Source) -> OptimumRecheck:
    """Check the file of an optimum without searching.

    Args:
        document: the file's JSON, as `json.load` gives it.
        source: its spec.

    Raises:
        CertificateError: the document is not of an optimum.
        SpecError: the spec cannot be read, or has mistakes.
        DomainError: the spec has a requirement or an objective of a scenario.
    """
    from fopi_tune.optimum import recheck_optimum

    spec = load_spec(source)
    _refuse_scenarios(spec)
    found = recheck_optimum(document, with_digest_of(spec, document))
    return replace(found, notes=other_text(spec, document))

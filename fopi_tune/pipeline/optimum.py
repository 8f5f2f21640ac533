"""How far a design can be from the best possible one:  spec, gains -> Optimum, and its file tested again."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi
from fopi_tune.spec import load_spec
from fopi_tune.spec.load import Source

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
    """Prove how far gains can be from the best possible ones; without gains, whether a spec has any.

    Args:
        source: a spec file, or a spec.
        gains: a design of it; None asks for the proof that no gains in the box meet the requirements.
        gap: relative distance of the bound from their objective that is enough.
        time_limit_s: when it is up, the gap that was reached is returned.
        progress: told how many boxes were looked at, and how many are open.

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: a gap or a limit that is not positive.
    """
    from fopi_tune.optimum import certify_optimum

    return certify_optimum(load_spec(source), gains, gap=gap, time_limit_s=time_limit_s, progress=progress)


def recheck_optimum(document: object, source: Source) -> OptimumRecheck:
    """Test what a file says of the best gains again, without searching.

    Args:
        document: the file's JSON, as `json.load` gives it.
        source: the spec that it is about.

    Raises:
        CertificateError: it is no such file.
        SpecError: the spec cannot be read, or has mistakes.
    """
    from fopi_tune.optimum import recheck_optimum

    return recheck_optimum(document, load_spec(source))

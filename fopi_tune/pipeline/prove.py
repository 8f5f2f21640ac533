"""Proof of given gains:  spec, gains -> Check, and the check of a certificate."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

from fopi_tune.core.controller import FoPi, refuse_no_gains
from fopi_tune.core.terms.numbers import plain_number
from fopi_tune.digital.implementation import designed_implementation
from fopi_tune.errors import DomainError
from fopi_tune.proof import Recheck, certify, verify
from fopi_tune.proof.certificate import LARGEST_TOLERANCE
from fopi_tune.results.design import Check
from fopi_tune.results.stamp import certificate_versions, stamp
from fopi_tune.spec import load_spec
from fopi_tune.spec.digests import digests_of
from fopi_tune.spec.load import Source
from fopi_tune.spec.model import DesignSpec


def prove(source: Source, gains: FoPi, tolerance: float = 1e-6) -> Check:
    """Verify given gains against a spec, and prove or refute each requirement.

    Args:
        source: a spec file, or a spec; with `design: sampled` the loop is the one on samples.
        gains: the controller.
        tolerance: by how much a requirement may be missed, in neper or radian (a delay margin: relative).

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        UnstableLoopError: the loop is not stable, and turns too often for its requirements to be searched.
        DomainError: all gains are 0, or of another structure than the spec's; a tolerance outside (0, 0.01], a dead
            time so long that the loop's crossings cannot be listed, or a digital controller that the spec asks for and
            that cannot be made.
    """
    spec = load_spec(source)
    refuse_no_gains(gains)
    tolerance = plain_number("tolerance", tolerance)
    if not 0.0 < tolerance <= LARGEST_TOLERANCE:
        raise DomainError(
            f"tolerance = {tolerance!r} must be greater than 0 and at most {LARGEST_TOLERANCE:g}; 1e-6 is usual"
        )
    if spec.controller.filter_times is None and gains.measurement_filter != spec.controller.measurement_filter:
        raise DomainError(
            f"the gains have measurement_filter {gains.measurement_filter}, and the spec's controller "
            f"{spec.controller.measurement_filter}; give gains with that one"
        )
    spec.controller.refuse_other_weight(gains)
    spec.controller.refuse_other_structure(gains)
    implementation = designed_implementation(spec, gains)
    found = verify(spec, gains, tolerance, implementation)
    certificate = None if spec.is_measured else certify(spec, found, certificate_versions(), implementation)
    return Check(spec, found, certificate, stamp(spec.text_sha256, None, digests_of(spec)))


def recheck(document: object, source: Source | None = None) -> Recheck:
    """Check a certificate without searching.

    Args:
        document: the certificate's JSON, as `json.load` gives it.
        source: when given, the certificate must be about this spec.

    Raises:
        CertificateError: the document is no certificate.
        SpecError: the spec cannot be read, or has mistakes.
    """
    from fopi_tune.proof import recheck

    if source is None:
        return recheck(document, None)
    loaded = load_spec(source)
    spec = with_digest_of(loaded, document)
    found = replace(recheck(document, spec), notes=other_text(loaded, document))
    case = found.certificate.case
    if case.implementation is None:
        return found
    # the proof takes the filter as given: compare it with the one that the spec makes of these gains
    from fopi_tune.digital.implementation import is_implementation_of

    if is_implementation_of(spec, case.gains, case.implementation):
        return found
    problem = "the digital controller is not the one that the spec makes of the gains that are stated"
    return replace(found, problems=(*found.problems, problem))


def with_digest_of(spec: DesignSpec, document: object) -> DesignSpec:
    """The spec with the digest of the file that a certificate was made of.

    What a certificate is about, plants, gains, requirements and loop, is compared with the spec entry by entry, or
    derived from it again; the digest of the text would refuse it for a comment or a scenario that was added since.
    """
    stated = _stated_digest(document)
    return spec if stated is None else replace(spec, text_sha256=stated)


def other_text(spec: DesignSpec, document: object) -> tuple[str, ...]:
    """A note when a certificate was made of another text of the spec than this one."""
    stated = _stated_digest(document)
    if stated is None or stated == spec.text_sha256:
        return ()
    return (
        "it was made of another text of this spec (`spec_sha256`); what it is about was compared with this text entry "
        "by entry",
    )


def _stated_digest(document: object) -> str | None:
    stated = document.get("spec_sha256") if isinstance(document, Mapping) else None
    # a spec that was made in Python may have none
    return stated if isinstance(stated, str) and re.fullmatch("([0-9a-f]{64})?", stated) else None

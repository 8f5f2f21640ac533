"""Proof of a system of two modes that take turns:  system, gains -> ProvedSystem, and the check of its certificate."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from fopi_tune.core.controller import FoPi
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.tune_system import mode_gains
from fopi_tune.proof.switched import SystemCertificate, SystemRecheck
from fopi_tune.proof.switched import prove_system as prove_model
from fopi_tune.proof.switched.documents import from_document
from fopi_tune.proof.switched.recheck import recheck_system as recheck_model
from fopi_tune.results.proved_system import ProvedSystem
from fopi_tune.results.stamp import certificate_versions, stamp
from fopi_tune.spec import load_system
from fopi_tune.spec.load import SystemSource

_log = logging.getLogger(__name__)


def prove_system(
    source: SystemSource,
    gains: Mapping[str, FoPi] | None = None,
    *,
    setpoints: tuple[float, float] | None = None,
) -> ProvedSystem:
    """Prove that a system settles, or that it cycles, or say what else is proved.

    Args:
        source: a system file, or a system.
        gains: by mode's name; those of the file where left out, and tuned where the file has none.
        setpoints: least and largest setpoint, in the output's unit; None: as many as can be proved.

    Raises:
        SpecError: the file, or a spec it names, cannot be read, or has mistakes.
        DomainError: setpoints that are no range, or a mode's spec that has no solution or no digital controller.
    """
    system = load_system(source)
    every_gains = mode_gains(system, gains)
    _log.info("%s: proof that it settles, or cycles", system.name)
    certificate = prove_model(system, every_gains, setpoints=setpoints, versions=certificate_versions())
    _log.info("%s: proof: %s", system.name, certificate.verdict.value)
    return ProvedSystem(system, every_gains, certificate, stamp(system.sha256, None))


def recheck_system(document: object, source: SystemSource | None = None) -> tuple[SystemCertificate, SystemRecheck]:
    """Check a certificate of a system without searching.

    Args:
        document: the certificate's JSON, as `json.load` gives it.
        source: when given, the certificate must be about this system, with gains in its file.

    Returns:
        The certificate that was read, and what is wrong with it.

    Raises:
        CertificateError: the document is no such certificate.
        SpecError: the system cannot be read, or has mistakes.
        DomainError: a mode of the system has no gains in its file, or no digital controller.
    """
    certificate = from_document(document)
    if source is None:
        return certificate, recheck_model(certificate)
    system = load_system(source)
    gains = {mode.name: mode.gains for mode in system.modes if mode.gains is not None}
    if missing := [mode.name for mode in system.modes if mode.gains is None]:
        raise DomainError(
            f"the system's file has no gains of {' and '.join(missing)} to compare with; write those that were proved "
            "there (system_proof.json has them), or leave the system out"
        )
    return certificate, recheck_model(certificate, system, gains)

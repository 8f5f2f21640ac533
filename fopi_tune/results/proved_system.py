"""What is proved of a system of two modes: the result of `fopi prove SYSTEM`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from fopi_tune.core.controller import FoPi, numbers_of
from fopi_tune.proof.switched import SystemCertificate, SystemVerdict
from fopi_tune.results.saved.files import json_file
from fopi_tune.results.saved.names import SYSTEM_CERTIFICATE, SYSTEM_PROOF
from fopi_tune.results.stamp import Stamp
from fopi_tune.results.views.shown import Shown
from fopi_tune.spec.model import SystemSpec

_SCHEMA = 1


@dataclass(frozen=True, repr=False)
class ProvedSystem(Shown):
    """A system with its certificate.

    Args:
        spec: the system.
        gains: of each mode, by name.
        certificate: what is proved.
        stamp: provenance.
    """

    spec: SystemSpec
    gains: Mapping[str, FoPi]
    certificate: SystemCertificate
    stamp: Stamp

    @property
    def status(self) -> SystemVerdict:
        """The certificate's verdict."""
        return self.certificate.verdict

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON."""
        return {
            "schema": _SCHEMA,
            "status": self.status.value,
            "name": self.spec.name,
            "gains": {name: numbers_of(found) for name, found in self.gains.items()},
            "inactive": self.spec.inactive,
            **({"min_dwell_s": self.spec.min_dwell_s} if self.spec.min_dwell_s else {}),
            "measurement_unit": self.spec.measurement_unit,
            "statements": list(self.certificate.statements),
            "stamp": asdict(self.stamp),
        }

    def certificate_document(self) -> dict[str, Any]:
        """The certificate's JSON."""
        from fopi_tune.proof.switched.documents import to_document

        return to_document(self.certificate)

    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """As `Shown.data_files`."""
        yield from json_file(SYSTEM_CERTIFICATE, self.certificate_document())
        yield from json_file(SYSTEM_PROOF, self.to_dict())

"""What the design stage hands on."""

from __future__ import annotations

from fopi_tune.candidate import Candidate, Violation
from fopi_tune.outcome import Give, Status

__all__ = ["Candidate", "Give", "Status", "Violation"]

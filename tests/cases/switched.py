"""The paper's car with each memory, its model and its certificate, made once a test session."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

from cases.project import ROOT

from fopi_tune.core.controller import FoPi
from fopi_tune.proof.switched import SystemCertificate, prove_system
from fopi_tune.proof.switched.documents import to_document
from fopi_tune.proof.switched.model import SwitchedModel
from fopi_tune.spec import load_system
from fopi_tune.spec.model import SystemSpec

CAR = load_system(ROOT / "systems" / "car.yaml")
GAINS = {mode.name: mode.gains for mode in CAR.modes if mode.gains is not None}
TUNED = {**GAINS, "brake": FoPi(0.38512, 0.38776, 0.82038)}
#: what the car is driven at
SETPOINTS = (2.0, 22.0)


def car(memory: str, **changes: Any) -> SystemSpec:
    """The car with a memory, and with other changes of the system."""
    return replace(CAR, inactive=memory, **changes)


def late(system: SystemSpec, delay_samples: float) -> SystemSpec:
    """A system with a computing delay."""
    modes = []
    for mode in system.modes:
        assert mode.spec.digital is not None
        digital = replace(mode.spec.digital, delay_samples=delay_samples)
        modes.append(replace(mode, spec=replace(mode.spec, digital=digital)))
    return replace(system, modes=(modes[0], modes[1]))


@functools.cache
def model(memory: str, delay_samples: float = 0.0) -> SwitchedModel:
    """The car with its published gains."""
    return SwitchedModel.of(late(car(memory), delay_samples), GAINS)


@functools.cache
def certificate(memory: str, delay_samples: float = 0.0) -> SystemCertificate:
    """Of the published gains, for `SETPOINTS`."""
    system = late(car(memory), delay_samples)
    return prove_system(system, GAINS, setpoints=SETPOINTS, versions={"fopi-tune": "0"})


@functools.cache
def document(memory: str) -> dict[str, Any]:
    """Its JSON; copy it before a change."""
    return to_document(certificate(memory))

"""What simulating and sampling a system hands out:  two loops that take turns, driven by their digital controllers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.sections import Implementation
from fopi_tune.simulated import Driven, chosen, continuous_of, draw_stamp, driven_of, place_of
from fopi_tune.spec.model import ScenarioSpec, SystemSpec, ValidationSpec
from fopi_tune.stamp import Stamp

if TYPE_CHECKING:
    from fopi_tune.validation.joint import SystemEvidence

_SCHEMA = 1


@dataclass(frozen=True)
class SimulatedSystem:
    """Scenarios of a system with one pair of plants.

    Args:
        spec: the system.
        gains: of each mode.
        plant: the uncertain numbers by name, each after its mode's name and a dot.
        index: of the draw that was made again; None for plants that were named.
        driven: the scenarios.
        stamp: where this comes from.
        exact: whether this is the hybrid inclusion in continuous time, without samples.
    """

    spec: SystemSpec
    gains: Mapping[str, FoPi]
    plant: Mapping[str, float]
    index: int | None
    driven: tuple[Driven, ...]
    stamp: Stamp
    exact: bool = False

    @property
    def status(self) -> str:
        """`chattering` where the modes do, `met` when every limit is, else `violated`."""
        if any(driven.chattering for driven in self.driven):
            return "chattering"
        return "met" if all(met for each in self.driven for _, met in each.limits) else "violated"

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON, without the signals: they are in the CSV files."""
        return {
            "schema": _SCHEMA,
            "status": self.status,
            "gains": {name: asdict(gains) for name, gains in self.gains.items()},
            "name": self.spec.name,
            "plant": dict(self.plant),
            "index": self.index,
            "exact": self.exact,
            "scenarios": [each.to_dict() for each in self.driven],
            "stamp": {**asdict(self.stamp), **draw_stamp(self.index, self.spec.validation)},
        }


@dataclass(frozen=True)
class ValidatedSystem:
    """What sampling says of a system.

    Args:
        spec: the system.
        gains: of each mode.
        evidence: how often everything held.
        stamp: where this comes from.
    """

    spec: SystemSpec
    gains: Mapping[str, FoPi]
    evidence: SystemEvidence
    stamp: Stamp

    @property
    def status(self) -> str:
        """`met` or `violated`."""
        return "met" if self.evidence.all_met else "violated"

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON."""
        from fopi_tune.validation.document import system_document

        return {
            "schema": _SCHEMA,
            "status": self.status,
            "gains": {name: asdict(gains) for name, gains in self.gains.items()},
            "name": self.spec.name,
            **system_document(self.evidence),
            "stamp": {
                **asdict(self.stamp),
                "samples_file_sha256": self.evidence.validation.samples_file_sha256,
            },
        }


def drive_system(
    system: SystemSpec,
    gains: Mapping[str, FoPi],
    implementations: Sequence[Implementation],
    stamp: Stamp,
    *,
    only: str | None = None,
    plant: Mapping[str, float] | None = None,
    index: int | None = None,
    exact: bool = False,
) -> SimulatedSystem:
    """Simulate the scenarios of a system for one pair of plants.

    Args:
        system: the system.
        gains: of each mode.
        implementations: the controllers that run, throttle first.
        stamp: where the result comes from.
        only: name of the only scenario.
        plant: uncertain numbers by name, the nominal ones where left out.
        index: of a Monte-Carlo draw to make again, its noise included; instead of plants.
        exact: the hybrid inclusion in continuous time instead.

    Raises:
        DomainError: an unknown scenario or number, or an index that was not drawn.
    """
    from fopi_tune.validation.joint import hybrid_scenario, modes_of

    drawn = system.validation or ValidationSpec()
    family = system.family
    place = place_of(family, drawn, plant, index)
    scenarios = chosen(system.scenarios, only)
    if exact:
        driven = tuple(_inclusion(system, scenario, gains, implementations, place) for scenario in scenarios)
        return SimulatedSystem(system, dict(gains), family.describe(place), index, driven, stamp, exact=True)
    modes = modes_of(system, implementations, lambda first, end: place[None, :])
    found = []
    for scenario in scenarios:
        run = hybrid_scenario(system, scenario, implementations[0], drawn.seed)
        found.append(driven_of(scenario, modes, run, system.limits, index or 0))
    return SimulatedSystem(system, dict(gains), family.describe(place), index, tuple(found), stamp)


def _inclusion(
    system: SystemSpec,
    scenario: ScenarioSpec,
    gains: Mapping[str, FoPi],
    implementations: Sequence[Implementation],
    place: np.ndarray,
) -> Driven:
    from fopi_tune.validation.continuous import drive_inclusion
    from fopi_tune.validation.montecarlo import controller_of

    split = len(system.modes[0].spec.plant.uncertain_names)
    plants = [m.spec.plant.member(part) for m, part in zip(system.modes, (place[:split], place[split:]), strict=True)]
    controllers = [controller_of(m.spec, i) for m, i in zip(system.modes, implementations, strict=True)]
    each = [gains[mode.name] for mode in system.modes]
    step = implementations[0].sample_time_s
    return continuous_of(scenario, drive_inclusion(system, scenario, each, plants, controllers, step), system.limits)

"""Results of a system of two modes:  its simulation with one pair of plants, evidence from many, its controllers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from fopi_tune.core.controller import FoPi, numbers_of
from fopi_tune.core.switching_lines import turns_entry
from fopi_tune.core.terms.feedforward import fed_by
from fopi_tune.results.saved.files import json_file
from fopi_tune.results.saved.names import CODE_FOLDER, EVIDENCE, SYSTEM_DIGITAL
from fopi_tune.results.simulation import ScenarioResult, draw_stamp, simulation_files
from fopi_tune.results.stamp import Stamp
from fopi_tune.results.views.shown import Shown
from fopi_tune.spec.model import SystemSpec

if TYPE_CHECKING:
    from fopi_tune.digital import DigitalController, Switching
    from fopi_tune.montecarlo.systems import SystemEvidence

_SCHEMA = 1


@dataclass(frozen=True, repr=False)
class SimulatedSystem(Shown):
    """Scenarios of a system with one pair of plants.

    Args:
        spec: the system.
        gains: of each mode.
        plant: the uncertain numbers by name, each after its mode's name and a dot.
        index: of the Monte Carlo draw; None for plants given by their numbers.
        driven: the results, a scenario each.
        stamp: provenance.
        exact: whether the hybrid inclusion was simulated in continuous time, without samples.
        left_out: what the loops have and this simulation has not, in words; empty for none.
        notes: what to know about all scenarios.
    """

    spec: SystemSpec
    gains: Mapping[str, FoPi]
    plant: Mapping[str, float]
    index: int | None
    driven: tuple[ScenarioResult, ...]
    stamp: Stamp
    exact: bool = False
    left_out: str = ""
    notes: tuple[str, ...] = ()

    @property
    def member(self) -> str:
        """The plant of a list: none, as a mode's spec has one plant."""
        return ""

    @property
    def status(self) -> str:
        """`chattering` where the modes do, `met` when every limit is, else `violated`."""
        if any(driven.chattering for driven in self.driven):
            return "chattering"
        return "met" if all(each.all_met for each in self.driven) else "violated"

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON, without the signals: they are in the CSV files."""
        return {
            "schema": _SCHEMA,
            "status": self.status,
            "gains": {name: numbers_of(gains) for name, gains in self.gains.items()},
            "name": self.spec.name,
            "plant": dict(self.plant),
            "index": self.index,
            "exact": self.exact,
            "left_out": self.left_out or None,
            "notes": list(self.notes),
            "scenarios": [each.to_dict() for each in self.driven],
            "stamp": {**asdict(self.stamp), **draw_stamp(self.index, self.spec.validation)},
        }

    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """As `Shown.data_files`."""
        yield from simulation_files(self)


@dataclass(frozen=True, repr=False)
class ValidatedSystem(Shown):
    """Evidence from sampled pairs of plants.

    Args:
        spec: the system.
        gains: of each mode.
        evidence: how often each limit was met.
        stamp: provenance.
        notes: what to know about all scenarios.
    """

    spec: SystemSpec
    gains: Mapping[str, FoPi]
    evidence: SystemEvidence
    stamp: Stamp
    notes: tuple[str, ...] = ()

    @property
    def status(self) -> str:
        """`met` or `violated`."""
        return "met" if self.evidence.all_met else "violated"

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON."""
        from fopi_tune.montecarlo.documents import system_document

        return {
            "schema": _SCHEMA,
            "status": self.status,
            "gains": {name: numbers_of(gains) for name, gains in self.gains.items()},
            "name": self.spec.name,
            **system_document(self.evidence),
            "notes": list(self.notes),
            "stamp": {
                **asdict(self.stamp),
                "samples_file_sha256": self.evidence.validation.samples_file_sha256,
            },
        }

    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """As `Shown.data_files`."""
        yield from json_file(EVIDENCE, self.to_dict())


def feedforward_entry(spec: SystemSpec) -> dict[str, dict[str, float]]:
    """The gains of each mode that is fed forward, by its name."""
    return {mode.name: asdict(mode.feedforward) for mode in spec.modes if mode.feedforward is not None}


@dataclass(frozen=True, repr=False)
class DiscretizedSystem(Shown):
    """The digital controllers of a system's modes, and how they take turns: the result of `fopi discretize SYSTEM`.

    Args:
        spec: the system.
        gains: of each mode, by name.
        controllers: the filters with their measured errors, in the order of the modes.
        notes: what to know besides.
        stamp: provenance.
    """

    spec: SystemSpec
    gains: Mapping[str, FoPi]
    controllers: tuple[DigitalController, DigitalController]
    notes: tuple[str, ...]
    stamp: Stamp

    @property
    def status(self) -> str:
        """`made`: nothing is judged."""
        return "made"

    @property
    def switching(self) -> Switching:
        """How the controllers take turns, on samples."""
        from fopi_tune.digital import Memory, Switching

        spec = self.spec
        first = [mode.name for mode in spec.modes].index(spec.first)
        fed = fed_by(tuple(mode.feedforward for mode in spec.modes), spec.sample_time_s)
        return Switching(spec.hysteresis, Memory(spec.inactive), spec.min_dwell_samples, first, fed)

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON."""
        from fopi_tune.digital import to_document

        pairs = zip(self.spec.modes, self.controllers, strict=True)
        return {
            "schema": _SCHEMA,
            "status": self.status,
            "name": self.spec.name,
            "gains": {name: numbers_of(found) for name, found in self.gains.items()},
            **turns_entry(self.spec.lines, *(mode.name for mode in self.spec.modes)),
            **({"feedforward": fed} if (fed := feedforward_entry(self.spec)) else {}),
            "inactive": self.spec.inactive,
            "first": self.spec.first,
            "min_dwell_s": self.spec.min_dwell_s,
            "min_dwell_samples": self.spec.min_dwell_samples,
            "modes": {mode.name: to_document(controller) for mode, controller in pairs},
            "notes": list(self.notes),
            "stamp": asdict(self.stamp),
        }

    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """As `Shown.data_files`, with the C code."""
        yield from ((f"{CODE_FOLDER}/{name}", text) for name, text in self.code().items())
        yield from json_file(SYSTEM_DIGITAL, self.to_dict())

    def code(self) -> dict[str, str]:
        """The C code: file name -> text.

        Raises:
            DomainError: a controller, or the hysteresis, cannot be exported.
        """
        from fopi_tune.digital import Export, SystemExport, export_system_c

        raising, lowering = (
            Export.of(mode.spec, controller) for mode, controller in zip(self.spec.modes, self.controllers, strict=True)
        )
        return export_system_c(
            SystemExport(
                name=self.spec.name,
                description=self.spec.description,
                system_sha256=self.spec.sha256,
                tool=raising.tool,
                modes=(raising, lowering),
                mode_names=(self.spec.modes[0].name, self.spec.modes[1].name),
                switching=self.switching,
                min_dwell_s=self.spec.min_dwell_s,
            )
        )

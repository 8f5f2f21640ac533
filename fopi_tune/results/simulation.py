"""The result of `fopi simulate`:  one plant in each of a spec's scenarios, with signals, measures and limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fopi_tune.core.controller import FoPi, numbers_of
from fopi_tune.results.saved.files import json_file
from fopi_tune.results.saved.names import simulation_kind
from fopi_tune.results.stamp import Stamp
from fopi_tune.results.views.shown import Shown
from fopi_tune.spec.model import DesignSpec, Limit, ScenarioSpec, ValidationSpec

if TYPE_CHECKING:
    from fopi_tune.simulation.scenario import Traces


@dataclass(frozen=True)
class JudgedStep:
    """The measures of one step of the reference, or of the load; nan for what belongs to another step.

    Args:
        at_s: its beginning.
        before, value: the reference before it and at its end, output unit; equal where there is no step of it.
        of_load: whether it is the load that changes.
        overshoot, undershoot, settling_time_s, rise_time_s, final_error: as the words after `limits:`; infinite: it did
            not settle, or not rise.
    """

    at_s: float
    before: float
    value: float
    of_load: bool
    overshoot: float
    undershoot: float
    settling_time_s: float
    rise_time_s: float
    final_error: float

    def phrase(self) -> str:
        """In words: "10 to 5 at 100 s"."""
        if self.of_load:
            return f"the load at {self.at_s:g} s"
        return f"{self.before:g} to {self.value:g} at {self.at_s:g} s" if self.before != self.value else "no step"


#: the measures of `JudgedStep`
STEP_MEASURES = ("overshoot", "undershoot", "settling_time_s", "rise_time_s", "final_error")
#: those of them that are 0 where a step has none
_OF_SOME_STEPS = ("undershoot", "rise_time_s")


@dataclass(frozen=True)
class ScenarioResult:
    """The simulation of one scenario with one plant.

    Args:
        scenario: as the spec states it.
        reference: shape (steps,), output unit.
        traces: the signals, one row.
        measures: word after `limits:` -> value; nan where the output did not stay finite; the acceleration only of a
            velocity.
        limits: those of the spec for this scenario, and whether each is met; None where that is not known.
        chattering: whether the modes of a system switched too often within its window.
        switch_times_s: when the mode of a system changed.
        accuracy: in continuous time, the largest difference of the output to a coarser run.
        outcome: of a system in continuous time, how the run ended; empty otherwise.
        steps: each step that is judged; the worst one counts in `measures`.
        notes: what to know about the run, a sentence each.
        finite: whether the output stayed finite; a run that did not meets nothing.
    """

    scenario: ScenarioSpec
    reference: np.ndarray
    traces: Traces
    measures: Mapping[str, float]
    limits: tuple[tuple[Limit, bool | None], ...]
    chattering: bool = False
    switch_times_s: tuple[float, ...] = ()
    accuracy: float | None = None
    outcome: str = ""
    steps: tuple[JudgedStep, ...] = ()
    notes: tuple[str, ...] = ()
    finite: bool = True

    @property
    def all_met(self) -> bool:
        """Whether the output stayed finite and every limit is met."""
        return self.finite and all(met for _, met in self.limits)

    @property
    def worst_steps(self) -> dict[str, JudgedStep]:
        """Which step counts in each of `STEP_MEASURES`, where there is more than one."""
        found: dict[str, JudgedStep] = {}
        for name in STEP_MEASURES if len(self.steps) > 1 else ():
            known = [step for step in self.steps if _has(step, name)]
            if known:
                found[name] = max(
                    known, key=lambda step: abs(step.final_error) if name == "final_error" else getattr(step, name)
                )
        return found

    def to_dict(self) -> dict[str, Any]:
        """Measures and limits as JSON; what is not finite is null."""
        return {
            "name": self.scenario.name,
            "samples": len(self.traces.time_s),
            "measures": {k: _finite(v) for k, v in self.measures.items()},
            "limits": [
                {"name": e.measure, "relation": e.relation.value, "limit": e.limit, "met": met}
                for e, met in self.limits
            ],
            "chattering": self.chattering,
            "switch_times_s": list(self.switch_times_s),
            "accuracy": None if self.accuracy is None else _finite(self.accuracy),
            "outcome": self.outcome or None,
            "steps": [
                {name: _finite(value) if isinstance(value, float) else value for name, value in asdict(step).items()}
                for step in self.steps
            ],
            "worst_steps": {name: self.steps.index(step) for name, step in self.worst_steps.items()},
            "notes": list(self.notes),
            "finite": self.finite,
        }

    def rows(self) -> Iterator[tuple[float, ...]]:
        """The numbers that `COLUMNS` names; a row a sample."""
        t = self.traces
        columns = (t.output, t.rate, t.rate_after, t.measured, t.error, t.demanded, t.applied, t.mode)
        yield from zip(
            t.time_s.tolist(), self.reference.tolist(), *(column[0].tolist() for column in columns), strict=True
        )


def _has(step: JudgedStep, name: str) -> bool:
    value = getattr(step, name)
    return not (math.isnan(value) or (name in _OF_SOME_STEPS and value == 0.0))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


COLUMNS = (
    "time_s",
    "reference",
    "output",
    "output_rate_per_s",
    "output_rate_after_per_s",
    "measured",
    "error",
    "control",
    "control_applied",
    "mode",
)


@dataclass(frozen=True, repr=False)
class Simulated(Shown):
    """The simulations of a spec's scenarios with one plant.

    Args:
        spec: the spec.
        gains: what the controller approximates.
        plant: the plant's uncertain numbers by name.
        index: of the Monte Carlo draw; None for a plant given by its numbers.
        driven: the results, a scenario each.
        stamp: provenance.
        exact: whether the loop was simulated in continuous time, without filter and samples.
        left_out: what the loop has and this simulation has not, in words; empty for none.
        notes: what to know about all scenarios.
        member: of a list of plants, the name of the plant's; empty without one.
    """

    spec: DesignSpec
    gains: FoPi
    plant: Mapping[str, float]
    index: int | None
    driven: tuple[ScenarioResult, ...]
    stamp: Stamp
    exact: bool = False
    left_out: str = ""
    notes: tuple[str, ...] = ()
    member: str = ""

    @property
    def status(self) -> str:
        """`met` when the output stays finite and every limit is met, else `violated`."""
        return "met" if all(each.all_met for each in self.driven) else "violated"

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON, without the signals: they are in the CSV files."""
        return {
            "schema": 1,
            "status": self.status,
            "gains": numbers_of(self.gains),
            "name": self.spec.name,
            **({"member": self.member} if self.member else {}),
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


class _Simulations(Protocol):
    """Simulations of a loop or a system."""

    @property
    def exact(self) -> bool: ...
    @property
    def driven(self) -> tuple[ScenarioResult, ...]: ...
    def to_dict(self) -> dict[str, Any]: ...


def simulation_files(result: _Simulations) -> Iterator[tuple[str, str]]:
    """The document of simulations, and the signals of each scenario as CSV with all digits."""
    kind = simulation_kind(result.exact)
    yield from json_file(f"{kind}.json", result.to_dict())
    for driven in result.driven:
        lines = (",".join(repr(value) for value in row) for row in driven.rows())
        yield f"{kind}_{driven.scenario.name}.csv", "\n".join([",".join(COLUMNS), *lines]) + "\n"


def draw_stamp(index: int | None, drawn: ValidationSpec | None) -> dict[str, Any]:
    """What, besides the spec, reproduces a drawn plant."""
    if index is None or drawn is None:
        return {}
    return {"seed": drawn.seed, "samples": drawn.samples, "samples_file_sha256": drawn.samples_file_sha256}

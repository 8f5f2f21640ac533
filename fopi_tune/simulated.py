"""What `fopi simulate` hands out:  one plant driven through a spec's scenarios by its digital controller."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.samples import why_impossible
from fopi_tune.core.sections import Implementation
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import MEASURES, DesignSpec, Limit, Relation, ScenarioSpec, ValidationSpec
from fopi_tune.stamp import Stamp

if TYPE_CHECKING:
    from fopi_tune.validation.continuous import Continuous
    from fopi_tune.validation.scenario import Measures, Mode, Scenario, Traces


@dataclass(frozen=True)
class Driven:
    """One scenario of one plant.

    Args:
        scenario: the spec's.
        reference: shape (steps,), output unit.
        traces: the signals, one row.
        measures: word after `limits:` -> value; nan where the output did not stay finite.
        limits: the spec's about this scenario, and whether each is met.
        chattering: whether the modes of a system switched too often within its window.
        switch_times_s: when the modes of a system changed.
        accuracy: in continuous time, how far the output is from that of steps twice as long.
        outcome: of a system in continuous time, how the run ended; empty otherwise.
    """

    scenario: ScenarioSpec
    reference: np.ndarray
    traces: Traces
    measures: Mapping[str, float]
    limits: tuple[tuple[Limit, bool], ...]
    chattering: bool = False
    switch_times_s: tuple[float, ...] = ()
    accuracy: float | None = None
    outcome: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Measures and limits as JSON; what is not finite is null."""
        return {
            "name": self.scenario.name,
            "samples": len(self.traces.time_s),
            "measures": {k: v if math.isfinite(v) else None for k, v in self.measures.items()},
            "limits": [
                {"name": e.measure, "relation": e.relation.value, "limit": e.limit, "met": met}
                for e, met in self.limits
            ],
            "chattering": self.chattering,
            "switch_times_s": list(self.switch_times_s),
            "accuracy": self.accuracy,
            "outcome": self.outcome or None,
        }

    def rows(self) -> Iterator[tuple[float, ...]]:
        """The numbers that `COLUMNS` names; a row a sample."""
        t = self.traces
        columns = (t.output, t.rate, t.rate_after, t.measured, t.error, t.demanded, t.applied, t.mode)
        yield from zip(
            t.time_s.tolist(), self.reference.tolist(), *(column[0].tolist() for column in columns), strict=True
        )


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


@dataclass(frozen=True)
class Simulated:
    """Every scenario that was asked for.

    Args:
        spec: what was asked.
        gains: what the controller approximates.
        plant: the plant's uncertain numbers by name.
        index: of the draw that was made again; None for a plant that was named.
        driven: the scenarios.
        stamp: where this comes from.
        exact: whether this is the loop in continuous time, without filter and samples.
    """

    spec: DesignSpec
    gains: FoPi
    plant: Mapping[str, float]
    index: int | None
    driven: tuple[Driven, ...]
    stamp: Stamp
    exact: bool = False

    @property
    def status(self) -> str:
        """`met` when every limit is, else `violated`."""
        return "met" if all(met for each in self.driven for _, met in each.limits) else "violated"

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON, without the signals: they are in the CSV files."""
        return {
            "schema": 1,
            "status": self.status,
            "gains": {"kp": self.gains.kp, "ki": self.gains.ki, "alpha": self.gains.alpha},
            "name": self.spec.name,
            "plant": dict(self.plant),
            "index": self.index,
            "exact": self.exact,
            "scenarios": [each.to_dict() for each in self.driven],
            "stamp": {**asdict(self.stamp), **draw_stamp(self.index, self.spec.validation)},
        }


def drive(
    spec: DesignSpec,
    gains: FoPi,
    implementation: Implementation,
    stamp: Stamp,
    *,
    only: str | None = None,
    plant: Mapping[str, float] | None = None,
    index: int | None = None,
    exact: bool = False,
) -> Simulated:
    """Simulate the scenarios of a spec for one plant.

    Args:
        spec: with scenarios.
        gains: what the controller approximates.
        implementation: the controller that runs.
        stamp: where the result comes from.
        only: name of the only scenario.
        plant: uncertain numbers by name, the nominal ones where left out.
        index: of a Monte-Carlo draw to make again, its noise included; instead of a plant.
        exact: in continuous time instead, without filter, samples and computing delay.

    Raises:
        DomainError: no scenario, an unknown one, an unknown number, an index that was not drawn, or a place that is no
            plant.
    """
    from fopi_tune.validation.judged import scenario_of
    from fopi_tune.validation.montecarlo import controller_of
    from fopi_tune.validation.scenario import Mode

    drawn = spec.validation or ValidationSpec()
    place = place_of(spec.plant, drawn, plant, index)
    scenarios = chosen(spec.scenarios, only)
    if exact:
        from fopi_tune.validation.continuous import drive_loop

        member, controller = spec.plant.member(place), controller_of(spec, implementation)
        step = implementation.sample_time_s
        runs = [drive_loop(scenario, gains, member, controller, step) for scenario in scenarios]
        driven = tuple(continuous_of(s, run, spec.limits) for s, run in zip(scenarios, runs, strict=True))
        return Simulated(spec, gains, spec.plant.describe(place), index, driven, stamp, exact=True)
    plants = Plants.members(spec.plant, place[None, :])
    # a function of the index, so that the noise is that of the draw
    modes = [Mode(controller_of(spec, implementation), lambda begin, end: plants)]
    found = [
        driven_of(scenario, modes, scenario_of(scenario, implementation, drawn.seed), spec.limits, index or 0)
        for scenario in scenarios
    ]
    return Simulated(spec, gains, spec.plant.describe(place), index, tuple(found), stamp)


def driven_of(
    scenario: ScenarioSpec, modes: Sequence[Mode], run: Scenario, limits: Sequence[Limit], index: int
) -> Driven:
    """One scenario of one plant.

    Args:
        scenario: the spec's.
        modes: controllers, and the plant for its index.
        run: the scenario on the controllers' samples.
        limits: the spec's.
        index: of the plant, on which its noise depends.
    """
    from fopi_tune.validation.judged import horizon_of
    from fopi_tune.validation.reference import measures_of
    from fopi_tune.validation.simulate import simulate

    traces = simulate(modes, run, 1, index)
    numbers = measures_of(traces, [mode.controller for mode in modes], run, horizon_of(scenario, run))
    return judged_of(scenario, run.signals.reference, traces, numbers, limits)


def judged_of(
    scenario: ScenarioSpec, reference: np.ndarray, traces: Traces, numbers: Measures, limits: Sequence[Limit]
) -> Driven:
    """Signals of one plant with their measures by name, and the limits that these keep.

    Args:
        scenario: the spec's.
        reference: the setpoint at the signals' times.
        traces: one row.
        numbers: one number a measure.
        limits: the spec's.
    """
    from fopi_tune.validation.judged import MEASURE_VALUES

    measures = {name: float(MEASURE_VALUES[name](numbers)[0]) for name in MEASURES}
    kept = tuple((e, _keeps(e, measures[e.measure])) for e in limits if e.scenario in (None, scenario.name))
    jumps = np.flatnonzero(np.diff(traces.mode[0])) + 1
    return Driven(
        scenario, reference, traces, measures, kept, bool(numbers.chattering[0]), tuple(traces.time_s[jumps].tolist())
    )


def continuous_of(scenario: ScenarioSpec, found: Continuous, limits: Sequence[Limit]) -> Driven:
    """The same of a run in continuous time."""
    driven = judged_of(scenario, found.reference, found.traces, found.measures, limits)
    if not found.measures.finite[0]:
        driven = replace(driven, limits=tuple((limit, False) for limit, _ in driven.limits))
    return replace(driven, switch_times_s=found.switch_times_s, accuracy=found.accuracy, outcome=found.outcome)


def _keeps(limit: Limit, value: float) -> bool:
    return value <= limit.limit if limit.relation is Relation.AT_MOST else value >= limit.limit


def draw_stamp(index: int | None, drawn: ValidationSpec | None) -> dict[str, Any]:
    """What it takes, besides the spec, to make a drawn plant again."""
    if index is None or drawn is None:
        return {}
    return {"seed": drawn.seed, "samples": drawn.samples, "samples_file_sha256": drawn.samples_file_sha256}


def chosen(scenarios: Sequence[ScenarioSpec], only: str | None) -> tuple[ScenarioSpec, ...]:
    """The scenarios to drive.

    Raises:
        DomainError: there is none, or none of this name.
    """
    if not scenarios:
        raise DomainError("the spec has no scenario; add scenarios: with a name, duration_s and reference")
    found = tuple(each for each in scenarios if only in (None, each.name))
    if not found:
        names = ", ".join(each.name for each in scenarios)
        raise DomainError(f"there is no scenario {only!r}; there is {names}")
    return found


def place_of(
    family: PlantFamily, drawn: ValidationSpec, plant: Mapping[str, float] | None, index: int | None
) -> np.ndarray:
    """A plant's place in its family's box, shape (p,).

    Args:
        family: the box.
        drawn: how plants are drawn.
        plant: uncertain numbers by name, the nominal ones where left out.
        index: of a draw, instead.

    Raises:
        DomainError: an unknown number, an index that was not drawn, or a place that is no plant.
    """
    place = _named_place(family, plant or {}) if index is None else _drawn_place(family, drawn, index)
    if (problem := why_impossible(place, family)) is not None:
        raise DomainError(f"{'this' if index is None else f'draw {index}'} is no plant: {problem}")
    return place


def _drawn_place(family: PlantFamily, drawn: ValidationSpec, index: int) -> np.ndarray:
    from fopi_tune.validation.drawn import draw_of
    from fopi_tune.validation.draws import points

    if not 0 <= index < drawn.samples:
        raise DomainError(f"plant {index} was not drawn; the spec draws {drawn.samples}, from 0 on")
    return points(draw_of(drawn), family, index, 1)[0]


def _named_place(family: PlantFamily, named: Mapping[str, float]) -> np.ndarray:
    for name, value in named.items():
        if name not in family.uncertain_names:
            known = ", ".join(family.uncertain_names) or "none: every number is known"
            raise DomainError(f"{name!r} is no uncertain number of the plant; there is {known}")
        if not math.isfinite(value):
            raise DomainError(f"{name} = {value!r} is no finite number")
    nominal = dict(zip(family.uncertain_names, family.nominal_point.tolist(), strict=True))
    return np.array([named.get(name, nominal[name]) for name in family.uncertain_names])

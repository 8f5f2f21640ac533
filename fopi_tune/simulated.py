"""What `fopi simulate` hands out:  one plant driven through a spec's scenarios by its digital controller."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.samples import why_impossible
from fopi_tune.core.sections import Implementation
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import MEASURES, DesignSpec, Limit, Relation, ScenarioSpec, ValidationSpec
from fopi_tune.stamp import Stamp

if TYPE_CHECKING:
    from fopi_tune.validation.scenario import Traces


@dataclass(frozen=True)
class Driven:
    """One scenario of one plant.

    Args:
        scenario: the spec's.
        reference: shape (steps,), output unit.
        traces: the signals, one row.
        measures: word after `limits:` -> value; nan where the output did not stay finite.
        limits: the spec's about this scenario, and whether each is met.
    """

    scenario: ScenarioSpec
    reference: np.ndarray
    traces: Traces
    measures: Mapping[str, float]
    limits: tuple[tuple[Limit, bool], ...]

    def rows(self) -> Iterator[tuple[float, ...]]:
        """time_s, reference, output, rate_per_s, measured, error, demanded, applied; a row a sample."""
        t = self.traces
        columns = (t.output, t.rate, t.measured, t.error, t.demanded, t.applied)
        yield from zip(
            t.time_s.tolist(), self.reference.tolist(), *(column[0].tolist() for column in columns), strict=True
        )


COLUMNS = ("time_s", "reference", "output", "output_rate_per_s", "measured", "error", "control", "control_applied")


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
    """

    spec: DesignSpec
    gains: FoPi
    plant: Mapping[str, float]
    index: int | None
    driven: tuple[Driven, ...]
    stamp: Stamp

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
            "scenarios": [
                {
                    "name": each.scenario.name,
                    "samples": len(each.traces.time_s),
                    "measures": {k: v if math.isfinite(v) else None for k, v in each.measures.items()},
                    "limits": [
                        {"name": e.measure, "relation": e.relation.value, "limit": e.limit, "met": met}
                        for e, met in each.limits
                    ],
                }
                for each in self.driven
            ],
            "stamp": {"spec_sha256": self.stamp.spec_sha256, **self._draw()},
        }

    def _draw(self) -> dict[str, Any]:
        """What it takes, besides the spec, to make a drawn plant again."""
        drawn = self.spec.validation
        if self.index is None or drawn is None:
            return {}
        return {"seed": drawn.seed, "samples": drawn.samples, "samples_file_sha256": drawn.samples_file_sha256}


def drive(
    spec: DesignSpec,
    gains: FoPi,
    implementation: Implementation,
    stamp: Stamp,
    *,
    only: str | None = None,
    plant: Mapping[str, float] | None = None,
    index: int | None = None,
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

    Raises:
        DomainError: no scenario, an unknown one, an unknown number, an index that was not drawn, or a place that is no
            plant.
    """
    from fopi_tune.validation.judged import MEASURE_VALUES, horizon_of, scenario_of
    from fopi_tune.validation.montecarlo import controller_of
    from fopi_tune.validation.reference import measures_of
    from fopi_tune.validation.scenario import Mode
    from fopi_tune.validation.simulate import simulate

    drawn = spec.validation or ValidationSpec()
    place = _place(spec, drawn, plant, index)
    if (problem := why_impossible(place, spec.plant)) is not None:
        raise DomainError(f"{'this' if index is None else f'draw {index}'} is no plant: {problem}")
    first = index if index is not None else 0
    plants = Plants.members(spec.plant, place[None, :])
    controller = controller_of(spec, implementation)
    found = []
    for scenario in _chosen(spec, only):
        run = scenario_of(scenario, implementation, drawn.seed)
        # a function of the index, so that the noise is that of the draw
        traces = simulate([Mode(controller, lambda begin, end: plants)], run, 1, first)
        numbers = measures_of(traces, [controller], run, horizon_of(scenario, run))
        measures = {name: float(MEASURE_VALUES[name](numbers)[0]) for name in MEASURES}
        limits = tuple((e, _keeps(e, measures[e.measure])) for e in spec.limits if e.scenario in (None, scenario.name))
        found.append(Driven(scenario, run.signals.reference, traces, measures, limits))
    return Simulated(spec, gains, spec.plant.describe(place), index, tuple(found), stamp)


def _keeps(limit: Limit, value: float) -> bool:
    return value <= limit.limit if limit.relation is Relation.AT_MOST else value >= limit.limit


def _chosen(spec: DesignSpec, only: str | None) -> tuple[ScenarioSpec, ...]:
    if not spec.scenarios:
        raise DomainError("the spec has no scenario; add scenarios: with a name, duration_s and reference")
    chosen = tuple(each for each in spec.scenarios if only in (None, each.name))
    if not chosen:
        names = ", ".join(each.name for each in spec.scenarios)
        raise DomainError(f"there is no scenario {only!r}; there is {names}")
    return chosen


def _place(spec: DesignSpec, drawn: ValidationSpec, plant: Mapping[str, float] | None, index: int | None) -> np.ndarray:
    from fopi_tune.validation.draws import points
    from fopi_tune.validation.montecarlo import draw_of

    family = spec.plant
    if index is not None:
        if not 0 <= index < drawn.samples:
            raise DomainError(f"plant {index} was not drawn; the spec draws {drawn.samples}, from 0 on")
        return points(draw_of(drawn), family, index, 1)[0]
    named = dict(plant or {})
    for name, value in named.items():
        if name not in family.uncertain_names:
            known = ", ".join(family.uncertain_names) or "none: every number is known"
            raise DomainError(f"{name!r} is no uncertain number of the plant; there is {known}")
        if not math.isfinite(value):
            raise DomainError(f"{name} = {value!r} is no finite number")
    nominal = dict(zip(family.uncertain_names, family.nominal_point.tolist(), strict=True))
    return np.array([named.get(name, nominal[name]) for name in family.uncertain_names])

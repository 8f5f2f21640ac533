"""One scenario of one plant:  controllers, plants, scenario -> ScenarioResult; which scenarios, and which plant."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.core.loops import Plants
from fopi_tune.core.parameter_table import why_impossible
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.terms.numbers import plain_number
from fopi_tune.errors import DomainError
from fopi_tune.results.simulation import JudgedStep, ScenarioResult
from fopi_tune.simulation.notes import step_notes
from fopi_tune.spec.measures import ACCELERATION, JERK, velocity_unit
from fopi_tune.spec.model import MEASURES, Limit, Relation, ScenarioSpec, ValidationSpec

if TYPE_CHECKING:
    from fopi_tune.simulation.fractional.continuous import ContinuousSimulation
    from fopi_tune.simulation.measures import StepMeasures
    from fopi_tune.simulation.scenario import Measures, Mode, Scenario, Traces


_log = logging.getLogger(__name__)


def run_scenario(
    scenario: ScenarioSpec, modes: Sequence[Mode], run: Scenario, limits: Sequence[Limit], index: int, unit: str
) -> ScenarioResult:
    """Simulate one scenario of one plant on samples.

    Args:
        scenario: as the spec states it.
        modes: the controllers, and the plant of each index.
        run: the same scenario with its signals at the controllers' samples.
        limits: of the spec.
        index: of the plant; its noise depends on it.
        unit: of the measurement.
    """
    from fopi_tune.simulation.measures import horizon_of, measures_of, step_measures
    from fopi_tune.simulation.sampled.simulate import simulate

    _log.info("scenario %s: %d samples of one plant", scenario.name, len(run.signals.reference))
    traces, horizon = simulate(modes, run, 1, index), horizon_of(scenario, run)
    numbers = measures_of(traces, [mode.controller for mode in modes], run, horizon)
    steps = step_measures(traces, run, horizon)
    return scenario_result(scenario, run.signals.reference, traces, (numbers, steps), limits, unit)


def scenario_result(
    scenario: ScenarioSpec, reference: np.ndarray, traces: Traces, found: tuple[Measures, StepMeasures],
    limits: Sequence[Limit], unit: str,
) -> ScenarioResult:  # fmt: skip
    """Signals of one plant, their measures by name, and whether each limit is met.

    Args:
        scenario: as the spec states it.
        reference: the setpoint at the signals' times, output unit.
        traces: the signals, one row each.
        found: the measures, one number each, and those of each step.
        limits: of the spec.
        unit: of the measurement.
    """
    from fopi_tune.simulation.measures import measure_values

    numbers, steps = found
    known = [name for name in MEASURES if name != ACCELERATION or velocity_unit(unit) is not None]
    measures = {name: float(measure_values(numbers, name, unit)[0]) for name in known}
    about = [e for e in limits if e.scenario in (None, scenario.name)]
    wanted = {e.measure: float(measure_values(numbers, e.measure, unit)[0]) for e in about}
    jumps = np.flatnonzero(np.diff(traces.mode[0])) + 1
    of_steps = (steps.overshoot, steps.undershoot, steps.settling_s, steps.rise_s, steps.final_error)
    rows = zip(steps.steps, *(values[:, 0] for values in of_steps), strict=True)
    return ScenarioResult(
        scenario,
        reference,
        traces,
        measures,
        tuple((e, _is_met(e, wanted[e.measure])) for e in about),
        bool(numbers.chattering[0]),
        tuple(traces.time_s[jumps].tolist()),
        steps=tuple(
            JudgedStep(s.at_s, s.before, s.value, s.of_load, *(float(number) for number in values))
            for s, *values in rows
        ),
        notes=tuple(step_notes(steps)) if numbers.finite[0] else (),
        finite=bool(numbers.finite[0] or numbers.chattering[0]),
    )


def continuous_result(
    scenario: ScenarioSpec, found: ContinuousSimulation, limits: Sequence[Limit], unit: str, accuracy: float | None
) -> ScenarioResult:
    """The result of a run in continuous time.

    A run that did not stay finite meets no limit; of one that ended early by chattering only the number of jumps so far
    is known, which can break a limit.
    """
    judged = [limit for limit in limits if limit.measure != JERK]
    result = scenario_result(scenario, found.reference, found.traces, (found.measures, found.steps), judged, unit)
    known = {name: value for name, value in result.measures.items() if name != JERK}
    result = replace(result, measures=known)
    if not found.measures.finite[0]:
        jumps = {"switch_count": float(len(found.switch_times_s))} if result.chattering else {}
        result = replace(result, measures={**result.measures, **jumps})
        verdicts = [(limit, _verdict_at_end(limit, result)) for limit, _ in result.limits]
        result = replace(result, limits=tuple(verdicts), steps=(), notes=())
    notes = list(result.notes)
    if len(judged) < len(limits):
        notes.append(f"{JERK} is a measure of samples; the limit on it is not judged in continuous time")
    if accuracy is not None and found.accuracy is not None and found.accuracy > accuracy:
        notes.append(
            f"an accuracy of {accuracy:g} was asked for, and {found.accuracy:.2g} reached with the finest steps"
        )
    return replace(
        result,
        switch_times_s=found.switch_times_s,
        accuracy=found.accuracy,
        outcome=found.outcome,
        notes=tuple(notes),
    )


def _verdict_at_end(limit: Limit, result: ScenarioResult) -> bool | None:
    """Whether a run that did not end meets a limit; None where that is not known."""
    if not result.chattering:
        return False
    if limit.measure != "switch_count":
        return None
    beyond = result.measures["switch_count"] > limit.limit
    if limit.relation is Relation.AT_MOST:
        return False if beyond else None
    return True if result.measures["switch_count"] >= limit.limit else None


def _is_met(limit: Limit, value: float) -> bool:
    return value <= limit.limit if limit.relation is Relation.AT_MOST else value >= limit.limit


def select_scenarios(scenarios: Sequence[ScenarioSpec], only: str | None) -> tuple[ScenarioSpec, ...]:
    """The scenarios to simulate: all, or the one that is named.

    Raises:
        DomainError: there is none of this name.
    """
    found = tuple(each for each in scenarios if only in (None, each.name))
    if not found:
        names = ", ".join(each.name for each in scenarios)
        raise DomainError(f"there is no scenario {only!r}; there is {names}")
    return found


def plant_point(
    family: PlantFamily,
    drawn: ValidationSpec,
    plant: Mapping[str, float] | None,
    index: int | None,
    member: str | None = None,
) -> np.ndarray:
    """The point of a plant in its family's box of uncertain numbers, shape (p,), in the spec's units.

    Args:
        family: the box.
        drawn: how plants are drawn.
        plant: uncertain numbers by name, the nominal ones where left out.
        index: of a Monte Carlo draw to take instead of `plant`.
        member: of a list of plants, the name of the one; the first where left out.  The point is then a place in it.

    Raises:
        DomainError: an unknown number or member, an index that was not drawn, or a point that is no plant.
    """
    if index is not None:
        if member is not None:
            raise DomainError("a plant that was drawn has its member; leave the member out")
        point = _drawn_point(family, drawn, index)
    else:
        point = _point_of_member(family, plant or {}, member)
    if (problem := why_impossible(point, family)) is not None:
        raise DomainError(f"{'this' if index is None else f'draw {index}'} is no plant: {problem}")
    return point


def _point_of_member(family: PlantFamily, named: Mapping[str, float], member: str | None) -> np.ndarray:
    if not isinstance(family, PlantList):
        if member is not None:
            raise DomainError(f"there is no plant {member!r}: the spec has plant:, no list of plants")
        return _named_point(family, named)
    names = [each.name for each in family.members]
    if member is not None and member not in names:
        raise DomainError(f"there is no plant {member!r} in the list; there is {', '.join(names)}")
    index = 0 if member is None else names.index(member)
    return family.place(index, _named_point(family.members[index].family, named)[None, :])[0]


def _drawn_point(family: PlantFamily, drawn: ValidationSpec, index: int) -> np.ndarray:
    from fopi_tune.montecarlo.draws import sample_points
    from fopi_tune.montecarlo.outcomes import sampling_plan_of

    if not 0 <= index < drawn.samples:
        raise DomainError(f"plant {index} was not drawn; the spec draws {drawn.samples}, from 0 on")
    return sample_points(sampling_plan_of(drawn), family, index, 1)[0]


def _named_point(family: PlantFamily, named: Mapping[str, float]) -> np.ndarray:
    if not isinstance(named, Mapping):
        raise DomainError(f"{named!r:.100} is no mapping of numbers by name; give plant={{'time_constant_s': 2.0}}")
    for name, value in named.items():
        if name not in family.uncertain_names:
            known = ", ".join(family.uncertain_names) or "none: every number is known"
            raise DomainError(f"{name!r} is no uncertain number of the plant; there is {known}")
        if not math.isfinite(plain_number(name, value)):
            raise DomainError(f"{name} = {value!r} is no finite number")
    nominal = dict(zip(family.uncertain_names, family.nominal_point.tolist(), strict=True))
    return np.array([named.get(name, nominal[name]) for name in family.uncertain_names])


def refuse_accuracy(accuracy: float | None, exact: bool) -> None:
    """Refuse an accuracy that is none, or of a simulation on samples, which has no step to refine.

    Raises:
        DomainError: it is not finite and greater than 0, or not of a simulation in continuous time.
    """
    if accuracy is None:
        return
    if not exact:
        raise DomainError("the loop on samples is exact at them; an accuracy belongs to exact")
    if not 0.0 < plain_number("accuracy", accuracy) < math.inf:
        raise DomainError(f"accuracy = {accuracy!r} must be finite and greater than 0")


def refuse_start(scenario: ScenarioSpec, plants: Plants, sample_time_s: float) -> None:
    """Refuse a start that some of these plants do not have.

    Raises:
        DomainError: no input holds one at the initial output, or "free" is asked of one that is not of first order.
    """
    from fopi_tune.simulation.sampled.plants import discretize_plants
    from fopi_tune.simulation.scenario import InitialInput, Start

    if scenario.initial_output:
        start = Start(scenario.initial_output, InitialInput(scenario.before))
        try:
            discretize_plants(plants, sample_time_s).initial_state(start)
        except DomainError as error:
            raise DomainError(f"scenario {scenario.name}: {error}") from None

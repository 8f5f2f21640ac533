"""The value of a spec's objective for given gains, from its definition."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.core.loops import Loops
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.proof.verification.crossing_changes import SamplePair
from fopi_tune.proof.verification.results import Place, RequirementResult
from fopi_tune.proof.verification.sample import LoopFunction, Sample, with_work
from fopi_tune.proof.verification.stability import sensitivity_peak
from fopi_tune.proof.verification.worst_case import find_worst_case
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import NEPER_PER_DB
from fopi_tune.quantities.objectives import ObjectiveKind, default_horizon_s
from fopi_tune.spec.model import Objective, Relation

Value = tuple[float | None, Place | None]


def evaluate_objective(
    objective: Objective | None, samples: SamplePair, results: tuple[RequirementResult, ...]
) -> Value:
    """The objective's value and the place where it is worst.

    Args:
        objective: the spec's; None stands for the smallest slack.
        samples: the family with the controller.
        results: of the requirements, for the smallest slack.
    """
    if objective is None:
        return _depth(samples, results)
    return _VALUES[ObjectiveKind(objective.quantity)](objective, samples)


def _depth(samples: SamplePair, results: tuple[RequirementResult, ...]) -> Value:
    """The smallest slack of the inequalities; without inequalities, -ln of the largest |S|."""
    found = smallest_slack(results)
    if found is not None:
        return found
    value, place = _worst(samples.base, sensitivity_peak)
    return (None if value is None else -value), place


def smallest_slack(results: tuple[RequirementResult, ...]) -> Value | None:
    """The smallest slack of the inequalities and its place; None without inequalities."""
    inequalities = [result for result in results if result.requirement.relation is not Relation.EQUALS]
    if not inequalities:
        return None
    for result in inequalities:
        if result.slack is None:
            return None, result.worst
    shallowest = min(inequalities, key=lambda result: np.inf if result.slack is None else result.slack)
    return shallowest.slack, shallowest.worst


def _worst(sample: Sample, criterion: LoopFunction) -> Value:
    found = find_worst_case(sample, criterion)
    return (None if np.isnan(found.value) else found.value), found.place(sample)


def _integral_gain(objective: Objective, samples: SamplePair) -> Value:
    return samples.base.gains.ki, None


def _phase_margin_spread(objective: Objective, samples: SamplePair) -> Value:
    """max |PM - PM(nominal)|, deg; none where a member's margin is infinite or missing."""
    measure = QUANTITIES["phase_margin_deg"].measure
    nominal = measure(samples.base.reference_loop, False, 0.0, np.inf).value[0]

    def criterion(loops: Loops) -> tuple[Array, Array, Array]:
        found = measure(loops, False, 0.0, np.inf)
        with np.errstate(invalid="ignore"):  # margins may be infinite
            apart = np.abs(found.value - nominal)
        return with_work(np.where(np.isfinite(apart), apart, np.nan), found.omega_rad_s, found.work)

    return _worst(samples.refined, criterion)


def _crossover_spread(objective: Objective, samples: SamplePair) -> Value:
    """max |20 log10|L(j omega_c)||, dB, at the nominal member's highest crossover."""
    crossings = gain_crossovers(samples.base.reference_loop)
    if not len(crossings.row):
        return None, None
    omega = float(crossings.omega_rad_s[-1])

    def criterion(loops: Loops) -> tuple[Array, Array]:
        rows = np.arange(len(loops))
        gain = loops.log_response(rows, np.full(len(rows), loops.u_of(np.array(omega)))).real
        return np.abs(gain) / NEPER_PER_DB, np.full(len(rows), omega)

    return _worst(samples.base, criterion)


def _peak(response: Response) -> Callable[[Objective, SamplePair], Value]:
    def value(objective: Objective, samples: SamplePair) -> Value:
        """The largest gain over all members and frequencies, dB."""

        def criterion(loops: Loops) -> tuple[Array, Array, Array]:
            found = extremes(loops, response, 0.0, np.inf)
            return with_work(found.value / NEPER_PER_DB, found.omega_rad_s, found.cells)

        return _worst(samples.base, criterion)

    return value


def _discounted_error(objective: Objective, samples: SamplePair) -> Value:
    """max |int_0^inf e(t) exp(-t/T) dt| after a unit step at the plant's input:  T P/(1 + C P) at s = 1/T.

    On samples the sum Ts sum_k e_k exp(-k Ts/T) = Ts z/(z - 1) z^delay P(z)/(1 + C(z) P(z)) at z = e^{Ts/T}: the
    computing delay is in the loop, not between the step and the plant.
    """
    horizon = default_horizon_s(samples.base.family) if objective.horizon_s is None else objective.horizon_s
    s, implementation = 1.0 / horizon, samples.base.implementation

    def criterion(loops: Loops) -> tuple[Array, Array]:
        plants = loops.plants
        if isinstance(loops, SampledLoops) and implementation is not None:
            step = s * implementation.sample_time_s
            delta = float(np.expm1(step))
            top, bottom = plants.at_real(delta)
            gain = top / bottom * np.exp(-step * loops.plants.late)
            loop = gain * loops.controller_at_real(delta)
            early = np.exp(step * (1.0 + implementation.delay_samples)) * implementation.sample_time_s / delta
            with np.errstate(divide="ignore"):
                return np.abs(early * gain / (1.0 + loop)), np.full(len(loops), np.nan)
        top, bottom = plants.at_real(s)
        numerator = top * np.exp(-s * plants.dead_time_s)
        controller = samples.base.gains(s).real
        with np.errstate(divide="ignore"):
            error = horizon * numerator / (bottom + controller * numerator)
        return np.abs(error), np.full(len(loops), np.nan)

    return _worst(samples.base, criterion)


_VALUES: dict[ObjectiveKind, Callable[[Objective, SamplePair], Value]] = {
    ObjectiveKind.KI: _integral_gain,
    ObjectiveKind.PHASE_MARGIN_SPREAD: _phase_margin_spread,
    ObjectiveKind.CROSSOVER_SPREAD: _crossover_spread,
    ObjectiveKind.SENSITIVITY_PEAK: _peak(Response.SENSITIVITY),
    ObjectiveKind.CONTROL_SENSITIVITY_PEAK: _peak(Response.CONTROL_SENSITIVITY),
    ObjectiveKind.LOAD_SENSITIVITY_PEAK: _peak(Response.LOAD_SENSITIVITY),
    ObjectiveKind.IAE_DISTURBANCE: _discounted_error,
}

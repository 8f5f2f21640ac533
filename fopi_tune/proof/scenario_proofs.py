"""Requirements on measures of scenarios in a certificate:  what is proved of each, its JSON and its check.

Noise is left out: a requirement is about the loop without it.  Where nothing could be shown the requirement stays
checked by simulation; a certificate is no less proved for it, and says which requirements are.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import PlantFamily
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.proof.strict_json import JsonObject, read_most_change
from fopi_tune.proof.verdict import Verdict, overall
from fopi_tune.spec.model import DesignSpec, Knot, Limit, Relation, ScenarioSpec
from fopi_tune.spec.scenarios import MAX_KNOTS

if TYPE_CHECKING:
    from fopi_tune.proof.time_domain import TimeDomainCase, TimeDomainProof

#: most boxes and single plants of one requirement in one scenario
BUDGET = 2_000
#: samples of a scenario that is read
_MOST_SAMPLES = 20_000


@dataclass(frozen=True)
class ScenarioProof:
    """What is proved of one requirement in one scenario.

    Args:
        index: of the requirement in the spec's list of those on scenarios.
        case: loop, scenario and limit.
        proof: the result.
    """

    index: int
    case: TimeDomainCase
    proof: TimeDomainProof


def prove_scenarios(
    spec: DesignSpec, implementation: Implementation, tolerance: float
) -> tuple[ScenarioProof, ...]:  # fmt: skip
    """Prove or refute each requirement in each of its scenarios.

    Args:
        spec: with its scenarios, family and limits of the control.
        implementation: the digital controller, whose stored numbers are taken as exact.
        tolerance: by how much a limit may be missed, relative (of overshoots to the step).
    """
    from fopi_tune.proof.time_domain import prove_limit

    return tuple(
        ScenarioProof(index, case, prove_limit(case, tolerance, BUDGET))
        for index, case in cases_of(spec, implementation)
    )


def cases_of(spec: DesignSpec, implementation: Implementation) -> list[tuple[int, TimeDomainCase]]:
    """What is to be proved, in the order of the requirements and, of one about all scenarios, of these."""
    from fopi_tune.proof.time_domain import TimeDomainCase

    digital, box = spec.digital, spec.controller
    assert digital is not None
    limits, rate = digital.output_limits, digital.output_rate_per_s
    controller = Runtime.of(implementation.sections, Precision.FLOAT64, limits, rate)
    on_error = not box.has_derivative and box.setpoint_weight == 1.0
    on_error = on_error and box.setpoint_weight_range is None and box.measurement_filter is None
    return [
        (
            index,
            TimeDomainCase(
                spec.plant, controller, implementation.sample_time_s, implementation.delay_samples,
                replace(scenario, noise_std=0.0), _meaning(limit), digital.measurement_unit, on_error,
            ),
        )
        for index, limit in enumerate(spec.scenario_requirements)
        for scenario in spec.scenarios
        if limit.scenario in (None, scenario.name)
    ]  # fmt: skip


def verdict_of(proofs: Sequence[ScenarioProof], index: int) -> Verdict | None:
    """Of one requirement in all its scenarios; None where none was tried."""
    own = tuple(each.proof.verdict for each in proofs if each.index == index)
    return overall(own) if own else None


def decided(proofs: Sequence[ScenarioProof]) -> tuple[Verdict, ...]:
    """The verdicts that count in a certificate: those that are not left to the check by simulation."""
    return tuple(each.proof.verdict for each in proofs if each.proof.verdict is not Verdict.UNDECIDED)


def _meaning(limit: Limit) -> Limit:
    """A limit without where it is written, and for which scenarios."""
    return Limit(limit.measure, limit.relation, limit.limit)


# -- JSON -------------------------------------------------------------------------------------------------------------


def scenario_entries(proofs: Sequence[ScenarioProof]) -> list[dict[str, Any]]:
    """The entries of a certificate's JSON."""
    if not proofs:
        return []
    from fopi_tune.proof.time_domain.documents import to_document

    return [
        {
            "requirement": each.index,
            "scenario": _scenario_dict(each.case.scenario),
            "measurement_unit": each.case.measurement_unit,
            "output_limits": [end if math.isfinite(end) else None for end in each.case.output_limits],
            **({"most_change": each.case.controller.most_change} if each.case.controller.limits_rate else {}),
            **({} if each.case.acts_on_error else {"acts_on_error": False}),
            "proof": to_document(each.case, each.proof),
        }
        for each in proofs
    ]


def read_scenario_proofs(
    entries: Sequence[JsonObject], family: PlantFamily, implementation: Implementation | None
) -> tuple[ScenarioProof, ...]:
    """Read them; types and ranges alone are checked.

    Args:
        entries: of the certificate.
        family: its plants.
        implementation: its digital controller.

    Raises:
        CertificateError: an entry is missing or has the wrong type, or there is no digital controller.
    """
    if not entries:
        return ()
    if implementation is None:
        raise CertificateError("scenarios: there is no digital controller that could run them")
    return tuple(_read(entry, family, implementation) for entry in entries)


def _read(entry: JsonObject, family: PlantFamily, implementation: Implementation) -> ScenarioProof:
    from fopi_tune.proof.time_domain import TimeDomainCase
    from fopi_tune.proof.time_domain.documents import from_document

    said = entry.child("proof")
    limit = Limit(said.text("measure"), said.word("relation", Relation), said.number("limit"))
    index = entry.count_or_none("requirement")
    ends = entry.get("output_limits")
    if index is None or index < 0 or not isinstance(ends, list) or len(ends) != 2:
        raise CertificateError(f"{entry.place} names no requirement, or no two output_limits")
    low, high = (entry_end(end, sign, entry) for end, sign in zip(ends, (-1.0, 1.0), strict=True))
    change = read_most_change(entry)
    on_error = entry.flag("acts_on_error") if "acts_on_error" in entry.value else True
    try:
        controller = Runtime.of(implementation.sections, Precision.FLOAT64, (low, high))
        controller = replace(controller, most_change=change)
        scenario = _read_scenario(entry.child("scenario"), implementation.sample_time_s)
        case = TimeDomainCase(
            family, controller, implementation.sample_time_s, implementation.delay_samples, scenario, limit,
            entry.text("measurement_unit"), on_error,
        )  # fmt: skip
        return ScenarioProof(index, case, from_document(case, said.value, said.place))
    except DomainError as error:
        raise CertificateError(f"{entry.place}: {error}") from None


def entry_end(value: object, sign: float, entry: JsonObject) -> float:
    """An end of the control's range; null is none."""
    if value is None:
        return sign * math.inf
    return JsonObject({"end": value}, entry.at("output_limits")).number("end")


def _scenario_dict(scenario: ScenarioSpec) -> dict[str, Any]:
    found = asdict(scenario)
    del found["noise_std"], found["quantum"]
    found["rate_per_s"] = scenario.rate_per_s if math.isfinite(scenario.rate_per_s) else None
    for name in ("reference", "load"):
        found[name] = [[knot.at_s, knot.value, knot.ramp_s] for knot in getattr(scenario, name)]
    return found


def _read_scenario(entry: JsonObject, sample_time_s: float) -> ScenarioSpec:
    rate, band = entry.number_or_none("rate_per_s"), entry.number_or_none("settling_band")
    duration, before = entry.number("duration_s"), entry.text("before")
    if not 0.0 < duration <= _MOST_SAMPLES * sample_time_s or before not in ("rest", "free"):
        raise CertificateError(f"{entry.place} is no scenario of at most {_MOST_SAMPLES} samples")
    if not 0.0 <= entry.number("judged_from_s") < duration:
        raise CertificateError(f"{entry.place}: judged_from_s must be at least 0, and before the end")
    if (rate is not None and not rate > 0.0) or (band is not None and not band > 0.0):
        raise CertificateError(f"{entry.place}: rate_per_s and settling_band must be greater than 0")
    return ScenarioSpec(
        name=entry.text("name"),
        duration_s=duration,
        reference=_read_knots(entry, "reference", duration),
        load=_read_knots(entry, "load", duration),
        initial_output=entry.number("initial_output"),
        before=before,
        bumpless=entry.flag("bumpless"),
        rate_per_s=math.inf if rate is None else rate,
        settling_band=band,
        judged_from_s=entry.number("judged_from_s"),
    )


def _read_knots(entry: JsonObject, key: str, duration: float) -> tuple[Knot, ...]:
    rows = entry.get(key)
    if not isinstance(rows, list) or len(rows) > MAX_KNOTS:
        raise CertificateError(f"{entry.at(key)} is no list of at most {MAX_KNOTS} entries")
    knots, free_from = [], -math.inf
    for number, row in enumerate(rows):
        numbers = JsonObject({"row": row}, f"{entry.at(key)}[{number}]").numbers("row")
        if len(numbers) != 3 or not (0.0 <= numbers[0] < duration and numbers[2] >= 0.0 and numbers[0] > free_from):
            raise CertificateError(f"{entry.at(key)}[{number}] is no time, value and ramp after the one before")
        free_from = max(numbers[0], math.nextafter(numbers[0] + numbers[2], -math.inf))
        knots.append(Knot(*numbers))
    return tuple(knots)


# -- check ------------------------------------------------------------------------------------------------------------


def scenario_problems(proofs: Sequence[ScenarioProof], tolerance: float) -> list[str]:
    """What does not hold of the proofs in a certificate.

    Args:
        proofs: as they were read.
        tolerance: of the certificate, which says it of all its limits.
    """
    if not proofs:
        return []
    from fopi_tune.proof.time_domain import recheck_limit

    numbers = [each.index for each in proofs]
    gaps = [(0, numbers[0])]
    gaps += [(before + 1, after) for before, after in itertools.pairwise(numbers) if after != before]
    problems = [
        f"scenarios: requirement {found} stands where requirement {expected} is expected"
        for expected, found in gaps
        if expected != found
    ]
    for place, each in enumerate(proofs):
        if each.proof.tolerance != tolerance:
            problems.append(f"scenarios[{place}]: its tolerance {each.proof.tolerance!r} is not the certificate's")
        problems += [f"scenarios[{place}]: {problem}" for problem in recheck_limit(each.case, each.proof)]
    return problems


def mismatches(proofs: Sequence[ScenarioProof], spec: DesignSpec, implementation: Implementation | None) -> list[str]:
    """Differences between what the proofs are about and the spec's requirements on scenarios."""
    if not spec.scenario_requirements and not proofs:
        return []
    if implementation is None:
        return ["the spec has requirements on scenarios, the certificate no digital controller"]
    asked = [(index, _content(case)) for index, case in cases_of(spec, implementation)]
    stated = [(each.index, _content(each.case)) for each in proofs]
    return [] if asked == stated else ["the requirements on scenarios are not those of the spec"]


def _content(case: TimeDomainCase) -> tuple[object, ...]:
    about = case.scenario, case.limit, case.measurement_unit
    return *about, case.output_limits, case.controller.most_change, case.acts_on_error

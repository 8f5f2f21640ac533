"""Never a wrong proof with a fractional plant:  limits 1e-4 and less around the worst case, against a dense evaluation.

Plants of two to six terms, with none up to two uncertain numbers, late or not; controllers of structure fopi and fopid.
"""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest
from cases.limits_told_apart import OFFSET, SLOW_S, outcomes
from cases.random_fractional import family_of, published, random_controller, random_sides
from oracles.fractional_loops import FractionalMembers

from fopi_tune.core.controller import FoPi, FoPid
from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.certificate import Verdict
from fopi_tune.proof.documents import to_document
from fopi_tune.spec import parse_spec

#: of the random numbers
SALT = 53
SPEC = """schema: 1
name: heat
plant:
  model: {model}
{plant}
requirements:
  - {{phase_margin_deg: {{at_least: 55}}}}
  - {{sensitivity_db: {{at_most: 4}}}}
  - {{delay_margin_s: {{at_least: 0.1}}}}
objective: {{maximize: ki}}
"""
TERMS = """  numerator: [{coefficient: {min: 0.9, max: 1.2}, order: 0}]
  denominator: [{coefficient: 1, order: 1}, {coefficient: {min: 0.6, max: 0.8}, order: 2}]
  dead_time_s: 0.05"""
POLYNOMIALS = """  numerator: [{min: 0.9, max: 1.2}]
  denominator: [{min: 0.6, max: 0.8}, 1, 0]
  dead_time_s: 0.05"""


def _family(rng: np.random.Generator) -> FractionalMembers:
    late = float(rng.choice([0.0, 10.0 ** rng.uniform(-2.0, 0.3)]))
    plants = family_of(random_sides(rng), late, float(rng.uniform(0.02, 0.3)), int(rng.integers(3)))
    found = random_controller(rng)
    return FractionalMembers(plants, found)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(("seeds", "least"), [(range(2), 1), pytest.param(range(2, 40), 16, marks=pytest.mark.long)])
def test_limits_around_the_worst_case_of_a_fractional_plant_are_told_apart(seeds: range, least: int) -> None:
    assert OFFSET <= 1e-4
    counted, undecided, _ = outcomes(seeds, _family, SALT)
    # |L| that falls as omega^-0.07 reaches its limit beyond what a double can hold
    assert set(undecided) <= {28}
    assert counted["told apart"] >= least, counted


@pytest.mark.long
@pytest.mark.parametrize("block", range(6))
def test_limits_around_the_worst_cases_of_three_hundred_fractional_plants(
    block: int, record_property: Callable[[str, object], None]
) -> None:
    counted, undecided, times = outcomes(range(1000 + 50 * block, 1050 + 50 * block), _family, SALT)
    record_property("outcomes", dict(counted))
    print(dict(counted), "undecided:", undecided, "slow:", [round(t, 1) for t in times if t > SLOW_S], max(times))
    assert len(undecided) <= 2, undecided
    assert counted["told apart"] >= 30


def test_the_published_loop_is_proved_and_its_certificate_stands_on_its_own() -> None:
    gains = FoPid(-0.002934, 0.01030, 0.9, 0.05335, 0.5, 0.05)
    text = SPEC.format(model="fractional", plant="")
    spec = parse_spec(
        text.replace(
            "  model: fractional\n",
            "  model: fractional\n  numerator: [{coefficient: {min: 60, max: 72, nominal: 66.16}, order: 0}]\n"
            "  denominator: [{coefficient: 12.72, order: 0.5}, {coefficient: 1, order: 0}]\n  dead_time_s: 1.93\n",
        )
    )
    certificate = certify(spec, verify(spec, gains), {})
    assert certificate.stability.verdict is Verdict.PROVED
    assert [each.verdict for each in certificate.requirements] == [Verdict.PROVED] * 3
    document = json.loads(json.dumps(to_document(certificate), allow_nan=False))
    assert recheck(document).problems == ()
    # with another order the same claims are about another family
    document["plant"]["denominator_orders"] = [0.9, 0.0]
    assert recheck(document).problems != ()
    assert published().orders.denominator == (0.5, 0.0)


def test_whole_orders_are_proved_as_the_transfer_function() -> None:
    gains = FoPi(0.4, 0.01, 0.8)
    certificates = []
    for model, plant in (("fractional", TERMS), ("transfer_function", POLYNOMIALS)):
        spec = parse_spec(SPEC.format(model=model, plant=plant))
        certificates.append(to_document(certify(spec, verify(spec, gains), {})))
    one, other = certificates
    assert [each["verdict"] for each in one["requirements"]] == ["proved"] * 3
    # but for the names of the numbers
    said = json.dumps([one["stability"], one["requirements"]])
    said = said.replace("numerator[0].coefficient", "numerator[0]").replace(
        "denominator[1].coefficient", "denominator[0]"
    )
    assert json.loads(said) == [other["stability"], other["requirements"]]

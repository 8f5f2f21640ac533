"""Never a wrong proof of plants by named parameters:  random expressions against dense samples.

The samples evaluate the expressions by Python itself and share no code with what reads and proves them.  Limits lie
just short of the worst value of a sample, where nothing may be proved, or beyond it.
"""

from __future__ import annotations

import itertools
import math
import random
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from cases.parametric_plants import BENCHMARK, LEADS, expression, family_of, qft_benchmark
from cases.plants import spec_of, transfer_function
from numpy.typing import NDArray
from oracles.dense_margins import Continuous, UncertainError

import fopi_tune as ft
from fopi_tune.core.plant import Plant, PlantFamily
from fopi_tune.errors import SpecError
from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.certificate import Certificate, Verdict
from fopi_tune.proof.documents import to_document
from fopi_tune.spec.model import Relation, Requirement

Array = NDArray[np.float64]
NAMES = ("a", "b", "k")
#: of the numerator and of the denominator; k, a and b are positive
NUMERATORS = (["k"], ["k * a"], ["k", "k * b"], ["k / a"], ["b - k/20", "k"], ["(k + a)**2 / b"], ["k", "2*k*a + 1"])
DENOMINATORS = (
    ["a", 1],
    [1, "a + b", "a * b"],
    [1, "2*a*b", "b**2"],
    ["a * b", "a + b + k/10", 1],
    [1, "a", "a**2 / b", "k * a**3 / 20"],
    ["a", "b - a/2", "a*b - b/4 + 0.3"],
    [1, "(a + b)**2 / (a*b)", "1/a + 1/b"],
    ["b", "a*b", 0],
    [1, "3*a", "3*a**2", "a**3"],
)
OMEGA = np.geomspace(1e-3, 1e3, 1200)


@dataclass(frozen=True)
class Case:
    """A family as text, and what it is by Python's arithmetic."""

    ranges: dict[str, tuple[float, float]]
    numerator: Sequence[object]
    denominator: Sequence[object]
    gains: ft.FoPi

    @property
    def used(self) -> list[str]:
        """The parameters that occur."""
        return [name for name in NAMES if any(name in str(each) for each in (*self.numerator, *self.denominator))]

    def family(self) -> PlantFamily:
        ranges = {name: self.ranges[name] for name in self.used}
        return family_of(ranges, self.numerator, self.denominator)

    def plant(self, point: Iterable[float]) -> Plant:
        values = dict(zip(self.used, point, strict=True))
        top, bottom = (
            tuple(float(eval(str(each), {}, dict(values))) for each in side)
            for side in (self.numerator, self.denominator)
        )
        return Plant(top, bottom)

    def expanded(self) -> PlantFamily:
        """The box of the coefficients, each by itself; a little wider, as a sample may miss their ends."""
        points = self.points(9)
        plants = [self.plant(point) for point in points]
        tops, bottoms = (np.array([getattr(p, side) for p in plants]) for side in ("numerator", "denominator"))
        wide = [[(c.min(), c.max(), 0.02 * (c.max() - c.min())) for c in side.T] for side in (tops, bottoms)]
        boxes = [[(float(low - more), float(high + more)) for low, high, more in side] for side in wide]
        top, bottom = ([low if low == high else (low, high) for low, high in box] for box in boxes)
        return transfer_function(top, bottom)

    def points(self, count: int) -> list[tuple[float, ...]]:
        axes = [np.linspace(*self.ranges[name], count).tolist() for name in self.used]
        return list(itertools.product(*axes))

    def loop(self, point: Iterable[float]) -> Continuous:
        return Continuous(self.plant(point), self.gains.kp, self.gains.ki, self.gains.alpha)

    def value(self, point: Iterable[float], quantity: str, omega: Array = OMEGA) -> float:
        """The largest |S| or |T| of one plant over some frequencies, in dB."""
        plant, s = self.plant(point), 1j * omega
        controller = self.gains.kp + self.gains.ki * s**-self.gains.alpha
        loop = controller * np.polyval(plant.numerator, s) / np.polyval(plant.denominator, s)
        size = np.abs(1.0 / (1.0 + loop)) if quantity == "sensitivity_db" else np.abs(loop / (1.0 + loop))
        return 20.0 * math.log10(float(size.max()))


def case_of(seed: int) -> Case:
    """Stable in most cases."""
    rng = np.random.default_rng(seed)
    found = None
    for _ in range(20):
        ranges = {}
        for name in NAMES:
            low = float(np.exp(rng.uniform(-1.0, 1.0)))
            ranges[name] = (low, low * float(np.exp(rng.uniform(0.02, 0.6))))
        numerator = _some_at_random(rng, NUMERATORS[int(rng.integers(len(NUMERATORS)))])
        denominator = _some_at_random(rng, DENOMINATORS[int(rng.integers(len(DENOMINATORS)))])
        alpha = 1.0 if rng.random() < 0.6 else float(rng.uniform(0.6, 1.3))
        kp, ki = np.exp(rng.uniform(-2.5, 1.5, 2)).tolist()
        if len(numerator) > len(denominator):
            continue
        try:
            now = Case(ranges, numerator, denominator, ft.FoPi(kp, ki, alpha))
            now.family()
        except SpecError:  # a divisor may be 0
            continue
        found = now
        try:
            middle = [0.5 * sum(ranges[name]) for name in found.used]
            if rng.random() < 0.1 or found.loop(middle).is_stable:
                return found
        except UncertainError:
            continue
    assert found is not None
    return found


def _some_at_random(rng: np.random.Generator, side: Sequence[object]) -> list[object]:
    """Some coefficients replaced by random expressions, which are positive unless they are 0."""
    words = random.Random(int(rng.integers(1 << 30)))
    return [
        f"({expression(words, list(NAMES), 2)})**2 / 4 + 0.2" if each != 0 and rng.random() < 0.2 else each
        for each in side
    ]


def proved(case: Case, requirement: Requirement, rechecked: bool) -> Certificate:
    spec = spec_of(case.family(), requirement)
    certificate = certify(spec, verify(spec, case.gains), {})
    if rechecked:
        assert recheck(to_document(certificate), spec).problems == ()
    return certificate


def outcome(seed: int) -> str:
    """What became of one family.

    Raises:
        AssertionError: a wrong proof, a refutation at a plant that does not break the limit, or a looser linked family.
    """
    case = case_of(seed)
    rng = np.random.default_rng([seed, 1])
    quantity = str(rng.choice(["sensitivity_db", "complementary_sensitivity_db"]))
    count = {1: 25, 2: 9, 3: 5}[len(case.used)]
    points = case.points(count)
    try:
        stable = all(case.loop(point).is_stable for point in points)
    except UncertainError:
        return "not told"
    worst = max(case.value(point, quantity) for point in points) if stable else 0.0
    inside = bool(rng.random() < 0.5)
    limit = worst - 1e-3 if inside else worst + 0.3
    certificate = proved(case, Requirement(quantity, Relation.AT_MOST, (limit,)), seed % 4 == 0)
    verdict = certificate.requirements[0].verdict
    if certificate.stability.verdict is Verdict.PROVED:
        assert stable, f"seed {seed}: an unstable family"
    if verdict is Verdict.PROVED and stable:
        # what bounds a response holds of unstable loops too
        assert not inside, f"seed {seed}: a wrong proof"
    if verdict is Verdict.REFUTED and stable and not inside:
        place = certificate.requirements[0].sides[0].worst
        assert place.omega_rad_s is not None
        reached = case.value(place.point, quantity, np.array([place.omega_rad_s or 1e-30]))
        assert not case.loop(place.point).is_stable or reached > limit - 1e-3, f"seed {seed}: refuted"
        return "worse found"
    if not inside and verdict is Verdict.PROVED:
        is_never_looser(case, quantity, seed)
    return str(verdict) if stable else f"unstable, {verdict}"


def is_never_looser(case: Case, quantity: str, seed: int) -> None:
    """The worst value of the linked family against that of the box of its coefficients."""
    asked = Requirement(quantity, Relation.AT_MOST, (0.1,))
    expanded = case.expanded()
    if any(n.min <= 0.0 <= n.max for name, n in expanded.parameters.items() if name == "denominator[0]"):
        return
    values = []
    for family in (case.family(), expanded):
        found = verify(spec_of(family, asked), case.gains)
        values.append(found.requirements[0].achieved if found.stability.stable else math.inf)
    assert values[0] <= values[1] + 1e-6, f"seed {seed}: {values}"


def outcomes(seeds: Iterable[int]) -> Counter[str]:
    return Counter(outcome(seed) for seed in seeds)


def test_no_limit_short_of_a_sampled_value_is_proved() -> None:
    assert outcomes((7, 8)) == {"proved": 1, "refuted": 1}


@pytest.mark.long
@pytest.mark.parametrize("block", range(10))
def test_no_limit_short_of_a_sampled_value_is_proved_of_a_hundred_families(
    block: int, record_property: Callable[[str, object], None]
) -> None:
    counted = outcomes(range(100 + 50 * block, 112 + 50 * block))
    record_property("outcomes", dict(counted))
    print(dict(counted))
    assert counted["undecided"] <= 3
    assert counted["proved"] >= 1


#: of the benchmark's parameters a part with the same worst plant
NARROW = "{k: {min: 9, max: 10}, a: {min: 1, max: 1.2}, b: {min: 20, max: 21}}"


@pytest.mark.parametrize("parameters", [NARROW, pytest.param(BENCHMARK, marks=pytest.mark.long)])
@pytest.mark.parametrize(("lead", "worst_db"), LEADS.items())
def test_the_published_benchmark_is_proved_to_its_worst_value(lead: str, worst_db: float, parameters: str) -> None:
    spec, gains = qft_benchmark(lead, worst_db + 0.001, parameters), ft.FoPi(1.0, 0.0, 1.0)
    certificate = certify(spec, verify(spec, gains), {})
    (proof,) = certificate.requirements
    (side,) = proof.sides
    assert proof.verdict is Verdict.PROVED
    assert side.level is not None
    assert side.witness is not None
    # printed with three decimals
    assert 20.0 * side.witness / math.log(10.0) == pytest.approx(worst_db, abs=6e-4)
    assert side.level - side.witness <= 1e-4
    assert side.worst.plant == {"k": 10.0, "a": 1.0, "b": 20.0}
    short = replace(spec, requirements=(replace(spec.requirements[0], limits=(worst_db - 0.001,)),))
    assert certify(short, verify(short, gains), {}).requirements[0].verdict is Verdict.REFUTED

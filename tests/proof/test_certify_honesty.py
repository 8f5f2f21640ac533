"""Never a wrong proof:  random designs with their limit just inside and just outside what the family really does.

The true worst value comes from the search in floating point, which shares no formula with the ball arithmetic.  A limit
1e-5 beyond it (relative, or of angles in rad) must be proved, one 1e-5 short of it must be refuted.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from cases.thinned import thinned

import fopi_tune as ft
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.proof import Verification, certify, recheck, verify
from fopi_tune.proof.documents import to_document
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import ControllerSpec, DesignSpec, GainRange, Relation, Requirement, Scope

ANY = ControllerSpec(GainRange(), GainRange(), GainRange())
OFFSET = 1e-5


def number(rng: np.random.Generator, value: float, widest: float, share: float) -> Uncertain:
    """A known number, or with this share of cases an uncertain one."""
    if value == 0.0 or rng.random() >= share:
        return Uncertain.exactly(value)
    width = float(rng.uniform(1.05, widest))
    ends = sorted((value / width, value * width))
    return Uncertain(value, ends[0], ends[1])


def family(rng: np.random.Generator) -> PlantFamily:
    """Lags, poles (integrating and unstable ones too), second and third order; nought to four uncertain numbers."""

    def u(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    kind = rng.choice(["lag", "lag", "pole", "second", "third"])
    delay = float(rng.choice([0.0, u(0.05, 0.8)]))
    if kind == "lag":
        gain, tau = number(rng, u(0.3, 5), 1.5, 0.3), number(rng, u(0.5, 3), 1.8, 0.8)
        dead_time = number(rng, delay, 1.4, 0.3)
        return PlantFamily("lag", {"static_gain": gain, "time_constant_s": tau, "dead_time_s": dead_time})
    if kind == "pole":
        pole = float(rng.choice([u(0.05, 2), 0.0, -u(0.05, 0.3)]))
        gain, dead_time = number(rng, u(0.3, 5), 1.5, 0.6), number(rng, 0.3 * delay, 1.4, 0.3)
        return PlantFamily("pole", {"gain": gain, "pole_rad_s": number(rng, pole, 1.5, 0.6), "dead_time_s": dead_time})
    if kind == "second":
        numerator = [number(rng, u(0.5, 2), 1.3, 0.3)]
        denominator = [Uncertain.exactly(1.0), number(rng, u(0.4, 2), 1.4, 0.5), number(rng, u(0.4, 2), 1.4, 0.5)]
    else:
        numerator = [number(rng, u(-0.3, 0.3), 1.3, 0.3), number(rng, u(0.5, 2), 1.3, 0.3)]
        denominator = [Uncertain.exactly(1.0), *(number(rng, u(*r), 1.2, 0.4) for r in ((2.5, 4), (2, 3), (0.4, 2)))]
    parameters = {f"numerator[{k}]": value for k, value in enumerate(numerator)}
    parameters |= {f"denominator[{k}]": value for k, value in enumerate(denominator)}
    return PlantFamily("transfer_function", parameters | {"dead_time_s": Uncertain.exactly(0.3 * delay)})


def requirement(rng: np.random.Generator) -> Requirement:
    quantity = str(rng.choice(list(QUANTITIES)))
    low, high = 0.0, math.inf
    if QUANTITIES[quantity].takes_band:
        kind = rng.integers(0, 4)
        low = 0.0 if kind < 2 else float(10 ** rng.uniform(-2, 1))
        high = math.inf if kind in (0, 2) else max(low, 0.03) * float(10 ** rng.uniform(0, 2))
    scope = Scope(rng.choice(["family", "family", "nominal"]))
    return Requirement(quantity, Relation(rng.choice(["at_least", "at_most"])), (1.0,), scope, low, high)


def design(seed: int) -> tuple[DesignSpec, ft.FoPi]:
    rng = np.random.default_rng(seed)
    plants, asked = family(rng), requirement(rng)
    kp = float(rng.choice([0.0, 1.0, 1.0, 1.0]) * 10 ** rng.uniform(-1.3, 0.5))
    gains = ft.FoPi(kp, float(10 ** rng.uniform(-1.3, 0.3)), float(rng.uniform(0.35, 1.45)))
    return DesignSpec(f"seed_{seed}", plants, ANY, (asked,)), gains


def moved_limit(spec: DesignSpec, worst: float, outwards: float) -> DesignSpec:
    asked = spec.requirements[0]
    quantity = QUANTITIES[asked.quantity]
    natural = quantity.to_natural(worst)
    scale = max(abs(natural), 0.2) if asked.quantity in ("phase_margin_deg", "delay_margin_s") else 1.0
    sign = 1.0 if asked.relation is Relation.AT_MOST else -1.0
    limit = quantity.from_natural(natural + sign * outwards * OFFSET * scale)
    return dataclasses.replace(spec, requirements=(dataclasses.replace(asked, limits=(limit,)),))


def certified(spec: DesignSpec, gains: ft.FoPi) -> tuple[Verification, ft.Certificate]:
    found = verify(spec, gains)
    certificate = certify(spec, found, {})
    assert recheck(to_document(certificate), spec).problems == ()
    return found, certificate


def check_honesty(seed: int) -> str:
    """What was looked at: a bound, an unstable loop, or a quantity without end."""
    spec, gains = design(seed)
    try:
        found, first = certified(spec, gains)
    except ft.DomainError:
        return "no list of crossings"
    if not found.stability.stable:
        assert first.stability.verdict is ft.Verdict.REFUTED
        return "unstable"
    assert first.stability.verdict is ft.Verdict.PROVED
    worst = found.requirements[0].extremes[0].achieved
    if worst is None or math.isinf(worst):
        met = found.requirements[0].is_met
        assert first.verdict is (ft.Verdict.PROVED if met else ft.Verdict.REFUTED)
        return "endless"
    _, beyond = certified(moved_limit(spec, worst, +1.0), gains)
    assert beyond.verdict is ft.Verdict.PROVED, beyond.requirements
    _, short = certified(moved_limit(spec, worst, -1.0), gains)
    assert short.verdict is ft.Verdict.REFUTED, short.requirements
    return "bound"


#: 27 s, as much as the other 47 together
SLOW = (1001,)


@pytest.mark.thinned(slow=["0", "4"])
@pytest.mark.parametrize("block", thinned(range(6)))
def test_limits_around_the_true_worst_case_are_told_apart(block: int) -> None:
    kinds = [check_honesty(seed) for seed in range(1000 + 8 * block, 1008 + 8 * block) if seed not in SLOW]
    assert "bound" in kinds


def test_a_limit_that_plants_at_the_border_of_stability_break_is_refuted() -> None:
    # |S| of 262 dB is rounding: balls show less, and any limit is broken
    spec, gains = design(2077)
    for outwards in (0.0, 1.0):
        found, certificate = certified(moved_limit(spec, 1.0 + 260.0 * outwards, outwards), gains)
        assert not found.stability.stable
        assert certificate.requirements[0].verdict is ft.Verdict.REFUTED


@pytest.mark.long
@pytest.mark.parametrize("seed", SLOW)
def test_limits_around_the_true_worst_case_of_a_slow_design_are_told_apart(seed: int) -> None:
    assert check_honesty(seed) == "bound"


@pytest.mark.long
@pytest.mark.parametrize("block", range(20))
def test_limits_around_the_true_worst_case_of_five_hundred_designs(block: int) -> None:
    kinds = [check_honesty(seed) for seed in range(2000 + 25 * block, 2025 + 25 * block)]
    assert kinds.count("bound") >= 8

"""Loops on samples: never a wrong proof, never a wrong refutation, and no certificate that was changed.

The true worst value comes from `oracles.sampled_loops`: state space, dense scans of the frequencies and of the box, and
local refinement.  A limit 1e-5 beyond it (in natural units, or relative) must be proved, one 1e-5 short of it refuted.
"""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from cases.plants import brake, lag, pole, spec_of, transfer_function
from oracles.sampled_families import worst_of

import fopi_tune as ft
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.plant import PlantFamily
from fopi_tune.digital.oustaloup import modified_oustaloup, oustaloup
from fopi_tune.digital.transforms import matched, tustin
from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.documents import digest, to_document
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import DesignSpec, Relation, Requirement, Scope

OFFSET = 1e-5
REFERENCE = ft.FoPi(0.24027, 0.39344, 0.9)
Document = dict[str, Any]
#: what the oracle can measure, and on which side
ASKED = (
    *((name, upper) for name in ("sensitivity_db", "complementary_sensitivity_db") for upper in (True, True, False)),
    *((name, upper) for name in ("control_sensitivity_db", "loop_gain_db") for upper in (True, False)),
    *((name, False) for name in ("phase_margin_deg", "gain_margin_db", "delay_margin_s")),
    *(("crossover_rad_s", upper) for upper in (True, False)),
)
SLOPES = tuple(("phase_slope_deg_per_decade", upper) for upper in (True, False))


def filter_of(gains: ft.FoPi, sample_time_s: float, kind: int) -> Sections:
    """Some way to approximate s^-alpha on samples."""
    band = (1e-2 / sample_time_s / 30.0, 3.0 / sample_time_s)
    if kind == 0:
        return tustin(gains, oustaloup(gains.alpha, 4, band), sample_time_s)
    if kind == 1:
        return tustin(gains, modified_oustaloup(gains.alpha, 4, band), sample_time_s)
    return matched(gains, oustaloup(gains.alpha, 3, band), sample_time_s, 0.1 / sample_time_s)


def family(rng: np.random.Generator, sample_time_s: float) -> PlantFamily:
    """Lags, poles and second order with one to three uncertain numbers and any dead time."""

    def about(value: float, share: float) -> tuple[float, float, float] | float:
        if rng.random() >= share:
            return value
        width = float(rng.uniform(1.05, 1.4))
        ends = sorted((value / width, value * width))
        return value, ends[0], ends[1]

    u = rng.uniform
    dead_time = float(rng.choice([0.0, sample_time_s, float(u(0.1, 2.5)) * sample_time_s]))
    kind = rng.integers(0, 4)
    if kind <= 1:
        late = about(dead_time, 0.4) if dead_time > 0.0 else 0.0
        return lag(about(u(0.4, 3.0), 0.3), about(u(0.5, 4.0), 1.0), late)
    if kind == 2:
        slow = float(rng.choice([u(0.05, 1.0), 0.0, -u(0.02, 0.1)]))
        return pole(about(u(0.3, 1.5), 1.0), about(slow, 0.5) if slow != 0.0 else 0.0, dead_time)
    numerator = [u(-0.3, 0.3), u(0.5, 2.0)] if rng.random() < 0.5 else [u(0.5, 2.0)]
    denominator = [1.0, about(u(0.6, 2.0), 1.0), about(u(0.4, 2.0), 0.4)]
    return transfer_function(numerator, denominator, dead_time)


def design(seed: int, choice: Sequence[tuple[str, bool]] = ASKED) -> tuple[DesignSpec, ft.FoPi, Implementation, bool]:
    """A random spec with one limit that is not set yet, gains, and a filter; and the limit's side."""
    rng = np.random.default_rng(seed)
    sample_time_s = float(10.0 ** rng.uniform(-1.3, 0.0))
    plants = family(rng, sample_time_s)
    name, upper = choice[int(rng.integers(len(choice)))]
    low, high = 0.0, math.inf
    nyquist = math.pi / sample_time_s
    if QUANTITIES[name].takes_band:
        low = float(nyquist * 10.0 ** rng.uniform(-2.0, -0.5)) if rng.random() < 0.6 or name == "loop_gain_db" else 0.0
        low = low if upper else float(max(low, 0.02 * nyquist))
        high = math.inf if rng.random() < 0.5 else float(max(low, 0.05 * nyquist) * rng.uniform(1.0, 3.0))
    gains = ft.FoPi(
        float(rng.choice([0.0, 1.0, 1.0, 1.0]) * 10.0 ** rng.uniform(-1.3, 0.1)),
        float(10.0 ** rng.uniform(-1.3, -0.1)),
        float(rng.uniform(0.4, 1.3)),
    )
    delay = float(rng.choice([0.0, 0.0, 0.5, 1.0, rng.uniform(0.0, 3.0)]))
    implementation = Implementation(filter_of(gains, sample_time_s, int(rng.integers(3))), delay)
    relation = Relation.AT_MOST if upper else Relation.AT_LEAST
    asked = Requirement(name, relation, (1.0,), Scope.FAMILY, low, high)
    return spec_of(plants, asked, name=f"seed_{seed}"), gains, implementation, upper


def verdict_at(spec: DesignSpec, gains: ft.FoPi, implementation: Implementation, natural: float) -> ft.Certificate:
    """The certificate of the spec with its limit at this value; it must also stand on its own."""
    asked = spec.requirements[0]
    limit = QUANTITIES[asked.quantity].from_natural(natural)
    moved = Requirement(asked.quantity, asked.relation, (limit,), asked.scope, asked.from_rad_s, asked.to_rad_s)
    with_limit = spec_of(spec.plant, moved, name=spec.name)
    certificate = certify(with_limit, verify(with_limit, gains, implementation=implementation), {}, implementation)
    document = json.loads(json.dumps(to_document(certificate), allow_nan=False))
    assert recheck(document, with_limit).problems == ()
    return certificate


def check_honesty(seed: int, choice: Sequence[tuple[str, bool]] = ASKED) -> str:
    """What was looked at: a bound, an unstable loop, or a quantity that a plant does not have."""
    spec, gains, implementation, upper = design(seed, choice)
    worst, radius = worst_of(spec, implementation)
    if abs(radius - 1.0) < 1e-4:
        return "marginal"
    if radius > 1.0:
        certificate = certify(spec, verify(spec, gains, implementation=implementation), {}, implementation)
        assert certificate.stability.verdict is ft.Verdict.REFUTED
        assert recheck(to_document(certificate), spec).problems == ()
        return "unstable"
    if math.isnan(worst) or abs(worst) > 20.0:  # |L| passes 0 at Nyquist's frequency somewhere in the family
        return "none"
    if spec.requirements[0].quantity == "delay_margin_s" and worst <= 0.0:
        return "none"
    relative = spec.requirements[0].quantity in ("phase_margin_deg", "delay_margin_s")
    step = OFFSET * (max(abs(worst), 0.2) if relative else 1.0) * (1.0 if upper else -1.0)
    beyond = verdict_at(spec, gains, implementation, worst + step)
    assert beyond.stability.verdict is ft.Verdict.PROVED
    (proof,) = beyond.requirements
    at_nyquist = (proof.sides[0].worst.omega_rad_s or 0.0) > 0.99 * implementation.nyquist_rad_s
    if proof.verdict is ft.Verdict.UNDECIDED and at_nyquist and len(spec.plant.low) > 1 and not upper:
        # a known limit: a smallest value at z = -1 of a plant of higher order takes too many boxes
        return "undecided"
    assert proof.verdict is ft.Verdict.PROVED, (worst, proof.reason)
    short = verdict_at(spec, gains, implementation, worst - step)
    assert short.requirements[0].verdict is ft.Verdict.REFUTED, (worst, short.requirements[0].bounds)
    return "bound"


#: seeds of cheap designs, one uncertain number each: what CI has time for
QUICK = (5, 12, 15, 26, 100, 104, 106, 113, 127, 2)
QUICK_SLOPES = (2000, 2001, 2012)


def test_limits_around_the_true_worst_case_are_told_apart() -> None:
    kinds = [check_honesty(seed) for seed in QUICK]
    assert kinds.count("bound") == 9
    assert kinds.count("unstable") == 1


def test_phase_slopes_just_inside_and_just_outside_the_true_worst_one_are_told_apart() -> None:
    assert [check_honesty(seed, SLOPES) for seed in QUICK_SLOPES].count("bound") == len(QUICK_SLOPES)


@pytest.mark.long
@pytest.mark.parametrize("block", range(5))
def test_phase_slopes_of_fifty_designs_are_told_apart(block: int) -> None:
    assert "bound" in [check_honesty(seed, SLOPES) for seed in range(2000 + 10 * block, 2010 + 10 * block)]


@pytest.mark.long
@pytest.mark.parametrize("block", range(20))
def test_limits_around_the_true_worst_case_of_hundreds_of_designs(block: int) -> None:
    kinds = [check_honesty(seed) for seed in range(1000 + 10 * block, 1010 + 10 * block)]
    assert "bound" in kinds


# -- what an ordinary loop asks ---------------------------------------------------------------------------------------


def outcome(plants: PlantFamily, gains: ft.FoPi, implementation: Implementation, asked: Requirement) -> ft.Certificate:
    spec = spec_of(plants, asked)
    certificate = certify(spec, verify(spec, gains, implementation=implementation), {}, implementation)
    assert recheck(to_document(certificate), spec).problems == ()
    return certificate


def reference_filter(sample_time_s: float = 0.2, gains: ft.FoPi = REFERENCE) -> Sections:
    return tustin(gains, oustaloup(gains.alpha, 7, (1e-3, 1e3)), sample_time_s)


@pytest.mark.parametrize("delay", [37.0, 100.0, 200.5])
def test_stability_is_decided_however_many_samples_the_delay_has(delay: float) -> None:
    """At 0.01 s: up to 2 s of delay before the loop's crossover at 0.3 rad/s."""
    asked = Requirement("sensitivity_db", Relation.AT_MOST, (10.0,))
    certificate = outcome(brake(), REFERENCE, Implementation(reference_filter(0.01), delay), asked)
    assert certificate.verdict is ft.Verdict.PROVED


def test_the_phase_margin_of_an_integrating_plant_with_a_lag_is_proved() -> None:
    gains = ft.FoPi(0.1, 0.05, 0.9)
    plants = transfer_function([(1.0, 0.9, 1.1)], [1.0, 1.0, 0.0])
    asked = Requirement("phase_margin_deg", Relation.AT_LEAST, (20.0,))
    certificate = outcome(plants, gains, Implementation(reference_filter(gains=gains)), asked)
    assert certificate.verdict is ft.Verdict.PROVED


@pytest.mark.parametrize(
    ("name", "relation"),
    [
        ("control_sensitivity_db", Relation.AT_MOST),
        ("sensitivity_db", Relation.AT_MOST),
        ("loop_gain_db", Relation.AT_LEAST),
    ],
)
def test_a_peak_at_nyquists_frequency_is_proved_as_sharply_as_any_other(name: str, relation: Relation) -> None:
    """P control: |S| and |C S| rise, and |L| falls, up to z = -1, where they stay above 0."""
    asked = Requirement(name, relation, (30.0 if relation is Relation.AT_MOST else -30.0,), from_rad_s=1.0)
    gains = ft.FoPi(5.0, 0.0, 0.9)
    certificate = outcome(brake(), gains, Implementation(Sections(0.2, 5.0, (), ())), asked)
    (proof,) = certificate.requirements
    assert proof.verdict is ft.Verdict.PROVED
    assert proof.sides[0].worst.omega_rad_s == pytest.approx(math.pi / 0.2, rel=1e-6)
    assert proof.gap is not None
    assert proof.gap < 1e-6


def test_a_slow_pole_hardly_matters_at_nyquists_frequency_and_its_boxes_show_it() -> None:
    """|S| is largest at z = -1, 1.3e-5 neper below the limit, for every pole of the family."""
    gains, asked = ft.FoPi(0.6653, 0.133, 1.0), Requirement("sensitivity_db", Relation.AT_MOST, (3.0,))
    certificate = outcome(pole(4.39, (0.1746, 0.15, 0.2)), gains, Implementation(reference_filter(gains=gains)), asked)
    assert certificate.verdict is ft.Verdict.PROVED
    assert certificate.boxes < 1000


def test_a_crossover_limit_above_nyquists_frequency_is_decided() -> None:
    implementation = Implementation(reference_filter())
    above = outcome(brake(), REFERENCE, implementation, Requirement("crossover_rad_s", Relation.AT_MOST, (1e5,)))
    below = outcome(brake(), REFERENCE, implementation, Requirement("crossover_rad_s", Relation.AT_LEAST, (1e5,)))
    assert (above.verdict, below.verdict) == (ft.Verdict.PROVED, ft.Verdict.REFUTED)


@pytest.mark.parametrize("offset", [0.0, 1e-15, 1e-14, 1e-13, 1e-9])
def test_requirements_next_to_nyquists_frequency_end_in_a_verdict(offset: float) -> None:
    start = math.pi / 0.2 * (1.0 - offset)
    asked = Requirement("sensitivity_db", Relation.AT_MOST, (3.0,), from_rad_s=start)
    found = outcome(brake(), REFERENCE, Implementation(reference_filter()), asked)
    assert found.requirements[0].verdict is (ft.Verdict.PROVED if offset > 1e-12 else ft.Verdict.UNDECIDED)


def test_a_direct_path_late_by_three_samples_is_so_in_the_proof_too() -> None:
    """0.6 is a little less than three times 0.2: the proof must not be about two samples and a part."""
    plants = transfer_function([0.3, 1.0], [1.0, 1.0], 0.6)
    asked = Requirement("sensitivity_db", Relation.AT_MOST, (3.0,))
    gains = ft.FoPi(0.4, 0.2, 0.9)
    (proof,) = outcome(plants, gains, Implementation(reference_filter(gains=gains)), asked).requirements
    assert proof.gap is not None  # the witness is the verification's own worst value
    assert proof.gap < 1e-6


# -- files ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sound() -> Document:
    implementation = Implementation(reference_filter())
    spec = spec_of(
        brake(),
        Requirement("sensitivity_db", Relation.AT_MOST, (3.0,)),
        Requirement("crossover_rad_s", Relation.AT_MOST, (3.0,)),
        Requirement("phase_margin_deg", Relation.AT_LEAST, (60.0,)),
    )
    found = certify(spec, verify(spec, REFERENCE, implementation=implementation), {}, implementation)
    document = json.loads(json.dumps(to_document(found), allow_nan=False))
    assert recheck(document).is_sound
    return document


def changed(document: Document, change: Callable[[Document], object]) -> Document:
    """A copy with a change, sealed again where the numbers allow it."""
    copied = copy.deepcopy(document)
    change(copied)
    if json.dumps(copied).find("NaN") < 0:
        copied["digest"] = digest(copied)
    return copied


def put(key: str, value: object, index: int | None = None) -> Callable[[Document], None]:
    def change(document: Document) -> None:
        if index is None:
            document["implementation"][key] = value
        else:
            document["implementation"][key][index] = value

    return change


#: sealed again, and still not what was proved
TAMPERINGS: dict[str, Callable[[Document], object]] = {
    "another pole": put("poles", 0.9, 3),
    "a negative pole": put("poles", -0.999999, 3),
    "no integrator": put("poles", 0.5, 0),
    "another residue": put("residues", 0.05, 2),
    "another integral": put("residues", 0.2, 0),
    "another direct path": put("direct", 2.0),
    "more delay": put("delay_samples", 1.0),
    "a part of a sample": put("delay_samples", 0.5),
    "a delay of a thousand samples": put("delay_samples", 1000.0),
    "slower samples": put("sample_time_s", 0.3),
    "samples for ever": put("sample_time_s", 1e308),
    "no time between samples": put("sample_time_s", 5e-324),
    "an endless direct path": put("direct", 1e308),
    "no implementation at all": lambda d: d.pop("implementation"),
    "one more word": put("extra", 1),
    "a band above Nyquist's frequency": lambda d: d["requirements"][0].update(from_rad_s=100.0),
    "a level above Nyquist's frequency": lambda d: d["requirements"][1]["sides"][0].update(level_natural=5.0),
}


@pytest.mark.parametrize("name", TAMPERINGS)
def test_a_changed_implementation_is_refused_even_with_a_new_digest(sound: Document, name: str) -> None:
    assert recheck(changed(sound, TAMPERINGS[name])).problems


#: what no certificate holds, and a word of what is said about it
HOSTILE: dict[str, tuple[Callable[[Document], object], str]] = {
    "a pole that is no number": (put("poles", math.nan, 1), "finite"),
    "a pole as text": (put("poles", "0.9", 1), "finite"),
    "a pole outside": (put("poles", 1e308, 1), "sections"),
    "a pole at -1": (put("poles", -1.0, 1), "sections"),
    "two integrators": (put("poles", 1.0, 1), "sections"),
    "a million poles": (put("poles", [0.5] * 10**6), "more than"),
    "fewer residues": (put("residues", [1.0]), "sections"),
    "negative samples": (put("sample_time_s", -0.2), "sample time"),
    "no samples": (put("sample_time_s", 0.0), "sample time"),
    "a negative delay": (put("delay_samples", -1.0), "sample time"),
    "an endless delay": (put("delay_samples", 1e308), "samples long"),
    "a list instead": (lambda d: d.update(implementation=[]), "object"),
    "samples far too many": (lambda d: d["plant"]["parameters"][2].update(max=1e300, nominal=1.0), "samples long"),
}


@pytest.mark.thinned(slow=["million"])
@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_implementation_is_named(sound: Document, name: str) -> None:
    change, said = HOSTILE[name]
    with pytest.raises(ft.CertificateError, match=said):
        recheck(changed(sound, change))

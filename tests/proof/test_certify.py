"""Certificates: the reference values, every shipped spec, refutations, what is undecided, and the way through tune."""

from __future__ import annotations

import dataclasses
import importlib
import math
import sys

import numpy as np
import pytest
from cases import plants
from cases.project import CONTINUOUS
from cases.shipped_designs import design_of

import fopi_tune as ft
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.certificate import RequirementProof
from fopi_tune.proof.documents import to_document
from fopi_tune.quantities.base import NEPER_PER_DB
from fopi_tune.spec import load_spec, parse_spec
from fopi_tune.spec.model import DesignSpec

SHIPPED = sorted(path.stem for path in CONTINUOUS.glob("*.yaml"))
#: PM 75 deg at 0.3 rad/s for tau = 2.35; its peak |S| over the brake's family is 1.1637075 at omega = 0.522, tau = 3.1
REFERENCE = ft.FoPi(0.24027, 0.39344, 0.9)


def decibel(value: float) -> float:
    return 20.0 * math.log10(value)


def spec_with(requirements: str, plant: str = "{model: lag, static_gain: 1.0, time_constant_s: {min: 1.6, max: 3.1}}"):
    lines = "".join(f"  - {line}\n" for line in requirements.split("\n"))
    controller = "{kp: {min: 0, max: 10}, ki: {min: 0, max: 10}, alpha: {min: 0.3, max: 1.5}}"
    return parse_spec(f"schema: 1\nname: t\nplant: {plant}\ncontroller: {controller}\nrequirements:\n{lines}")


def proved(spec: DesignSpec, gains: ft.FoPi) -> ft.Certificate:
    """The certificate, which must also stand on its own."""
    certificate = certify(spec, verify(spec, gains), {})
    assert recheck(to_document(certificate), spec).problems == ()
    return certificate


@pytest.mark.parametrize(
    ("peak", "verdict"), [(1.16371, ft.Verdict.PROVED), (1.16370, ft.Verdict.REFUTED), (1.2, ft.Verdict.PROVED)]
)
def test_the_reference_peak_is_proved_just_above_and_refuted_just_below(peak: float, verdict: ft.Verdict) -> None:
    certificate = proved(spec_with(f"sensitivity_db: {{at_most: {decibel(peak)!r}}}"), REFERENCE)
    (proof,) = certificate.requirements
    assert proof.verdict is verdict
    assert certificate.verdict is verdict
    (side,) = proof.sides
    assert side.witness is not None
    # the reference is given to 8 digits
    assert math.exp(side.witness) == pytest.approx(1.1637075, abs=5e-8)
    assert side.worst.omega_rad_s == pytest.approx(0.522, abs=5e-4)
    assert side.worst.plant == {"time_constant_s": 3.1}
    if verdict is ft.Verdict.PROVED:
        assert proof.gap is not None
        assert proof.gap <= 1e-6


def test_the_reference_phase_margins_are_enclosed() -> None:
    spec = spec_with("phase_margin_deg: {between: [60, 90]}")
    (proof,) = proved(spec, REFERENCE).requirements
    low, high = proof.bounds
    assert low is not None
    assert high is not None
    # the reference is given to 0.1 deg
    assert (low, high) == (pytest.approx(68.9, abs=0.05), pytest.approx(83.3, abs=0.05))


@pytest.mark.thinned(slow=["lag_gain"])
@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_spec_is_proved_to_the_gap_asked_for(name: str) -> None:
    spec = load_spec(CONTINUOUS / f"{name}.yaml")
    design = ft.tune(spec)
    assert design.status is ft.Status.SOLVED
    certificate = design.certificate
    assert certificate is not None
    assert certificate.verdict is ft.Verdict.PROVED
    assert recheck(to_document(certificate), spec).is_sound
    # one, two and three uncertain numbers
    gap_allowed = {0: 1e-6, 1: 1e-6, 2: 1e-4, 3: 1e-3}[len(spec.plant.uncertain_names)]
    for proof in certificate.requirements:
        endless = proof.requirement.quantity == "gain_margin_db" and proof.gap is None
        assert endless or (proof.gap is not None and proof.gap <= gap_allowed), proof.requirement
        if proof.requirement.relation.value == "equals":
            low, high = proof.bounds
            assert low is not None
            assert high is not None
            assert high - low <= 1e-9
            assert low - 1e-9 <= proof.requirement.limits[0] <= high + 1e-9


@pytest.mark.thinned(slow=["lag_gain"])
@pytest.mark.parametrize("name", SHIPPED)
def test_proved_bounds_hold_on_a_dense_sample(name: str) -> None:
    """The float verification searches, this sample does not: no member may lie beyond what is proved."""
    spec = load_spec(CONTINUOUS / f"{name}.yaml")
    design = ft.tune(spec)
    assert design.certificate is not None
    assert design.gains is not None
    rng = np.random.default_rng(5)
    share = np.concatenate(
        [rng.uniform(size=(300, len(spec.plant.low))), rng.integers(0, 2, (40, len(spec.plant.low)))]
    )
    loops = Loops.of(
        design.gains, Plants.members(spec.plant, spec.plant.low + share * (spec.plant.high - spec.plant.low))
    )
    for proof in design.certificate.requirements:
        requirement = proof.requirement
        if requirement.scope.value != "family":
            continue
        quantity = ft_quantity(proof)
        for largest, bound in zip((False, True), proof.bounds, strict=True):
            if bound is None:
                continue
            values = quantity.measure(loops, largest, requirement.from_rad_s, requirement.to_rad_s).value
            # 1e-9: rounding of the sample's own values
            assert np.all(values <= bound + 1e-9) if largest else np.all(values >= bound - 1e-9), requirement


def ft_quantity(proof: RequirementProof):
    from fopi_tune.quantities import QUANTITIES

    return QUANTITIES[proof.requirement.quantity]


def test_the_published_brake_gains_are_refuted_with_a_plant_and_a_frequency() -> None:
    certificate = proved(load_spec(CONTINUOUS / "brake.yaml"), ft.FoPi(0.07, 0.11, 0.45))
    assert certificate.verdict is ft.Verdict.REFUTED
    crossover = certificate.requirements[0]
    assert crossover.verdict is ft.Verdict.REFUTED
    # PAPER.md: 0.0083834 rad/s instead of 0.3
    assert crossover.bounds[1] == pytest.approx(0.0083834, abs=5e-8)


def test_an_unstable_loop_with_a_small_sensitivity_is_refuted() -> None:
    """P = 1/(s - 1) with kp = 0.5: |S| never exceeds 2, and the pole stays on the right."""
    spec = spec_with("sensitivity_db: {at_most: 20}", "{model: pole, gain: 1.0, pole_rad_s: {min: -1.2, max: -0.9}}")
    gains = ft.FoPi(0.5, 1e-9, 1.0)
    certificate = proved(spec, gains)
    peak = extremes(Loops.of(gains, Plants.of(spec.plant.member(np.array([-1.0])))), Response.SENSITIVITY, 0.0, np.inf)
    assert peak.value[0] < 20 * NEPER_PER_DB
    assert certificate.requirements[0].verdict is ft.Verdict.PROVED
    assert certificate.stability.verdict is ft.Verdict.REFUTED
    assert certificate.stability.poles
    assert certificate.verdict is ft.Verdict.REFUTED


def test_instability_hidden_between_stable_members_is_refuted() -> None:
    """Stable at both ends of the box and unstable inside: den = s^2 + (a - 0.5)^2-like damping is not in the language,
    so the dead time does it: a small gain is stable at both ends of a gain range only if the middle is."""
    spec = spec_with(
        "sensitivity_db: {at_most: 60}",
        "{model: lag, static_gain: {min: 0.5, max: 4.0}, time_constant_s: 1.0, dead_time_s: {min: 0.1, max: 1.0}}",
    )
    certificate = proved(spec, ft.FoPi(1.0, 0.8, 0.9))
    assert certificate.stability.verdict is ft.Verdict.REFUTED
    assert certificate.verdict is ft.Verdict.REFUTED


SOME_WITHOUT = "{model: lag, static_gain: {min: 0.4, max: 4.0}, time_constant_s: 1}"


@pytest.mark.parametrize("quantity", ["phase_margin_deg", "delay_margin_s"])
def test_plants_without_a_gain_crossover_have_infinite_margins(quantity: str) -> None:
    # k/(s + 1): no crossover for k < 1, and the smallest margins at k = 4, where omega^2 = 15
    angle, omega = math.pi - math.atan(math.sqrt(15.0)), math.sqrt(15.0)
    least = math.degrees(angle) if quantity == "phase_margin_deg" else angle / omega
    for relation, limit, verdict in (
        ("at_least", 0.999 * least, ft.Verdict.PROVED),
        ("at_least", 1.001 * least, ft.Verdict.REFUTED),
        ("at_most", 1.001 * least, ft.Verdict.REFUTED),
        ("at_most", 179.0, ft.Verdict.REFUTED),
    ):
        spec = spec_with(f"{quantity}: {{{relation}: {limit!r}}}", SOME_WITHOUT)
        (proof,) = proved(spec, ft.FoPi(1.0, 0.0, 1.0)).requirements
        assert proof.verdict is verdict, (relation, limit)
        if verdict is ft.Verdict.PROVED:
            assert proof.bounds[0] == pytest.approx(least, rel=1e-5)


@pytest.mark.parametrize("relation", ["at_least: 0.1", "at_most: 9"])
def test_a_plant_without_gain_crossover_refutes_any_limit_of_it(relation: str) -> None:
    (proof,) = proved(spec_with(f"crossover_rad_s: {{{relation}}}", SOME_WITHOUT), ft.FoPi(1.0, 0.0, 1.0)).requirements
    assert proof.verdict is ft.Verdict.REFUTED
    assert "no gain crossover" in proof.reason


@pytest.mark.thinned(4)
@pytest.mark.parametrize(
    ("requirement", "gains"),
    [
        ("gain_margin_db: {at_least: 6}", ft.FoPi(2.0, 0.5, 1.4)),
        ("gain_margin_db: {between: [6, 40]}", ft.FoPi(2.0, 0.5, 1.4)),
        ("delay_margin_s: {between: [0.1, 60]}", ft.FoPi(2.0, 0.5, 1.2)),
        ("phase_slope_deg_per_decade: {between: [-200, 50]}", ft.FoPi(2.0, 0.5, 1.2)),
        ("crossover_rad_s: {between: [0.1, 5]}", ft.FoPi(2.0, 0.5, 1.2)),
        ("complementary_sensitivity_db: {at_most: 12}", ft.FoPi(2.0, 0.5, 1.2)),
        ("control_sensitivity_db: {at_most: 20}", ft.FoPi(2.0, 0.5, 1.2)),
        ("{loop_gain_db: {at_most: -3}, from_rad_s: 5}", ft.FoPi(2.0, 0.5, 1.2)),
        ("{loop_gain_db: {at_least: 10}, to_rad_s: 0.02}", ft.FoPi(2.0, 0.5, 1.2)),
        ("{sensitivity_db: {between: [-60, -10]}, from_rad_s: 0.01, to_rad_s: 0.05}", ft.FoPi(2.0, 0.5, 1.2)),
        ("{sensitivity_db: {at_most: 6}, at_rad_s: 1.0}", ft.FoPi(2.0, 0.5, 1.2)),
    ],
)
@pytest.mark.parametrize(
    "plant",
    [
        "{model: lag, static_gain: 1.0, time_constant_s: {min: 1.6, max: 3.1}, dead_time_s: 0.2}",
        "{model: lag, static_gain: {min: 0.9, max: 1.1}, time_constant_s: 2, dead_time_s: {min: 0.1, max: 0.3}}",
        "{model: pole, gain: {min: 0.4, max: 0.6}, pole_rad_s: {min: 0.3, max: 0.6}, dead_time_s: 0.1}",
        "{model: transfer_function, numerator: [1.0], denominator: [1, {min: 2.4, max: 2.8}, {min: 0.9, max: 1.2}]}",
    ],
    ids=["lag", "gain_and_delay", "pole", "second_order"],
)
def test_every_quantity_is_decided_and_its_bound_is_tight(requirement: str, gains: ft.FoPi, plant: str) -> None:
    certificate = proved(spec_with(requirement, plant), gains)
    (proof,) = certificate.requirements
    assert proof.verdict is not ft.Verdict.UNDECIDED
    if proof.verdict is ft.Verdict.PROVED and not endless(spec_with(requirement, plant), gains):
        assert proof.gap is not None
        assert proof.gap <= 1e-4


def endless(spec: DesignSpec, gains: ft.FoPi) -> bool:
    """Whether the quantity is a gain margin without end."""
    return math.inf in [end.achieved for end in verify(spec, gains).requirements[0].extremes]


def test_a_margin_beyond_the_limit_by_less_than_the_tolerance_is_proved_and_says_by_how_much() -> None:
    worst = 1.1637074769  # of the reference, by brute force in floating point
    spec = spec_with(f"sensitivity_db: {{at_most: {decibel(worst * (1 - 4e-7))!r}}}")
    (proof,) = proved(spec, REFERENCE).requirements
    assert proof.verdict is ft.Verdict.PROVED
    bound = proof.bounds[1]
    assert bound is not None
    assert spec.requirements[0].limits[0] < bound <= decibel(worst * (1 + 1e-6))


DIRECT = "{model: transfer_function, numerator: [1, 2], denominator: [1, 10], dead_time_s: {min: 0.01, max: 0.02}}"
THROUGH_0 = "denominator: [1, {min: -0.1, max: 0.1}, {min: 0.9, max: 1.1}], dead_time_s: 0.05}"


@pytest.mark.thinned(slow=["long_delay", "direct_peak"])
@pytest.mark.parametrize(
    ("plant", "gains", "requirement"),
    [
        # the range of a coefficient passes 0
        (
            f"{{model: transfer_function, numerator: [4, 2], {THROUGH_0}",
            ft.FoPi(1.0, 0.2, 0.9),
            "sensitivity_db: {at_most: 9}",
        ),
        # a direct path inside an uncertain dead time, |L(inf)| = 0.8
        (DIRECT, ft.FoPi(0.8, 1.0, 0.9), "phase_margin_deg: {at_least: 30}"),
        (DIRECT, ft.FoPi(0.8, 1.0, 0.9), "sensitivity_db: {at_most: 20}"),
        # an undamped pair of poles, known exactly
        (
            "{model: transfer_function, numerator: [1, 1], denominator: [1, 0, 1]}",
            ft.FoPi(1.0, 0.1, 0.5),
            "phase_margin_deg: {at_least: 30}",
        ),
        # a dead time a million times the time constant
        (
            "{model: lag, static_gain: 0.05, time_constant_s: {min: 0.9, max: 1.1}, dead_time_s: 1.0e+6}",
            ft.FoPi(0.5, 1e-9, 1.0),
            "sensitivity_db: {at_most: 30}",
        ),
    ],
    ids=["through_0", "direct_margin", "direct_peak", "undamped", "long_delay"],
)
def test_an_odd_plant_is_proved(plant: str, gains: ft.FoPi, requirement: str) -> None:
    certificate = proved(spec_with(requirement, plant), gains)
    assert certificate.stability.verdict is ft.Verdict.PROVED
    assert certificate.verdict is ft.Verdict.PROVED


@pytest.mark.parametrize(
    ("plant", "gains"),
    [
        # infinitely many poles: |L(inf)| = 3 around a dead time
        (
            "{model: transfer_function, numerator: [1, 2], denominator: [1, 3], dead_time_s: 0.1}",
            ft.FoPi(3.0, 1.0, 1.0),
        ),
        # the integral is cancelled
        ("{model: transfer_function, numerator: [1, 0], denominator: [1, 2, 1]}", ft.FoPi(1.0, 1.0, 1.0)),
    ],
    ids=["direct_path", "cancelled"],
)
def test_an_instability_without_poles_to_count_is_refuted(plant: str, gains: ft.FoPi) -> None:
    certificate = proved(spec_with("{loop_gain_db: {at_most: 60}, from_rad_s: 1}", plant), gains)
    assert certificate.stability.verdict is ft.Verdict.REFUTED


def test_a_loop_on_the_verge_is_not_called_violated() -> None:
    """1/s with a dead time just below pi/2 is stable; |S| reaches 10^6."""
    plant = f"{{model: pole, gain: 1, pole_rad_s: 0, dead_time_s: {math.pi / 2 - 1e-6!r}}}"
    check = ft.prove(spec_with("crossover_rad_s: {equals: 1}", plant), ft.FoPi(1.0, 0.0, 1.0))
    assert check.status in ("met", "undecided")
    assert check.certificate.verdict is not ft.Verdict.REFUTED


def test_a_witness_that_cannot_be_had_is_given_up_at_once() -> None:
    """alpha next to 2: the phase crossover is not to be enclosed, and there is no box to cut for it."""
    spec = load_spec(CONTINUOUS / "brake.yaml")
    certificate = proved(spec, ft.FoPi(1.0, 1.0, 1.999999999))
    # the search for its witness looked at one box, not at thousands of copies of it
    assert certificate.boxes < 20_000


@pytest.mark.parametrize("tolerance", [0.0, -1.0, 0.02, 1000.0, math.nan, math.inf])
def test_a_tolerance_that_would_prove_anything_is_refused(tolerance: float) -> None:
    with pytest.raises(ft.DomainError, match="tolerance"):
        ft.prove(CONTINUOUS / "brake.yaml", REFERENCE, tolerance)


# -- the way through the pipeline -----------------------------------------------------------------------------------


def test_solved_means_proved() -> None:
    design = design_of("throttle")
    assert design.certificate is not None
    assert design.to_dict()["proof"]["verdict"] == "proved"
    assert all(report.proof is not None for report in design.requirements)


def test_without_a_proof_the_result_says_so() -> None:
    design = design_of("throttle", proof=False)
    assert design.status is ft.Status.SOLVED
    assert design.certificate is None
    assert design.certificate_document() is None
    assert design.to_dict()["proof"]["verdict"] == "not_attempted"
    assert "not proved" in design.to_dict()["proof"]["reason"]


def test_a_refuted_requirement_goes_back_to_the_design_as_a_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = load_spec(CONTINUOUS / "brake_delay.yaml")
    seen: list[tuple[object, ...]] = []
    from fopi_tune.design import design as real_design

    def watched(spec: DesignSpec, violations: tuple[object, ...], start: object = None, *_: object) -> object:
        seen.append(violations)
        return real_design(spec, violations, start)  # pyright: ignore[reportArgumentType]

    def refuting(spec: DesignSpec, found: ft.Verification, versions: dict[str, str], *_: object) -> ft.Certificate:
        certificate = certify(spec, found, versions)
        if len(seen) > 1:
            return certificate
        proof = certificate.requirements[2]
        side = dataclasses.replace(proof.sides[0], verdict=ft.Verdict.REFUTED)
        proofs = (
            *certificate.requirements[:2],
            dataclasses.replace(proof, sides=(side,)),
            *certificate.requirements[3:],
        )
        return dataclasses.replace(certificate, requirements=proofs)

    monkeypatch.setattr("fopi_tune.design.design", watched)
    monkeypatch.setattr(importlib.import_module("fopi_tune.pipeline.tune"), "certify", refuting)
    design = ft.tune(spec)
    assert design.status is ft.Status.SOLVED
    assert len(seen) == 2
    (violation,) = seen[1]
    assert getattr(violation, "requirement", getattr(violation, "index", None)) == 2


def test_what_stays_undecided_is_not_called_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["fopi_tune.proof.searches"], "BUDGET", 3)
    design = ft.tune(CONTINUOUS / "brake.yaml")
    assert design.status is ft.Status.FAILED
    assert "the proof is missing" in design.message
    assert "undecided" in design.message
    check = ft.prove(CONTINUOUS / "brake.yaml", plants.ROBUST_BRAKE, tolerance=1e-5)
    assert check.status == "undecided"
    assert check.certificate.verdict is ft.Verdict.UNDECIDED


def test_an_undecided_requirement_states_the_gap_that_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = spec_with(f"sensitivity_db: {{at_most: {decibel(1.16371)!r}}}")
    monkeypatch.setattr(sys.modules["fopi_tune.proof.searches"], "BUDGET", 60)
    (proof,) = proved(spec, REFERENCE).requirements
    assert proof.verdict is ft.Verdict.UNDECIDED
    assert proof.gap is not None
    assert proof.gap > 1e-3
    assert "shown only up to" in proof.reason


def test_a_worse_plant_than_the_verification_had_seen_is_taken_up() -> None:
    """A verification that names a harmless place must not keep the certificate from finding the true worst."""
    spec = spec_with(f"sensitivity_db: {{at_most: {decibel(1.1637)!r}}}")
    found = verify(spec, REFERENCE)
    result = found.requirements[0]
    blind = dataclasses.replace(
        result.extremes[0], achieved=decibel(1.15), worst=dataclasses.replace(result.worst, omega_rad_s=0.4)
    )
    found = dataclasses.replace(found, requirements=(dataclasses.replace(result, extremes=(blind,)),))
    certificate = certify(spec, found, {})
    assert certificate.verdict is ft.Verdict.REFUTED
    assert certificate.requirements[0].sides[0].worst.plant["time_constant_s"] == pytest.approx(3.1)
    assert recheck(to_document(certificate), spec).problems == ()

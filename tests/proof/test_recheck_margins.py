"""Certificates of margins, changed towards a false statement with each entry in keeping with the others: refused."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable

import pytest
from cases.plants import lag, spec_of, transfer_function
from flint import ctx

import fopi_tune as ft
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.certificate import Certificate, Record, SideProof, StabilityProof, Verdict
from fopi_tune.proof.claims.branch_and_bound import search
from fopi_tune.proof.documents import digest, to_document
from fopi_tune.proof.obligations import level_claims, violation_claims
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import Relation, Requirement, Scope

AT_LEAST, AT_MOST = Relation.AT_LEAST, Relation.AT_MOST
P = ft.FoPi(1.0, 0.0, 1.0)


def certificate_of(
    plants: PlantFamily, asked: Requirement, gains: ft.FoPi = P, implementation: Implementation | None = None
) -> Certificate:
    spec = spec_of(plants, asked)
    made = certify(spec, verify(spec, gains, implementation=implementation), {}, implementation)
    assert problems_of(made) == ""
    return made


def problems_of(certificate: Certificate) -> str:
    """What a recheck of the certificate as a file says; empty when it is sound."""
    return " ".join(recheck(to_document(certificate)).problems)


def with_side(certificate: Certificate, **entries: object) -> Certificate:
    """The certificate with other entries of its only side."""
    (proof,) = certificate.requirements
    sides = (dataclasses.replace(proof.sides[0], **entries),)  # pyright: ignore[reportArgumentType]
    return dataclasses.replace(certificate, requirements=(dataclasses.replace(proof, sides=sides),))


def side_of(certificate: Certificate) -> SideProof:
    return certificate.requirements[0].sides[0]


def moved(certificate: Certificate, omega_rad_s: float | None) -> Certificate:
    """The same with the witness at another frequency."""
    return with_side(certificate, worst=dataclasses.replace(side_of(certificate).worst, omega_rad_s=omega_rad_s))


def records_of(certificate: Certificate, level: float, upper: bool) -> tuple[Record, ...]:
    """Records of the claims about every crossover (or some), which say nothing of stability."""
    with ctx.workprec(64):
        claims = level_claims(certificate.case, certificate.requirements[0].requirement, upper, level)
        found = [search(claim, 4000) for claim in claims]
    assert all(result.shown for result in found)
    return tuple(Record(result.record) for result in found)


# --- stability -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("quantity", ["phase_margin_deg", "delay_margin_s", "gain_margin_db"])
def test_a_margin_beside_a_stability_that_is_not_shown_is_refused(quantity: str) -> None:
    made = certificate_of(lag(1.0, (1.0, 2.0), 0.3), Requirement(quantity, AT_LEAST, (0.5,)), ft.FoPi(1.0, 0.5, 0.9))
    assert made.verdict is Verdict.PROVED
    undecided = StabilityProof(Verdict.UNDECIDED, None, made.case.nominal, 0, ())
    changed = dataclasses.replace(made, stability=undecided)
    assert "not shown to be stable" in problems_of(changed)
    nothing = with_side(changed, verdict=Verdict.UNDECIDED, level=None, records=())
    assert problems_of(nothing) == ""
    # nor may a bound be stated of an undecided limit, which lies between the level and the witness
    side = side_of(made)
    assert side.level is not None
    assert side.witness is not None
    limit = QUANTITIES[quantity].from_natural(0.5 * (side.level + side.witness))
    (proof,) = made.requirements
    proof = dataclasses.replace(proof, requirement=dataclasses.replace(proof.requirement, limits=(limit,)))
    between = dataclasses.replace(made, tolerance=1e-12, requirements=(proof,))
    assert problems_of(with_side(between, verdict=Verdict.UNDECIDED)) == ""
    unstable = dataclasses.replace(between, stability=undecided)
    assert "not shown to be stable" in problems_of(with_side(unstable, verdict=Verdict.UNDECIDED))


def test_the_nominal_plants_margin_needs_its_own_stability_alone() -> None:
    # k/(s + 1)^3 is unstable for k > 8
    plants = transfer_function([(7.0, 6.0, 9.0)], [1.0, 3.0, 3.0, 1.0])
    made = certificate_of(plants, Requirement("phase_margin_deg", AT_LEAST, (1.0,), Scope.NOMINAL))
    assert made.stability.verdict is Verdict.REFUTED
    assert side_of(made).verdict is Verdict.PROVED


@pytest.mark.parametrize("scope", [Scope.FAMILY, Scope.NOMINAL])
@pytest.mark.parametrize(("relation", "upper", "limit"), [(AT_LEAST, False, 5.0), (AT_MOST, True, 20.0)])
def test_an_unstable_plants_margin_is_not_proved_by_its_distance_to_minus_1(
    scope: Scope, relation: Relation, upper: bool, limit: float
) -> None:
    """k/(s + 1)^3 with k from 10 to 12: 7 to 14 deg from -1, on the wrong side."""
    plants = transfer_function([(10.0, 12.0)], [1.0, 3.0, 3.0, 1.0])
    made = certificate_of(plants, Requirement("phase_margin_deg", relation, (limit,), scope))
    assert side_of(made).verdict is Verdict.REFUTED
    assert side_of(made).witness is None
    level = math.radians(limit)
    shown = with_side(made, verdict=Verdict.PROVED, level=level, records=records_of(made, level, upper))
    assert "not shown to be stable" in problems_of(shown)
    # a stability that would go with it
    for poles in (0, 2):
        stable = StabilityProof(Verdict.PROVED, 9.0, made.case.nominal, poles, (Record((".",)), Record((".",))))
        assert "stability" in problems_of(dataclasses.replace(shown, stability=stable))
    nothing = with_side(made, verdict=Verdict.UNDECIDED)
    assert "unstable" in problems_of(nothing)


def test_a_stable_plants_margin_is_not_refuted_by_instability() -> None:
    # with K = 2, as the proof of |L| < 1 for a loop that tends to 1 takes seconds
    made = certificate_of(lag(2.0, (1.0, 2.0), 0.3), Requirement("phase_margin_deg", AT_LEAST, (30.0,)), P)
    place = dataclasses.replace(side_of(made).worst, omega_rad_s=None)
    nothing = {"level": None, "records": (), "witness": None, "witness_records": ()}
    refuted = with_side(made, verdict=Verdict.REFUTED, worst=place, **nothing)
    assert "not shown to be unstable" in problems_of(refuted)


def test_a_certificate_of_the_old_meaning_is_refused_with_that_reason() -> None:
    document = to_document(certificate_of(lag(2.0, 1.0), Requirement("phase_margin_deg", AT_LEAST, (30.0,))))
    document["schema"] = 1
    document["digest"] = digest(document)
    with pytest.raises(ft.CertificateError, match="unwrapped phase"):
        recheck(document)


# --- witnesses -----------------------------------------------------------------------------------------------------


@functools.cache
def three_crossovers() -> Certificate:
    """0.1 e^-4.7s/(s^2 + 0.04 s + 1) and PI: crossovers at 0.0101, 0.953 and 1.045 rad/s."""
    plant = transfer_function([0.1], [1.0, 0.04, 1.0], 4.7)
    return certificate_of(plant, Requirement("phase_margin_deg", AT_LEAST, (100.0,)), ft.FoPi(1.0, 0.01, 1.0))


def crossovers() -> list[float]:
    """From the definition: |kp + ki/s| |0.1| = |s^2 + 0.04 s + 1|."""
    omega = 10.0

    def size(x: float) -> float:
        return math.hypot(1.0, 0.01 / x) * 0.1 - math.hypot(1.0 - x * x, 0.04 * x)

    found = []
    steps = [omega * 10.0 ** (-4.0 * k / 20000.0) for k in range(20001)][::-1]
    for low, high in itertools.pairwise(steps):
        if size(low) * size(high) < 0.0:
            for _ in range(60):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if size(low) * size(middle) > 0.0 else (low, middle)
            found.append(low)
    return found


def test_a_witness_at_another_crossover_is_refused() -> None:
    made, omegas = three_crossovers(), crossovers()
    assert len(omegas) == 3
    assert side_of(made).verdict is Verdict.REFUTED
    stated = side_of(made).worst.omega_rad_s
    assert stated is not None
    others = [omega for omega in omegas if not math.isclose(omega, stated, rel_tol=1e-6)]
    assert len(others) == 2
    for omega in others:
        assert "not the crossing" in problems_of(moved(made, omega))


def lead_side(limit: float, relation: Relation = AT_LEAST) -> Certificate:
    """1000 s^2/(s + 1)^2: at omega = 1/sqrt(999), 3.62 deg of lead from -1."""
    plant = transfer_function([1000.0, 0.0, 0.0], [1.0, 2.0, 1.0])
    return certificate_of(plant, Requirement("phase_margin_deg", relation, (limit,)))


#: rad
LEAD = 2.0 * math.atan(1.0 / math.sqrt(999.0))


def test_a_margin_by_lead_is_a_small_one() -> None:
    for limit, verdict in ((3.5, Verdict.PROVED), (3.7, Verdict.REFUTED)):
        made = lead_side(limit)
        assert side_of(made).verdict is verdict
        assert side_of(made).witness == pytest.approx(LEAD, rel=1e-8)
        assert side_of(made).worst.omega_rad_s == pytest.approx(1.0 / math.sqrt(999.0), rel=1e-9)
    assert side_of(lead_side(90.0, AT_MOST)).verdict is Verdict.PROVED


@pytest.mark.parametrize("reading", [2.0 * math.pi - LEAD, math.pi, math.radians(60.0)])
def test_a_lead_side_witness_read_the_long_way_round_is_refused(reading: float) -> None:
    refuted, proved = lead_side(60.0), lead_side(30.0, AT_MOST)
    records = (Record((".",)),)
    entries = {"verdict": Verdict.PROVED, "level": reading, "records": records}
    assert "witness breaks" in problems_of(with_side(refuted, **entries))
    # the leaf's box is the whole axis, or the record is one of a level that holds
    assert "does not hold" in problems_of(with_side(refuted, witness=None, witness_records=(), **entries))
    entries["records"] = records_of(refuted, 3.6 / 180.0 * math.pi, False)
    assert "does not hold" in problems_of(with_side(refuted, witness=None, witness_records=(), **entries))
    wrong = with_side(proved, verdict=Verdict.REFUTED, level=None, records=(), witness=reading, witness_records=records)
    assert problems_of(wrong)


def direct_path(limit: float, gain: float = 5.0) -> Certificate:
    """(a s + 3)/(4 s + 1): a delay margin of 0 for a >= 4."""
    return certificate_of(transfer_function([gain, 3.0], [4.0, 1.0]), Requirement("delay_margin_s", AT_LEAST, (limit,)))


def test_a_delay_margin_of_0_has_its_witness_at_infinity() -> None:
    made = direct_path(0.1)
    assert (side_of(made).verdict, side_of(made).worst.omega_rad_s) == (Verdict.REFUTED, math.inf)
    assert side_of(made).witness == pytest.approx(0.0, abs=1e-12)
    for omega in (1.0, 0.0, None):
        assert problems_of(moved(made, omega))


def on_samples(residue: float) -> Certificate:
    """A lag and a filter that rings at every sample: L(z) = (0.03/(z - 1) + r/(z + 0.8)) m/(z - 1 + m), m = 1 - e^-0.1.

    L(-1) = (5 r + 0.015) m/(2 - m): 0.75 for r = 3, 1.5 for r = 6, where the delay margin is 0.
    """
    implementation = Implementation(Sections(0.1, 0.0, (1.0, -0.8), (0.03, residue)))
    asked = Requirement("delay_margin_s", AT_LEAST, (5.0,))
    return certificate_of(lag(1.0, 1.0), asked, ft.FoPi(0.5, 0.3, 1.0), implementation)


def test_on_samples_a_delay_margin_of_0_has_its_witness_at_nyquist() -> None:
    nyquist = math.pi / 0.1
    made = on_samples(6.0)
    assert side_of(made).verdict is Verdict.REFUTED
    assert (side_of(made).worst.omega_rad_s or 0.0) == pytest.approx(nyquist)
    assert side_of(made).witness == pytest.approx(0.0, abs=1e-12)
    assert problems_of(moved(made, 0.9 * nyquist))


FALSE_AT_THE_END: dict[str, tuple[Callable[[], Certificate], float]] = {
    "falls off": (lambda: certificate_of(lag(4.0, 1.0), Requirement("delay_margin_s", AT_LEAST, (2.0,))), math.inf),
    "a direct path below 1": (lambda: direct_path(30.0, 3.0), math.inf),
    "on samples": (lambda: on_samples(3.0), math.pi / 0.1),
}


@pytest.mark.parametrize("name", FALSE_AT_THE_END)
def test_a_witness_at_the_end_of_the_axis_is_refused_where_the_loop_falls_below_1(name: str) -> None:
    make, end = FALSE_AT_THE_END[name]
    made = make()
    assert side_of(made).verdict is Verdict.REFUTED
    assert "not the crossing" in problems_of(moved(made, end))
    # with a witness of 0 as well, by the leaf of the end
    at_end = moved(with_side(made, witness=1e-13, witness_records=(Record(("e+",)),)), end)
    assert "does not hold" in problems_of(at_end)


def test_a_phase_margin_has_no_witness_at_infinity() -> None:
    plant = transfer_function([5.0, 3.0], [4.0, 1.0])
    made = certificate_of(plant, Requirement("phase_margin_deg", AT_LEAST, (60.0,)))
    assert made.verdict is Verdict.PROVED
    records = (Record(("e+",)),)
    nothing = {"level": None, "records": ()}
    wrong = with_side(made, verdict=Verdict.REFUTED, witness=0.0, witness_records=records, **nothing)
    assert "does not hold" in problems_of(moved(wrong, math.inf))


def test_an_infinite_margin_breaks_an_upper_limit_and_no_other() -> None:
    for quantity in ("phase_margin_deg", "delay_margin_s", "gain_margin_db"):
        made = certificate_of(lag(0.9, (1.0, 2.0)), Requirement(quantity, AT_MOST, (20.0,)))
        assert (side_of(made).verdict, side_of(made).worst.omega_rad_s) == (Verdict.REFUTED, None)
        proved = certificate_of(lag(0.9, (1.0, 2.0)), Requirement(quantity, AT_LEAST, (20.0,)))
        assert proved.verdict is Verdict.PROVED
        # a bound of some other plant's margin is none of these
        assert problems_of(with_side(made, verdict=Verdict.PROVED, level=0.1, records=(Record((".",)),)))


def test_the_claims_of_a_witness_are_about_the_plant_alone() -> None:
    """The opposite claim of one plant: that its margin is at most the level."""
    made = three_crossovers()
    side = side_of(made)
    assert side.witness is not None
    with ctx.workprec(64):
        (claim,) = violation_claims(
            made.case, made.requirements[0].requirement, False, side.witness, side.worst.point, side.worst.omega_rad_s
        )
        assert search(claim, 100).shown
        (false,) = violation_claims(
            made.case, made.requirements[0].requirement, False, side.witness - 1e-6, side.worst.point, None
        )
        assert not search(false, 100).shown

"""Certificates with one entry changed and the digest made to fit:  refused, or every statement is still true.

What may be accepted is a short list of entries; whether the document is then still true is decided in floating point by
`oracles.certificate_statements`, which uses no claim and no record.
"""

from __future__ import annotations

import copy
import functools
import json
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from cases import plants
from cases.project import CONTINUOUS
from cases.tampering import SMALL, Change, Document, changes, some
from cases.thinned import thinned
from oracles.certificate_statements import false_statements

import fopi_tune as ft
from fopi_tune.core.plant import PLANT_MODELS
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.proof import certify, verify
from fopi_tune.proof.certificate import Certificate, SideProof, Verdict
from fopi_tune.proof.documents import digest, from_document, to_document
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import DesignSpec, Relation, Requirement, Scope

#: sets of words, of which an entry has one
WORDS = (
    [verdict.value for verdict in Verdict],
    [relation.value for relation in Relation],
    [scope.value for scope in Scope],
    ["at_most", "at_least"],
    list(QUANTITIES),
    list(PLANT_MODELS),
)
#: what may be changed without making a statement false, and why; the oracle has the last word
HARMLESS = {
    "spec_sha256": "another text of the same spec, which the recheck says",
    "versions": "what made the file is not a statement about the loop",
    "origin_log_rad_s": "where a record cuts the axis first: another valid record of the same claims",
    "tolerance": "the same levels and witnesses, of limits with another tolerance",
    "gains": "other gains of which the same records prove the same levels",
    "implementation": "another controller of which the same records prove the same levels",
    "stability.sensitivity_at_most_neper": "another bound of |S| that the same record proves",
    "omega_rad_s": "another frequency at which the plant reaches the witness, or the same but for rounding",
    "tokens": "the same record in other words: 0.50 for 0.5",
}
#: on samples larger changes than rounding are never harmless: a spec's controller is that of its gains to six digits
ROUNDED = ("gains", "implementation")

Case = tuple[DesignSpec, Document]


def document_of(certificate: Certificate) -> Document:
    return json.loads(json.dumps(to_document(certificate), allow_nan=False))


def spec_named(name: str, *more: Requirement) -> DesignSpec:
    spec = load_spec(CONTINUOUS / f"{name}.yaml")
    return replace(spec, requirements=(*spec.requirements, *more))


def certified(spec: DesignSpec, gains: ft.FoPi, sampled: bool = False, tolerance: float = 1e-6) -> Case:
    implementation = implementation_of(spec, gains) if sampled else None
    found = verify(spec, gains, tolerance, implementation)
    return spec, document_of(certify(spec, found, {"fopi-tune": "0", "python": "0"}, implementation))


def brake() -> Case:
    """Proved; an infinite gain margin, which has no witness."""
    return certified(spec_named("brake"), plants.ROBUST_BRAKE, tolerance=1e-5)


def published_brake() -> Case:
    """Refuted in part; a gain margin that does not end at its upper limit, and one of the two sides of `between`."""
    more = (
        Requirement("gain_margin_db", Relation.AT_MOST, (20.0,)),
        Requirement("delay_margin_s", Relation.BETWEEN, (0.5, 100.0)),
        Requirement("phase_slope_deg_per_decade", Relation.AT_LEAST, (-20.0,)),
    )
    return certified(spec_named("brake", *more), plants.PUBLISHED_BRAKE)


def on_samples() -> Case:
    """A digital certificate: a gain margin at Nyquist's frequency, refuted equalities, and a band beyond Nyquist's."""
    more = Requirement("sensitivity_db", Relation.AT_MOST, (3.0,), from_rad_s=20.0)
    return certified(spec_named("brake", more), plants.ROBUST_BRAKE, sampled=True)


def unstable() -> Case:
    """Refuted stability, and margins that no plant has."""
    spec = spec_named("brake_delay", Requirement("crossover_rad_s", Relation.AT_LEAST, (0.1,)))
    return certified(spec, ft.FoPi(9.0, 4.0, 1.2))


def without_crossover() -> Case:
    """|L| < 1: no crossover to limit, and infinite margins, which break every upper limit."""
    more = (
        Requirement("crossover_rad_s", Relation.AT_LEAST, (0.1,)),
        Requirement("phase_margin_deg", Relation.AT_MOST, (90.0,)),
        Requirement("delay_margin_s", Relation.BETWEEN, (0.1, 10.0)),
    )
    return certified(spec_named("brake_delay", *more), ft.FoPi(0.05, 0.0, 1.0))


def undecided() -> Case:
    """Limits just between the level and the witness of each side: the records decide neither."""
    spec, found = spec_named("brake_delay"), ft.FoPi(1.984583714035147, 0.5295689457685306, 1.438111972003619)
    certificate = certify(spec, verify(spec, found), {})
    asked, proofs = [], []
    for proof in certificate.requirements:
        (side,) = proof.sides
        between = _between(side)
        quantity = QUANTITIES[proof.requirement.quantity]
        limit = quantity.from_natural(between + (-1e-12 if side.upper else 1e-12))
        asked.append(replace(proof.requirement, limits=(limit,)))
        sides = (replace(side, verdict=Verdict.UNDECIDED),)
        proofs.append(replace(proof, requirement=asked[-1], sides=sides))
    certificate = replace(certificate, requirements=tuple(proofs), tolerance=1e-12)
    return replace(spec, requirements=tuple(asked)), document_of(certificate)


def _between(side: SideProof) -> float:
    assert side.level is not None
    assert side.witness is not None
    return 0.5 * (side.level + side.witness)


CASES: dict[str, Callable[[], Case]] = {
    "proved": brake,
    "refuted": published_brake,
    "on samples": on_samples,
    "unstable": unstable,
    "without a crossover": without_crossover,
    "undecided": undecided,
}


def tampered(document: Document, change: Change) -> Any:
    """The document with the change, and a digest that fits unless the digest is what was changed."""
    found = change.applied(document)
    if change.path != ("digest",) and isinstance(found, dict) and "digest" in found:
        found["digest"] = digest(found)
    return found


def outcome(spec: DesignSpec, document: Document, change: Change) -> str:
    """Whether a change was refused, or accepted and harmless; an accepted change with a false statement fails."""
    found = tampered(document, change)
    try:
        again = ft.recheck(found, spec)
        if not again.is_sound:
            return "refused"
    except ft.CertificateError:
        return "no certificate"
    where = f"{change.path}: {change.kind}"
    entry = next((entry for entry in HARMLESS if _is_about(change.place, entry)), None)
    assert entry is not None, f"{where} is accepted"
    if entry in ROUNDED and "implementation" in document:
        assert change.kind in (f"{SMALL:+g}", f"{-SMALL:+g}"), where
    assert false_statements(found, spec) == [], where
    assert entry != "spec_sha256" or again.notes, where
    return entry


def _is_about(place: str, entry: str) -> bool:
    return place.startswith(entry) or place.endswith(f".{entry}")


@functools.cache
def case_named(name: str) -> Case:
    return CASES[name]()


@pytest.fixture(params=thinned(CASES))
def case(request: pytest.FixtureRequest) -> Case:
    return case_named(request.param)


def test_what_is_written_is_sound_and_true(case: Case) -> None:
    spec, document = case
    assert ft.recheck(document, spec).problems == ()
    assert false_statements(document, spec) == []


@pytest.mark.thinned(slow=["on samples", "without"])
def test_a_changed_detail_is_refused_unless_every_statement_is_still_true(case: Case) -> None:
    spec, document = case
    counted = Counter(outcome(spec, document, change) for change in some(changes(document, WORDS), 20, seed=1))
    assert counted["refused"] + counted["no certificate"] >= 14, counted


@pytest.mark.long
def test_no_changed_detail_of_hundreds_is_accepted_with_a_false_statement(
    case: Case, record_property: Callable[[str, object], None]
) -> None:
    spec, document = case
    counted = Counter(outcome(spec, document, change) for change in some(changes(document, WORDS), 250, seed=2))
    record_property("outcomes", dict(counted))
    print(dict(counted))
    assert counted["refused"] + counted["no certificate"] >= 0.85 * counted.total(), counted


# -- several entries changed, so that they agree with each other --------------------------------------------------


def side(document: Document, requirement: int, index: int = 0) -> Document:
    return document["requirements"][requirement]["sides"][index]


def in_keeping(document: Document, change: Callable[[Document], object]) -> Document:
    """The document with a change, and with everything that the reader derives made again."""
    copied = copy.deepcopy(document)
    change(copied)
    return document_of(from_document(copied))


def nothing_shown(requirement: int, index: int = 0) -> Callable[[Document], None]:
    def change(document: Document) -> None:
        nothing = {"verdict": "undecided", "level_natural": None, "witness_natural": None}
        side(document, requirement, index).update(nothing, records=[], witness_records=[])

    return change


def verdict(word: str, requirement: int, index: int = 0) -> Callable[[Document], None]:
    return lambda document: side(document, requirement, index).update(verdict=word)


def placed(requirement: int, index: int = 0, **entries: Any) -> Callable[[Document], None]:
    return lambda document: side(document, requirement, index).update(entries)


def without_witness(requirement: int, **entries: Any) -> Callable[[Document], None]:
    return placed(requirement, witness_natural=None, witness_records=[], **entries)


#: case, change, a word of the refusal
AIMED: dict[str, tuple[str, Callable[[Document], object], str]] = {
    "a frequency outside of the band": ("proved", placed(4, omega_rad_s=0.021), "outside of the band"),
    "another frequency of a crossover": ("proved", placed(0, omega_rad_s=0.3001), "not the crossing"),
    "no frequency of a crossover": ("proved", placed(0, omega_rad_s=None), "no frequency"),
    "a crossover at infinity": (
        "proved",
        placed(0, omega_tends_to_infinity=True),
        "not the crossing",
    ),
    "a frequency without a crossing": ("proved", placed(3, omega_rad_s=1.0), "worst value"),
    "a margin that does not end at infinity": ("refuted", placed(5, omega_tends_to_infinity=True), "worst value"),
    "a frequency of no crossover": ("without a crossover", placed(4, omega_rad_s=1.0), "no such value"),
    "a frequency of an infinite margin": ("without a crossover", placed(5, omega_rad_s=1.0), "worst value"),
    "a frequency of an infinite delay margin": ("without a crossover", placed(6, 1, omega_rad_s=1.0), "worst value"),
    "a frequency of a margin that no plant has": ("unstable", placed(0, omega_rad_s=1.0), "no such value"),
    "a phase crossover elsewhere": ("without a crossover", placed(1, omega_rad_s=5.7), "not the crossing"),
    "a phase crossover at 0": ("without a crossover", placed(1, omega_rad_s=0.0), "not the crossing"),
    "above Nyquist's frequency": ("on samples", placed(4, omega_rad_s=15.8), "Nyquist"),
    "another plant without a witness": ("proved", without_witness(4, point=[2.0], omega_rad_s=0.02), "worst value"),
    "another frequency without a witness": ("proved", without_witness(4, omega_rad_s=0.019), "worst value"),
    "another place beyond Nyquist": ("on samples", placed(5, omega_rad_s=21.0), "worst value"),
    "undecided beside a proof": ("proved", verdict("undecided", 2), "meets the limit"),
    "undecided beside a refutation": ("refuted", verdict("undecided", 4), "breaks the limit"),
    "undecided where the place refutes": ("refuted", nothing_shown(4), "stated break the limit"),
    "refuted beside a proof": ("proved", verdict("refuted", 2), "does not break"),
    "a level without a record": ("undecided", placed(2, records=[]), "claim must be shown"),
    "a record without a level": ("undecided", placed(2, level_natural=None), "without the level"),
    "a record without a witness": ("undecided", placed(2, witness_natural=None), "without the witness"),
    "a bound of S beside a refutation": (
        "unstable",
        lambda document: document["stability"].update(sensitivity_at_most_neper=9.0),
        "beside a verdict",
    ),
    "undecided stability of an unstable plant": (
        "unstable",
        lambda document: document["stability"].update(verdict="undecided"),
        "",
    ),
    "another plant than the nominal one": (
        "proved",
        lambda document: document["stability"].update(point=[2.0]),
        "nominal",
    ),
}


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", AIMED)
def test_entries_that_agree_with_each_other_are_refused_when_they_are_not_true(name: str) -> None:
    of, change, said = AIMED[name]
    spec, document = case_named(of)
    problems = ft.recheck(in_keeping(document, change), spec).problems
    assert problems
    assert said in " ".join(problems)


def test_undecided_is_what_a_file_says_that_shows_nothing() -> None:
    """It is no statement about the loop, so that it cannot be false; but it is less than what was known."""
    spec, document = case_named("proved")
    found = ft.recheck(in_keeping(document, nothing_shown(2)), spec)
    assert found.problems == ()
    assert found.certificate.verdict is Verdict.UNDECIDED


def test_a_number_that_is_not_finite_is_no_certificate() -> None:
    spec, document = case_named("proved")
    for change in (placed(2, witness=float("inf")), lambda d: d.update(extra=float("inf"))):
        copied = copy.deepcopy(document)
        change(copied)
        with pytest.raises(ft.CertificateError, match="finite"):
            ft.recheck(copied, spec)


def test_a_certificate_of_the_continuous_loop_says_nothing_of_a_spec_about_samples() -> None:
    spec, document = case_named("proved")
    assert spec.digital is not None
    about_samples = replace(spec, digital=replace(spec.digital, design="sampled"))
    assert "on samples" in " ".join(ft.recheck(document, about_samples).problems)

"""What the documents of results must hold for a report:  types, ranges, and words that are known.

The documents are read from the disk, where anybody can change them.  After these checks the rest of the report may rely
on every entry that it shows.  Whether the numbers are true is another question: `documents.check_consistent`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any, TypeVar

from fopi_tune.core.controller import FoPi
from fopi_tune.core.families.plant_list import members_of
from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.core.plant import PlantFamily
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.proof.certificate import Verdict
from fopi_tune.proof.strict_json import JsonObject
from fopi_tune.proof.verification.results import Outcome
from fopi_tune.report.measure_entries import check_measures
from fopi_tune.results.design import RESULT_SCHEMA
from fopi_tune.spec.model import DesignSpec, Relation, Requirement
from fopi_tune.spec.scenarios import every_requirement

#: words that a status can be: of a design, of a check of given gains, of drawn plants
DESIGN_STATUSES = ("solved", "infeasible", "unbounded", "failed")
CHECK_STATUSES = ("met", "violated", "undecided")
EVIDENCE_STATUSES = ("met", "violated", "contradiction")
_NOT_ATTEMPTED = "not_attempted"
#: of measured responses, of which there is no proof
CHECKED = "checked"
#: relative; a worst plant may leave the family by rounding
_ROUNDING = 1e-9
T = TypeVar("T")


def check_design(document: Mapping[str, Any], spec: DesignSpec) -> FoPi | None:
    """Check the JSON of `fopi tune`, `fopi run` or `fopi prove`; returns its gains.

    Args:
        document: the JSON.
        spec: which it is of.

    Raises:
        DomainError: an entry is missing, has the wrong type, or does not fit the spec; the message names it.
    """
    return _checked(_design, document, spec)


def check_digital(document: Mapping[str, Any], spec: DesignSpec) -> None:
    """Check the JSON of `fopi discretize`; arguments and errors as for `check_design`."""
    _checked(_digital, document, spec)


def check_evidence(document: Mapping[str, Any], spec: DesignSpec) -> None:
    """Check the JSON of `fopi validate`; arguments and errors as for `check_design`."""
    _checked(_evidence, document, spec)


def _checked(check: Callable[[JsonObject, DesignSpec], T], document: Mapping[str, Any], spec: DesignSpec) -> T:
    try:
        return check(JsonObject(document, ""), spec)
    except CertificateError as error:
        raise DomainError(str(error)) from None


def _design(top: JsonObject, spec: DesignSpec) -> FoPi | None:
    status = _one_of(top, "status", DESIGN_STATUSES + CHECK_STATUSES)
    gains = None if top.get("gains") is None else _gains(top.child("gains"))
    _result(top, spec)
    if status in DESIGN_STATUSES:  # a check has no such entries
        _prose(top, "message")
        _prose(top, "advice")
        for entry in top.children("clash"):
            index, count = entry.count_or_none("requirement"), len(every_requirement(spec))
            _require(index is not None and 0 <= index < count, entry, "requirement", "none of the spec")
            entry.number_or_none("give")
            entry.number_or_none("new_limit")
    return gains


def _digital(top: JsonObject, spec: DesignSpec) -> None:
    _one_of(top, "status", CHECK_STATUSES)
    gains = _gains(top.child("gains"))
    _result(top, spec)
    if top.value.get("band_note") is not None:
        _prose(top, "band_note")
    controller = top.child("controller")
    controller.number("direct")
    sections = controller.children("sections")
    poles = [entry.number("pole") for entry in sections]
    residues = [entry.number("residue") for entry in sections]
    is_filter = bool(residues) or gains.ki == 0.0
    _require(is_filter and max(map(abs, poles), default=0.0) <= 1.0, controller, "sections", "no poles of a controller")


def _result(top: JsonObject, spec: DesignSpec) -> None:
    """The entries that a design, a check and a digital controller share."""
    _schema(top)
    top.number_or_none("objective")
    _prose(top, "objective_quantity")
    entries = top.children("requirements")
    _require(len(entries) == len(spec.requirements), top, "requirements", "not those of the spec")
    for entry, requirement in zip(entries, spec.requirements, strict=True):
        _requirement(entry, requirement, spec)
    check_measures(top, spec)
    _stamp(top.child("stamp"))
    if top.get("stability") is not None:
        stability = top.child("stability")
        stability.flag("stable")
        stability.number_or_none("peak_sensitivity_db")
        _place(stability, "worst", spec)
        _prose(stability, "reason")
    if top.get("nominal") is not None:
        nominal = top.child("nominal")
        nominal.flag("stable")
        for key in ("phase_margin_deg", "gain_margin_db", "gain_reduction_margin_db", "delay_margin_s"):
            nominal.number_or_none(key)
        crossovers, angles = (nominal.numbers(key) for key in ("gain_crossovers_rad_s", "angles_from_minus_one_deg"))
        _require(len(crossovers) == len(angles), nominal, "angles_from_minus_one_deg", "not one for each crossover")
    _proof(top.child("proof"))


def _requirement(entry: JsonObject, requirement: Requirement, spec: DesignSpec) -> None:
    same = entry.text("name") == requirement.quantity and entry.word("relation", Relation) is requirement.relation
    _require(same, entry, "name", "another requirement than the spec's")
    entry.flag("met")
    for key in ("achieved", "score", "multiplier"):
        entry.number_or_none(key)
    if entry.get("outcome") is not None:
        entry.word("outcome", Outcome)
    if entry.get("worst") is not None:
        _place(entry, "worst", spec)
    if entry.get("multiplier_checked") is not None:
        price = entry.child("multiplier_checked")
        price.number_or_none("relaxed")
        price.number_or_none("tightened")
        price.flag("agrees")
    if entry.get("proof") is not None:
        proof = entry.child("proof")
        _one_of(proof, "verdict", (*(word.value for word in Verdict), CHECKED, "violated"))
        for key in ("proved_from", "proved_to", "relative_gap"):
            proof.number_or_none(key)
        _prose(proof, "reason")


def _proof(proof: JsonObject) -> None:
    verdict = _one_of(proof, "verdict", (*(word.value for word in Verdict), _NOT_ATTEMPTED, CHECKED))
    _prose(proof, "reason")
    if verdict in (_NOT_ATTEMPTED, CHECKED):
        return
    stability = proof.child("stability")
    stability.word("verdict", Verdict)
    _prose(stability, "reason")
    if "with_limits" in proof.value:
        _prose(proof.child("with_limits"), "statement")
    proof.number("boxes")
    proof.number("tolerance")
    proof.text("certificate_digest")


def _evidence(top: JsonObject, spec: DesignSpec) -> None:
    _schema(top)
    _one_of(top, "status", EVIDENCE_STATUSES)
    _gains(top.child("gains"))
    drawn = top.child("drawn")
    confidence = drawn.number("confidence")
    _require(0.0 < confidence < 1.0, drawn, "confidence", "not between 0 and 1")
    drawn.number("seed")
    for plant in drawn.children("plants") if "plants" in drawn.value else ():
        plant.text("name")
        plant.number("weight")
    _count(drawn, "outside_the_family")
    if drawn.get("samples_file") is None:
        drawn.text("design")
    else:
        drawn.child("samples_file").text("name")
    if "joint_yield" in top.value:  # documents of earlier versions have none
        joint = top.child("joint_yield")
        _fraction(joint)
        for each in joint.children("scenarios"):
            each.text("name")
            _fraction(each)
    _fraction(top.child("stable"))
    for entry in [*top.children("requirements"), *top.children("limits")]:
        _outcome(entry, spec)


def _outcome(entry: JsonObject, spec: DesignSpec) -> None:
    entry.text("name")
    entry.word("relation", Relation)
    if "side" in entry.value:
        _one_of(entry, "side", ("at_most", "at_least"))
    _require(bool(entry.numbers("limits")), entry, "limits", "empty")
    if entry.value.get("scenario") is not None:
        entry.text("scenario")
    total = _fraction(entry.child("fraction"))
    for quantile in entry.children("quantiles"):
        quantile.number("probability")
        quantile.number_or_none("value")
    for worst in entry.children("worst"):
        worst.number_or_none("value")
        _count(worst, "index")
        _plant(worst, spec)
    if entry.value.get("histogram") is not None:
        _histogram(entry.child("histogram"), total)


def _histogram(entry: JsonObject, total: int) -> None:
    edges, counts = entry.numbers("edges"), entry.numbers("counts")
    _require(len(edges) == len(counts) + 1 > 1, entry, "edges", "not one more than the counts")
    widths = [high - low for low, high in pairwise(edges)]
    _require(all(0.0 < width < math.inf for width in widths), entry, "edges", "not increasing")
    whole = all(count == int(count) and count >= 0.0 for count in counts)
    _require(whole and sum(counts) <= total, entry, "counts", "no counts of the plants that were drawn")


def _fraction(entry: JsonObject) -> int:
    """The number of plants that a share is of."""
    met, total = _count(entry, "met"), _count(entry, "total")
    _require(total > 0 and met <= total, entry, "met", "no part of the plants that were drawn")
    ends = entry.number("low"), entry.number("high")
    _require(0.0 <= ends[0] <= ends[1] <= 1.0, entry, "low", "no end of an interval of shares")
    return total


def _gains(entry: JsonObject) -> FoPi:
    return entry.controller()


def _stamp(entry: JsonObject) -> None:
    for key in ("spec_sha256", "python", "platform"):
        entry.text(key)
    if entry.get("solver") is not None:
        entry.text("solver")
    versions = entry.child("versions")
    for name in versions.value:
        versions.text(name)


def _place(entry: JsonObject, key: str, spec: DesignSpec) -> None:
    """A worst plant, and a frequency or the limit that the frequency tends to."""
    place = entry.child(key)
    omega = place.number_or_none("omega_rad_s")
    _require(omega is None or omega >= 0.0, place, "omega_rad_s", "negative")
    if "limit" in place.value:
        place.text("limit")
    family = _plant(place, spec)
    for name, value in place.value["plant"].items():
        number = family.parameters[name]
        slack = _ROUNDING * max(abs(number.min), abs(number.max))
        inside = number.min - slack <= value <= number.max + slack
        _require(inside, place, "plant", "no plant of the spec's family")


def _plant(entry: JsonObject, spec: DesignSpec) -> PlantFamily:
    """The uncertain numbers of a plant; a requirement that no plant decides names none; returns its family."""
    families = {member.name: member.family for member in members_of(spec.plant)}
    if isinstance(spec.plant, MeasuredFamily):
        # its members are responses, which have no numbers
        families = {member.name: spec.plant for member in spec.plant.members}
    name = entry.text("member") if "member" in entry.value else next(iter(families))
    _require(name in families, entry, "member", "no plant of the spec's list")
    plant, family = entry.child("plant"), families[name]
    known = family.uncertain_names
    _require(not plant.value or set(plant.value) == set(known), entry, "plant", "no plant of the spec")
    for number in plant.value:
        plant.number(number)
    return family


def _schema(top: JsonObject) -> None:
    _require(top.number("schema") == RESULT_SCHEMA, top, "schema", f"not {RESULT_SCHEMA}, which this version reads")


def _count(entry: JsonObject, key: str) -> int:
    found = entry.count_or_none(key)
    _require(found is not None and found >= 0, entry, key, "no count")
    return found or 0


def _one_of(entry: JsonObject, key: str, words: tuple[str, ...]) -> str:
    found = entry.text(key)
    _require(found in words, entry, key, f"none of {', '.join(words)}")
    return found


def _prose(entry: JsonObject, key: str) -> None:
    """A sentence for people, which may go over several lines."""
    _require(isinstance(entry.get(key), str), entry, key, "no text")


def _require(holds: bool, entry: JsonObject, key: str, words: str) -> None:
    if not holds:
        raise CertificateError(f"{entry.at(key)} is {words}")

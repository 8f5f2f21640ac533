"""Certificates as files: what is written is read again, checked faster than it was found, and refused when changed."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import plants
from cases.project import CONTINUOUS
from typer.testing import CliRunner, Result

import fopi_tune as ft
from fopi_tune.cli import app
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.proof import certify, verify
from fopi_tune.proof.claims.branch_and_bound import search
from fopi_tune.proof.documents import digest, from_document, to_document
from fopi_tune.proof.obligations import Case, level_claims
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import Relation, Requirement

BRAKE_FILE = str(CONTINUOUS / "brake.yaml")
BRAKE = load_spec(BRAKE_FILE)
Document = dict[str, Any]


@pytest.fixture(scope="module")
def sound() -> Document:
    """The brake's certificate, with a requirement that is refuted beside those that are proved."""
    found = verify(BRAKE, plants.ROBUST_BRAKE, tolerance=1e-5)
    return json.loads(json.dumps(to_document(certify(BRAKE, found, {"fopi-tune": "0"})), allow_nan=False))


@pytest.fixture(scope="module")
def refuting() -> Document:
    """The certificate of the published gains."""
    return to_document(certify(BRAKE, verify(BRAKE, ft.FoPi(0.07, 0.11, 0.45)), {}))


def changed(document: Document, change: Callable[[Document], object], seal: bool = True) -> Document:
    """A copy with a change; sealed again, as somebody would who knows how digests are made."""
    copied = copy.deepcopy(document)
    change(copied)
    if seal:
        copied["digest"] = digest(copied)
    return copied


def side(document: Document, requirement: int, index: int = 0) -> Document:
    return document["requirements"][requirement]["sides"][index]


def test_a_certificate_survives_the_file(sound: Document, refuting: Document) -> None:
    for document, verdict in ((sound, "proved"), (refuting, "refuted")):
        assert document["verdict"] == verdict
        assert to_document(from_document(document)) == document
        found = ft.recheck(document, BRAKE)
        assert found.problems == ()
        assert found.is_sound
        assert found.boxes > 100


def test_any_change_without_a_new_digest_is_noticed(sound: Document) -> None:
    def spell(document: Document) -> None:
        document["name"] = "brakes"

    (problem,) = ft.recheck(changed(sound, spell, seal=False)).problems
    assert "digest" in problem


def set_to(*path: Any) -> Callable[[Document], None]:
    *keys, last, value = path

    def change(document: Document) -> None:
        place: Any = document
        for key in keys:
            place = place[key]
        place[last] = value

    return change


def tokens(document: Document, requirement: int, index: int = 0) -> list[str]:
    return side(document, requirement)["records"][index]["tokens"].split()


def with_tokens(requirement: int, make: Callable[[list[str]], list[str]]) -> Callable[[Document], None]:
    def change(document: Document) -> None:
        record = side(document, requirement)["records"][0]
        record["tokens"] = " ".join(make(record["tokens"].split()))

    return change


def sharper(requirement: int, by: float) -> Callable[[Document], None]:
    """A bound that is not true, with everything that follows from it in keeping."""

    def change(document: Document) -> None:
        entry = document["requirements"][requirement]
        part = entry["sides"][0]
        upper = part["side"] == "at_most"
        part["level_natural"] += -by if upper else by
        from fopi_tune.quantities import QUANTITIES

        entry["proved_to" if upper else "proved_from"] = QUANTITIES[entry["name"]].from_natural(part["level_natural"])
        document.update(to_document(from_document(document)))

    return change


#: what is done to a sound certificate, sealed again each time, and a word of the refusal
TAMPERINGS = {
    "a sharper phase margin": (sharper(2, 1e-3), "at_least"),
    "a sharper sensitivity": (sharper(4, 1e-3), "at_most"),
    "a bound that does not follow from its level": (set_to("requirements", 2, "proved_from", 89.0), "proved_from"),
    "a shorter record": (with_tokens(2, lambda t: t[:-1]), "ends before"),
    "a longer record": (with_tokens(2, lambda t: [*t, "."]), "goes on"),
    "one leaf for the whole domain": (with_tokens(4, lambda _: ["."]), "does not hold"),
    "no record at all": (set_to("requirements", 2, "sides", 0, "records", []), "claim must be shown"),
    "an axis that is not there": (with_tokens(2, lambda t: ["s7", *t[1:]]), "axis"),
    "words that mean nothing": (with_tokens(2, lambda t: ["x!", *t[1:]]), "leaf 0"),
    "a face that was not shown": (with_tokens(2, lambda t: ["p0+", *t]), "face"),
    "another gain": (set_to("gains", "ki", 0.42), ""),
    "another order": (set_to("gains", "alpha", 0.9), ""),
    "a wider family": (set_to("plant", "parameters", 1, "max", 3.4), ""),
    "a verdict that does not follow": (set_to("requirements", 0, "verdict", "undecided"), "verdict"),
    "a side left out": (lambda d: d["requirements"][0]["sides"].pop(), "sides"),
    "a limit that the bound does not meet": (set_to("requirements", 2, "limits", [83.5]), "limit"),
    "no bound for stability": (set_to("stability", "sensitivity_at_most_neper", None), "stability"),
    "a bound of S that is too small": (set_to("stability", "sensitivity_at_most_neper", 0.01), "stability"),
    "a plant with poles on the right": (set_to("stability", "unstable_poles", 1), "unstable"),
    "an entry that is not there": (lambda d: d.update(extra=None), "extra"),
    "a reason of one's own": (set_to("stability", "reason", "|S| stays below -100 dB"), "reason"),
    "more boxes than there are": (set_to("requirements", 2, "sides", 0, "records", 0, "boxes", 10**9), "boxes"),
    "an undecided stability with a bound": (set_to("stability", "verdict", "undecided"), "stability"),
}


@pytest.mark.parametrize("name", TAMPERINGS)
def test_a_changed_certificate_is_refused_even_with_a_new_digest(sound: Document, name: str) -> None:
    change, said = TAMPERINGS[name]
    problems = ft.recheck(changed(sound, change)).problems
    assert problems
    assert said in " ".join(problems)


def test_a_refutation_cannot_be_turned_round(refuting: Document) -> None:
    def prove(document: Document) -> None:
        for entry in document["requirements"]:
            for part in (entry, *entry["sides"]):
                part["verdict"] = "proved"
        document["verdict"] = "proved"

    assert ft.recheck(changed(refuting, prove)).problems


def test_a_refutation_needs_a_witness_that_breaks_the_limit(refuting: Document) -> None:
    def harmless(document: Document) -> None:
        side(document, 4)["point"] = [1.6]
        document.update(to_document(from_document(document)))

    assert ft.recheck(changed(refuting, harmless)).problems


def test_a_missing_crossover_refutes_no_sensitivity(refuting: Document) -> None:
    """Only what is read off a gain crossover can be refuted by its absence."""

    def claim(document: Document) -> None:
        entry, part = document["requirements"][4], side(document, 4)
        part.update(witness_natural=None, witness=None)
        entry["reason"] = "a plant has no gain crossover"

    assert "no witness" in " ".join(ft.recheck(changed(refuting, claim)).problems)


def test_a_certificate_of_another_text_of_the_spec_is_told(sound: Document) -> None:
    other = changed(sound, lambda d: d.update(spec_sha256="f" * 64))
    assert ft.recheck(other).is_sound
    assert ft.recheck(other, BRAKE).is_sound
    assert "another text of this spec" in ft.recheck(other, BRAKE).notes[0]
    assert ft.recheck(sound, BRAKE).notes == ()
    assert ft.recheck(changed(sound, lambda d: d.update(spec_sha256="f")), BRAKE).problems


@pytest.mark.parametrize("numerator", [[0.0, 1.0, 2.0], [0.0, 0.0, 1.0]])
def test_leading_zeros_prove_nothing_that_is_false(numerator: list[float]) -> None:
    """A numerator that is longer than the denominator but for its zeros: |L| falls no faster for them."""
    names = [f"numerator[{k}]" for k in range(3)] + ["denominator[0]", "denominator[1]", "dead_time_s"]
    values = [*numerator, 1.0, 3.0, 0.0]
    family = PlantFamily("transfer_function", {n: Uncertain.exactly(v) for n, v in zip(names, values, strict=True)})
    case = Case(ft.FoPi(0.8, 1.0, 1.0), family, 0.0)
    asked = Requirement("loop_gain_db", Relation.AT_MOST, (-20.0,), from_rad_s=10.0)
    s = 10j
    true = abs((0.8 + 1 / s) * np.polyval(numerator, s) / (s + 3.0))
    assert [search(claim, 500).shown for claim in level_claims(case, asked, True, math.log(true) - 1e-6)] == [False]


def test_a_certificate_about_another_spec_is_refused(sound: Document) -> None:
    easier = load_spec(CONTINUOUS / "brake_delay.yaml")
    problems = " ".join(ft.recheck(sound, easier).problems)
    assert "the plants are not those of the spec" in problems
    assert "the requirements are not those of the spec" in problems

    def relaxed(document: Document) -> None:
        document["requirements"][2]["limits"] = [70.0]

    assert ft.recheck(changed(sound, relaxed)).is_sound  # a true statement, but not about the brake's spec
    assert ft.recheck(changed(sound, relaxed), BRAKE).problems


def removed(*path: Any) -> Callable[[Document], None]:
    *keys, last = path

    def change(document: Document) -> None:
        place: Any = document
        for key in keys:
            place = place[key]
        del place[last]

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (removed("gains"), "gains is missing"),
        (removed("requirements", 1, "sides", 0, "records"), "requirements[1].sides[0].records is missing"),
        (set_to("kind", "recipe"), "not a certificate"),
        (set_to("schema", 1), "schema 1: this certificate was made when phase and delay margins"),
        (set_to("schema", 3), "schema 3 is not known"),
        (set_to("gains", "kp", "much"), "gains.kp is no finite number"),
        (set_to("gains", "kp", True), "gains.kp is no finite number"),
        (set_to("gains", "alpha", 3.0), "alpha"),
        (set_to("tolerance", 0.0), "tolerance"),
        (set_to("tolerance", 1000.0), "tolerance"),
        (set_to("gains", "kp", 10**400), "gains.kp is no finite number"),
        (set_to("name", "brake: sound\x1b[8m"), "cannot be printed"),
        (set_to("requirements", 0, "sides", 0, "level_natural", 1e4), "beyond"),
        (set_to("plant", "model", "engine"), "plant.model"),
        (set_to("plant", "parameters", 1, "min", 9.0), "min"),
        (removed("plant", "parameters", 0), "parameters"),
        (set_to("requirements", 2, "name", "comfort"), "comfort"),
        (set_to("requirements", 2, "relation", "about"), "relation"),
        (set_to("requirements", 2, "limits", [1.0, 2.0]), "limits"),
        (set_to("requirements", 2, "sides", 0, "point", [9.0]), "no plant of the family"),
        (set_to("requirements", 2, "sides", 0, "side", "left"), "side"),
        (set_to("stability", "verdict", 1), "stability.verdict is no text"),
        (set_to("stability", []), "stability is no object"),
    ],
)
def test_what_is_no_certificate_is_named(sound: Document, change: Callable[[Document], object], said: str) -> None:
    with pytest.raises(ft.CertificateError, match=said.replace("[", r"\[").replace("]", r"\]")):
        ft.recheck(changed(sound, change))


@pytest.mark.parametrize("document", [None, 3, [], {}, "certificate", {"kind": "fopi_tune certificate"}])
def test_anything_else_is_no_certificate(document: object) -> None:
    with pytest.raises(ft.CertificateError):
        ft.recheck(document)


# -- the command ----------------------------------------------------------------------------------------------------


def fopi(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_prove_takes_the_gains_of_the_design_and_recheck_confirms(folder: Path) -> None:
    assert fopi("tune", BRAKE_FILE, "--quiet").exit_code == 0
    first = json.loads(Path("results/brake/certificate.json").read_text(encoding="utf-8"))
    proving = fopi("prove", BRAKE_FILE)
    assert proving.exit_code == 0
    assert "gains from" in proving.stderr
    assert json.loads(Path("results/brake/certificate.json").read_text(encoding="utf-8"))["gains"] == first["gains"]
    checking = fopi("prove", "--recheck", "results/brake/certificate.json", BRAKE_FILE)
    assert checking.exit_code == 0
    assert checking.stdout.startswith("brake: sound.")
    assert all(len(line) <= 80 for line in checking.stdout.splitlines())
    document = json.loads(fopi("prove", "--recheck", "results/brake/certificate.json", "--json").stdout)
    assert (document["status"], document["verdict"], document["problems"]) == ("sound", "proved", [])
    assert document["gains"] == first["gains"]


def test_prove_tunes_when_there_are_no_gains(folder: Path) -> None:
    result = fopi("prove", str(CONTINUOUS / "throttle.yaml"))
    assert result.exit_code == 0
    assert "tuning first" in result.stderr
    names = sorted(path.name for path in Path("results/throttle").iterdir())
    assert names == ["certificate.json", "check.json", "spec.yaml"]


def test_a_changed_file_is_refused_with_exit_code_1(folder: Path, sound: Document) -> None:
    Path("c.json").write_text(json.dumps(changed(sound, sharper(2, 1e-3))), encoding="utf-8")
    result = fopi("prove", "--recheck", "c.json")
    assert result.exit_code == 1
    assert result.stdout.startswith("brake: REFUSED.")
    refused = json.loads(fopi("prove", "--recheck", "c.json", "--json").stdout)
    assert (refused["status"], refused["verdict"]) == ("refused", None)
    assert refused["problems"]


def test_a_sound_refutation_ends_with_1(folder: Path, refuting: Document) -> None:
    Path("c.json").write_text(json.dumps(refuting), encoding="utf-8")
    result = fopi("prove", "--recheck", "c.json")
    assert result.exit_code == 1
    assert "requirements are refuted" in " ".join(result.stdout.split())


@pytest.mark.parametrize(
    ("content", "arguments", "said"),
    [
        ("{}", ("--recheck", "c.json"), "kind is missing"),
        ("{", ("--recheck", "c.json"), "is no JSON"),
        ('{"kind": NaN}', ("--recheck", "c.json"), "is no JSON"),
        ("[" * 100_000, ("--recheck", "c.json"), "is nested deeper than"),
        ('{"kind": 1, "kind": 2}', ("--recheck", "c.json"), "twice"),
        ("{}", ("--recheck", "d.json"), "cannot be read"),
        ("{}", ("--recheck", "c.json", "--kp", "1"), "leave --kp"),
        ("{}", (), "no SPEC"),
        ("{}", (BRAKE_FILE, "--kp", "1"), "all three"),
    ],
)
def test_bad_input_ends_with_2(folder: Path, content: str, arguments: tuple[str, ...], said: str) -> None:
    Path("c.json").write_text(content, encoding="utf-8")
    result = fopi("prove", *arguments)
    assert result.exit_code == 2
    assert said in result.stderr
    assert "Traceback" not in result.stderr


def test_no_proof_leaves_the_certificate_out_and_says_so(folder: Path) -> None:
    throttle = str(CONTINUOUS / "throttle.yaml")
    result = fopi("tune", throttle, "--no-proof")
    assert result.exit_code == 0
    assert result.stdout.startswith("throttle: solved, not proved.")
    assert sorted(path.name for path in Path("results/throttle").iterdir()) == ["design.json", "spec.yaml"]
    design = json.loads(Path("results/throttle/design.json").read_text(encoding="utf-8"))
    assert (design["status"], design["proof"]["verdict"]) == ("solved", "not_attempted")
    assert fopi("tune", throttle).exit_code == 0
    again = fopi("tune", throttle, "--no-proof")
    assert "of an earlier result" in again.stderr


def test_the_design_names_its_certificate_by_digest(folder: Path) -> None:
    document = json.loads(fopi("tune", BRAKE_FILE, "--json").stdout)
    certificate = json.loads(Path("results/brake/certificate.json").read_text(encoding="utf-8"))
    assert document["proof"]["certificate_digest"] == certificate["digest"]
    requirement = document["requirements"][2]["proof"]
    assert requirement["verdict"] == "proved"
    assert 82.905 < requirement["proved_from"] < 82.906
    assert requirement["relative_gap"] <= 1e-6
    assert math.isfinite(requirement["boxes"])

"""Certificates of systems as JSON:  SystemCertificate <-> dictionary.

Reading is strict: what is read is written again, and the two must agree in every entry, verdict, words and digest
included.  Whether the statements are true is tested by `recheck`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from fopi_tune.core.parametric.family import EXPRESSIONS
from fopi_tune.core.plant import PLANT_MODELS, PlantFamily, Uncertain
from fopi_tune.core.switching_lines import SwitchingLines, Threshold, turns_entry
from fopi_tune.core.terms.feedforward import FeedForward
from fopi_tune.digital.coefficients import MeasuredDerivative
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.proof.documents import digest
from fopi_tune.proof.plant_entries import plant_entry, read_family
from fopi_tune.proof.strict_json import JsonObject, first_difference, read_most_change
from fopi_tune.proof.switched.bounded import MOST_FOLLOWED, BoundedProof, MemoryBounds
from fopi_tune.proof.switched.certificate import ASSUMPTIONS, SystemCertificate
from fopi_tune.proof.switched.cycles import LONGEST_WORD, CycleProof
from fopi_tune.proof.switched.definite import Triangle
from fopi_tune.proof.switched.model import Memory, SwitchedLoop, SwitchedModel
from fopi_tune.proof.switched.saturated_loop import SaturatedLoopProof, decay_entry, read_decay
from fopi_tune.proof.switched.settling import MOST_SAMPLES, SettlingProof

KIND, SCHEMA = "fopi-tune system certificate", 1
#: of a certificate that is read
_MOST_SECTIONS, _MOST_CYCLES = 64, 1000


def to_document(certificate: SystemCertificate) -> dict[str, Any]:
    """The certificate's JSON, with its digest.

    Raises:
        CertificateError: a number is not finite, which JSON does not have.
    """
    model = certificate.model
    document = {
        "kind": KIND,
        "schema": SCHEMA,
        "name": certificate.name,
        "system_sha256": certificate.system_sha256,
        "verdict": certificate.verdict.value,
        "statements": list(certificate.statements),
        "assumptions": list(ASSUMPTIONS),
        "sample_time_s": model.sample_time_s,
        **turns_entry(model.lines, *(loop.name for loop in model.loops)),
        "inactive": model.memory.value,
        **({"min_dwell_samples": model.min_dwell_samples} if model.min_dwell_samples else {}),
        **({"shared": list(model.shared)} if model.shared else {}),
        "modes": [_loop(*each) for each in zip(model.loops, certificate.loops, strict=True)],
        "setpoints": None if certificate.setpoints is None else list(certificate.setpoints),
        "settling": None if certificate.settling is None else _settling(certificate.settling),
        "reason": certificate.reason,
        "cycles": [_cycle(cycle) for cycle in certificate.cycles],
        "bounded": None if certificate.bounded is None else _bounded(certificate.bounded),
        "unbounded": certificate.unbounded,
        "versions": dict(certificate.versions),
    }
    return {**document, "digest": digest(document)}


def from_document(document: object) -> SystemCertificate:
    """Read a certificate's JSON.

    Raises:
        CertificateError: not a certificate of a system, an entry is missing, has the wrong type, or does not agree with
            the others.
    """
    top = JsonObject(document, "")
    if top.get("kind") != KIND:
        raise CertificateError("this is not a certificate of a system: its kind is another")
    if top.number("schema") != SCHEMA:
        raise CertificateError(f"schema {top.number('schema'):g} is not known; this version reads {SCHEMA}")
    modes = top.children("modes")
    if len(modes) != 2:
        raise CertificateError(f"{top.at('modes')} must be two")
    loops, proofs = zip(*(_read_loop(entry) for entry in modes), strict=True)
    sample_time_s, turns = top.number("sample_time_s"), _turns(top, loops)
    if not sample_time_s > 0.0:
        raise CertificateError("the sample time must be greater than 0")
    cycles = top.children("cycles")
    if len(cycles) > _MOST_CYCLES:
        raise CertificateError(f"{top.at('cycles')} has more than {_MOST_CYCLES} entries")
    memory, shared = top.word("inactive", Memory), _shared(top, loops)
    found = SystemCertificate(
        name=top.text("name"),
        system_sha256=top.text("system_sha256"),
        model=SwitchedModel(sample_time_s, turns, memory, (loops[0], loops[1]), _dwell(top), shared),
        setpoints=None if top.get("setpoints") is None else _range(top, "setpoints"),
        loops=(proofs[0], proofs[1]),
        settling=None if top.get("settling") is None else _read_settling(top.child("settling")),
        reason=top.text("reason"),
        cycles=tuple(_read_cycle(entry) for entry in cycles),
        bounded=None if top.get("bounded") is None else _read_bounded(top.child("bounded")),
        unbounded=top.text("unbounded"),
        versions=top.texts("versions"),
    )
    if not re.fullmatch("([0-9a-f]{64})?", found.system_sha256):
        raise CertificateError(f"{top.at('system_sha256')} is no digest")
    if bool(found.reason) == found.settles:
        raise CertificateError(f"{top.at('reason')} must say why settling is not proved, and nothing where it is")
    whole = found.bounded is not None and None not in found.bounded.memories
    if bool(found.unbounded) == whole:
        raise CertificateError(f"{top.at('unbounded')} must say what is not bounded, and nothing where all is")
    if (different := first_difference(top.value, to_document(found), "the certificate")) is not None:
        raise CertificateError(f"{different} does not agree with the other entries")
    return found


def _turns(top: JsonObject, loops: Sequence[SwitchedLoop]) -> float | SwitchingLines:
    """The hysteresis, or the other lines."""
    if "thresholds" not in top.value:
        hysteresis = top.number("hysteresis")
        if not hysteresis >= 0.0:
            raise CertificateError("the hysteresis must be at least 0")
        return hysteresis
    entry, rest = top.child("thresholds"), Threshold(0.0)
    words = [*SwitchingLines(rest, rest).named(*(loop.name for loop in loops)), "coast_above", "coast_below"]
    lines = [_threshold(entry, word) if word in entry.value else None for word in words]
    if lines[0] is None or lines[1] is None:
        raise CertificateError(f"{top.at('thresholds')} must have {words[0]} and {words[1]}")
    try:
        return SwitchingLines(lines[0], lines[1], lines[2], lines[3])
    except DomainError as error:
        raise CertificateError(f"{top.at('thresholds')}: {error}") from None


def _threshold(entry: JsonObject, word: str) -> Threshold:
    if isinstance(entry.get(word), dict):
        return Threshold(entry.child(word).number("absolute"), is_absolute=True)
    return Threshold(entry.number(word))


def _dwell(top: JsonObject) -> int:
    """The minimum dwell in samples; certificates without one are of systems without one."""
    found = top.count_or_none("min_dwell_samples") if "min_dwell_samples" in top.value else 0
    if found is None or found < 0:
        raise CertificateError(f"{top.at('min_dwell_samples')} must be a whole number of at least 0")
    return found


def _shared(top: JsonObject, loops: Sequence[SwitchedLoop]) -> tuple[str, ...]:
    """The numbers that both plants share; certificates without them are of systems that share none."""
    if "shared" not in top.value:
        return ()
    names = top.text_list("shared")
    ranges = [[loop.plant.parameters.get(name) for name in names] for loop in loops]
    if not names or len({*names}) < len(names) or ranges[0] != ranges[1] or None in ranges[0]:
        raise CertificateError(f"{top.at('shared')} must be numbers that both plants have with the same range")
    return names


def _loop(loop: SwitchedLoop, proof: SaturatedLoopProof | None) -> dict[str, Any]:
    controller = loop.controller
    return {
        "name": loop.name,
        "controller": {
            "direct": controller.direct,
            "poles": list(controller.poles),
            "residues": list(controller.residues),
            "weights": list(controller.weights),
            "tracking_gain": controller.tracking_gain,
            "limits": list(controller.limits),
            **({"most_change": controller.most_change} if controller.limits_rate else {}),
            **({} if controller.derivative is None else {"derivative": _derivative(controller.derivative)}),
            "delay_samples": loop.delay_samples,
        },
        **({} if loop.feedforward is None else {"feedforward": asdict(loop.feedforward)}),
        **({} if loop.hold_below_per_s is None else {"hold_below_per_s": loop.hold_below_per_s}),
        "plant": plant_entry(loop.plant),
        "decays": None if proof is None else decay_entry(proof),
    }


def _settling(proof: SettlingProof) -> dict[str, Any]:
    return {
        "setpoints": list(proof.setpoints),
        "samples": proof.samples,
        "matrix": _rows(proof.matrix),
        "decay": proof.decay,
        "undershoot": proof.undershoot,
        "overshoot": proof.overshoot,
    }


def _cycle(proof: CycleProof) -> dict[str, Any]:
    return {
        "setpoint": proof.setpoint,
        "plants": [dict(numbers) for numbers in proof.plants],
        "modes": proof.modes,
        "parts": proof.parts,
        "attraction": None if proof.attraction is None else _rows(proof.attraction),
        "lowest": proof.lowest,
        "highest": proof.highest,
    }


def _bounded(proof: BoundedProof) -> dict[str, Any]:
    return {
        "setpoints": list(proof.setpoints),
        "outputs": list(proof.outputs),
        "memories": [
            {} if each is None else {"samples": each.samples, "sections": list(each.sections), "total": each.total}
            for each in proof.memories
        ],
    }


def _rows(triangle: Triangle) -> list[list[float]]:
    return [list(row) for row in triangle]


def _read_feedforward(entry: JsonObject) -> FeedForward:
    return FeedForward(entry.number("static_gain"), entry.number("rate_gain"))


def _read_loop(entry: JsonObject) -> tuple[SwitchedLoop, SaturatedLoopProof | None]:
    loop = SwitchedLoop(
        entry.text("name"),
        _read_controller(entry.child("controller")),
        _read_plant(entry.child("plant")),
        entry.child("controller").number("delay_samples"),
        _read_feedforward(entry.child("feedforward")) if "feedforward" in entry.value else None,
        entry.number("hold_below_per_s") if "hold_below_per_s" in entry.value else None,
    )
    if entry.get("decays") is None:
        return loop, None
    return loop, read_decay(entry.child("decays"))


def _read_controller(entry: JsonObject) -> Runtime:
    poles, residues, weights = (entry.numbers(key) for key in ("poles", "residues", "weights"))
    low, high = _pair(entry, "limits")
    if not len(poles) == len(residues) == len(weights) <= _MOST_SECTIONS:
        raise CertificateError(f"{entry.place}: poles, residues and weights are no sum of at most {_MOST_SECTIONS}")
    if any(abs(pole) >= 1.0 for pole in poles[1:]) or any(not -1.0 < pole <= 1.0 for pole in poles[:1]):
        raise CertificateError(f"{entry.place}: the sections are not stable")
    if not low < high:
        raise CertificateError(f"{entry.place}.limits are empty")
    direct, gain, change = entry.number("direct"), entry.number("tracking_gain"), read_most_change(entry)
    derivative = _read_derivative(entry.child("derivative")) if "derivative" in entry.value else None
    parts = direct, poles, residues, weights, gain, (low, high), change
    return Runtime(Precision.FLOAT64, *parts, derivative=derivative)


def _derivative(found: MeasuredDerivative) -> dict[str, Any]:
    return {"gains": list(found.gains), "shares": list(found.shares)}


def _read_derivative(entry: JsonObject) -> MeasuredDerivative:
    gains, shares = entry.numbers("gains"), entry.numbers("shares")
    if not 0 < len(gains) == len(shares) <= _MOST_SECTIONS or not all(0.0 < share < 2.0 for share in shares):
        raise CertificateError(f"{entry.place}: gains and shares are no derivative of at most {_MOST_SECTIONS} parts")
    return MeasuredDerivative(gains, shares)


def _read_plant(entry: JsonObject) -> PlantFamily:
    if entry.text("model") == EXPRESSIONS:
        return read_family(entry)
    model = PLANT_MODELS.get(entry.text("model"))
    if model is None:
        raise CertificateError(f"{entry.at('model')} is none of {', '.join(PLANT_MODELS)}")
    numbers: dict[str, Uncertain] = {}
    for one in entry.children("parameters"):
        name = one.text("name")
        try:
            number = Uncertain(one.number("nominal"), one.number("min"), one.number("max"))
        except DomainError as error:
            raise CertificateError(f"{one.place}: {error}") from None
        if wrong := model.check(name, number):
            raise CertificateError(f"{one.place}: {name} {wrong}")
        numbers[name] = number
    if not model.lists and tuple(numbers) != model.scalars:
        raise CertificateError(f"{entry.at('parameters')} are not those of model {model.name}")
    return PlantFamily(model.name, numbers)


def _read_settling(entry: JsonObject) -> SettlingProof:
    samples = entry.count_or_none("samples")
    if samples is None or not 1 <= samples <= MOST_SAMPLES:
        raise CertificateError(f"{entry.at('samples')} must be from 1 to {MOST_SAMPLES}")
    return SettlingProof(
        _range(entry, "setpoints"),
        samples,
        entry.lower_triangle("matrix"),
        entry.number("decay"),
        entry.number("undershoot"),
        entry.number("overshoot"),
    )


def _read_cycle(entry: JsonObject) -> CycleProof:
    plants = entry.children("plants")
    modes, parts = entry.text("modes"), entry.text("parts")
    if len(plants) != 2:
        raise CertificateError(f"{entry.at('plants')} must be two")
    if not 2 <= len(modes) == len(parts) <= LONGEST_WORD or set(modes) != {"T", "B"} or not set(parts) <= set("-0+"):
        raise CertificateError(f"{entry.place}: modes and parts are no word of at most {LONGEST_WORD} samples")
    return CycleProof(
        entry.number("setpoint"),
        (_numbers(plants[0]), _numbers(plants[1])),
        modes,
        parts,
        None if entry.get("attraction") is None else entry.lower_triangle("attraction"),
        entry.number("lowest"),
        entry.number("highest"),
    )


def _read_bounded(entry: JsonObject) -> BoundedProof:
    memories = entry.children("memories")
    if len(memories) != 2:
        raise CertificateError(f"{entry.at('memories')} must be two")
    raising, lowering = (_read_memory(each) if each.value else None for each in memories)
    return BoundedProof(_pair(entry, "setpoints"), _pair(entry, "outputs"), (raising, lowering))


def _read_memory(entry: JsonObject) -> MemoryBounds:
    samples = entry.count_or_none("samples")
    if samples is None or not 1 <= samples <= MOST_FOLLOWED:
        raise CertificateError(f"{entry.at('samples')} must be from 1 to {MOST_FOLLOWED}")
    return MemoryBounds(samples, entry.numbers("sections"), entry.number("total"))


def _numbers(entry: JsonObject) -> Mapping[str, float]:
    return {name: entry.number(name) for name in entry.value}


def _range(entry: JsonObject, key: str) -> tuple[float, float]:
    low, high = _pair(entry, key)
    if not low <= high:
        raise CertificateError(f"{entry.at(key)}: the smaller number is the first one")
    return low, high


def _pair(entry: JsonObject, key: str) -> tuple[float, float]:
    numbers = entry.numbers(key)
    if len(numbers) != 2:
        raise CertificateError(f"{entry.at(key)} must be two numbers")
    return numbers[0], numbers[1]

"""Certificates as files:  read again as they were, tested without searches, and refused when they were changed."""

from __future__ import annotations

import copy
import json
import random
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest
from cases import switched
from cases.switched import SETPOINTS

from fopi_tune.errors import CertificateError
from fopi_tune.proof.documents import digest
from fopi_tune.proof.switched import SystemCertificate, recheck_system
from fopi_tune.proof.switched.documents import from_document, to_document

MEMORIES = ("reset", "tracking", "held")
Document = dict[str, Any]


def leaves(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    pairs = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else None
    if pairs is None:
        yield path
    else:
        for key, child in pairs:
            yield from leaves(child, (*path, key))


def changed(document: Document, path: tuple[Any, ...], change: Callable[[Any], Any]) -> Document:
    copied = copy.deepcopy(document)
    node = copied
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = change(node[path[-1]])
    return copied


def other(value: Any) -> Any:
    if isinstance(value, bool) or value is None:
        return 1.0
    return value * 1.01 + 0.01 if isinstance(value, int | float) else value + "x"


def refused(document: Document, memory: str) -> bool:
    try:
        found = from_document(document)
    except CertificateError as error:
        return bool(str(error))
    return not recheck_system(found, switched.car(memory), switched.GAINS).accepted


@pytest.mark.parametrize("memory", MEMORIES)
def test_a_certificate_survives_the_file(memory: str) -> None:
    read = from_document(json.loads(json.dumps(switched.document(memory), allow_nan=False)))
    assert read == switched.certificate(memory)
    assert recheck_system(read, switched.car(memory), switched.GAINS).problems == ()


@pytest.mark.parametrize("memory", MEMORIES)
def test_any_change_is_refused(memory: str) -> None:
    document = switched.document(memory)
    paths = random.Random(1).sample(list(leaves(document)), 50)
    assert [path for path in paths if not refused(changed(document, path, other), memory)] == []


SEALED: list[tuple[str, tuple[Any, ...], Callable[[Any], Any]]] = [
    ("reset", ("settling", "setpoints", 1), lambda value: value + 4.0),
    ("reset", ("settling", "setpoints", 0), lambda value: 0.3),
    ("reset", ("settling", "samples"), lambda value: value // 5),
    ("reset", ("settling", "undershoot"), lambda value: value - 0.001),
    ("reset", ("settling", "overshoot"), lambda value: 0.5 * value),
    ("reset", ("settling", "decay"), lambda value: 0.999),
    ("reset", ("settling", "matrix", 3, 3), lambda value: -value),
    ("reset", ("hysteresis",), lambda value: 0.6),
    ("reset", ("name",), lambda value: value + "x"),
    ("reset", ("system_sha256",), lambda value: value + "x"),
    ("reset", ("modes", 0, "decays", "decay"), lambda value: -value),
    ("reset", ("inactive",), lambda value: "tracking"),
    ("reset", ("verdict",), lambda value: "cycles"),
    ("reset", ("statements", 0), lambda value: "Everything settles."),
    ("reset", ("assumptions", 0), lambda value: "None."),
    ("reset", ("modes", 0, "controller", "direct"), lambda value: 1.001 * value),
    ("reset", ("modes", 1, "plant", "parameters", 1, "max"), lambda value: 3.2),
    ("reset", ("modes", 0, "decays", "decay"), lambda value: 0.99),
    ("reset", ("modes", 1, "decays", "multiplier"), lambda value: 0.0),
    ("reset", ("bounded", "outputs", 1), lambda value: value - 0.1),
    ("reset", ("bounded", "setpoints", 1), lambda value: value + 3.0),
    ("reset", ("bounded", "memories", 0, "total"), lambda value: 0.999 * value),
    ("reset", ("bounded", "memories", 1, "sections", 2), lambda value: 0.999 * value),
    ("tracking", ("bounded", "memories", 0, "samples"), lambda value: 20),
    ("tracking", ("bounded", "memories", 0, "sections", 1), lambda value: 0.99 * value),
    ("tracking", ("bounded", "memories", 1, "sections", 0), lambda value: 0.999 * value),
    ("tracking", ("bounded", "memories", 1, "sections"), lambda value: value[:-1]),
    ("held", ("cycles", 0, "modes"), lambda value: value[1:] + value[0]),
    ("held", ("cycles", 0, "parts"), lambda value: value.replace("+", "0")),
    ("held", ("cycles", 0, "setpoint"), lambda value: value + 3.0),
    ("held", ("cycles", 0, "lowest"), lambda value: value - 0.1),
    ("held", ("cycles", 0, "plants", 1, "time_constant_s"), lambda value: 5.0),
    ("held", ("cycles", 0, "attraction", 4, 4), lambda value: -value),
    ("held", ("cycles", 0, "attraction"), lambda value: value[:-1]),
]


@pytest.mark.thinned(6)
@pytest.mark.parametrize(
    ("memory", "path", "change"),
    # a function's own name has its address in it, which differs between the processes of the tests
    SEALED,
    ids=[f"{memory}-{'.'.join(map(str, path))}" for memory, path, _ in SEALED],
)
def test_a_change_by_somebody_who_knows_the_digest_is_refused(
    memory: str, path: tuple[Any, ...], change: Callable[[Any], Any]
) -> None:
    document = changed(switched.document(memory), path, change)
    document["digest"] = digest(document)
    assert refused(document, memory)


#: memory, and entries that are changed together with the verdict, the statements and the digest that follow from them
CONSISTENT: dict[str, tuple[str, Callable[[SystemCertificate], SystemCertificate]]] = {
    "a reason beside a proof": ("reset", lambda c: replace(c, reason="the loop is not stable")),
    "no reason": ("held", lambda c: replace(c, reason="")),
    "another reason": ("held", lambda c: replace(c, reason="nothing was tried")),
    "setpoints in no order": ("reset", lambda c: replace(c, setpoints=(SETPOINTS[1], SETPOINTS[0]))),
    "setpoints that are not covered": ("reset", lambda c: replace(c, setpoints=(SETPOINTS[0], 50.0))),
    "another name": ("reset", lambda c: replace(c, name="bicycle")),
    "an orbit twice": ("held", lambda c: replace(c, cycles=(c.cycles[0], *c.cycles))),
    "no orbit, and no reason": ("held", lambda c: replace(c, cycles=(), reason="")),
}


@pytest.mark.parametrize("name", CONSISTENT)
def test_a_false_detail_that_agrees_with_the_others_is_refused(name: str) -> None:
    memory, change = CONSISTENT[name]
    assert refused(to_document(change(switched.certificate(memory))), memory)


def test_another_text_of_the_system_is_told() -> None:
    other = replace(switched.certificate("reset"), system_sha256=64 * "0")
    found = recheck_system(other, switched.car("reset"), switched.GAINS)
    assert found.accepted
    assert "another text" in found.notes[0]
    assert recheck_system(switched.certificate("reset"), switched.car("reset"), switched.GAINS).notes == ()


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("kind",), "x", "kind is another"),
        (("schema",), 2, "schema 2 is not known"),
        (("modes",), [], "must be two"),
        (("sample_time_s",), 0.0, "greater than 0"),
        (("modes", 0, "controller", "poles"), [1.0], "no sum of at most"),
        (("modes", 0, "controller", "poles", 1), 1.5, "not stable"),
        (("modes", 0, "controller", "limits"), [1.0, 0.0], "empty"),
        (("modes", 0, "controller", "limits"), [1.0], "two numbers"),
        (("modes", 0, "plant", "model"), "x", "is none of"),
        (("modes", 0, "plant", "parameters"), [], "not those of model"),
        (("modes", 0, "plant", "parameters", 0, "min"), 9.0, "greater than max"),
        (("modes", 0, "plant", "parameters", 2, "nominal"), "x", "no finite number"),
        (("modes", 0, "decays", "matrix"), [[1.0, 2.0]], "no lower triangle"),
        (("modes", 0, "decays", "matrix"), 3, "no lower triangle"),
        (("settling", "samples"), 10**9, "must be from 1"),
        (("reason",), "it is late", "must say why settling is not proved"),
        (("unbounded",), "all of it", "must say what is not bounded"),
        (("settling", "samples"), None, "must be from 1"),
        (("bounded", "memories"), [], "must be two"),
        (("bounded", "memories", 0, "samples"), 0, "must be from 1"),
    ],
)
def test_what_is_no_certificate_is_told(path: tuple[Any, ...], value: Any, words: str) -> None:
    with pytest.raises(CertificateError, match=words):
        from_document(changed(switched.document("reset"), path, lambda _: value))


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("cycles", 0, "plants"), [], "must be two"),
        (("cycles", 0, "modes"), "TX", "no word"),
        (("cycles",), [{}] * 1001, "more than 1000"),
    ],
)
def test_what_is_no_orbit_is_told(path: tuple[Any, ...], value: Any, words: str) -> None:
    with pytest.raises(CertificateError, match=words):
        from_document(changed(switched.document("held"), path, lambda _: value))


def test_a_certificate_of_another_system_is_told() -> None:
    found = recheck_system(switched.certificate("reset"), switched.car("reset"), switched.TUNED)
    assert not found.accepted
    assert "other controllers" in found.problems[0]


def test_another_text_of_the_system_is_noted() -> None:
    sound = switched.certificate("reset")
    assert recheck_system(sound, switched.car("reset"), switched.GAINS).notes == ()
    of_before = recheck_system(replace(sound, system_sha256="0" * 64), switched.car("reset"), switched.GAINS)
    assert of_before.accepted
    assert "another text of this system" in of_before.notes[0]


def test_statements_about_a_model_that_the_methods_do_not_handle_are_refused() -> None:
    for memory in ("reset", "held"):
        sound = switched.certificate(memory)
        late = tuple(replace(loop, delay_samples=1.5) for loop in sound.model.loops)
        model = replace(sound.model, loops=(late[0], late[1]))
        found = recheck_system(replace(sound, model=model, reason=model.obstacle if sound.reason else ""))
        assert len(found.problems) == 3 + len(sound.cycles) + (sound.settling is not None)


def test_a_recheck_needs_no_solver() -> None:
    program = (
        "import json, sys\n"
        "from fopi_tune.proof.switched.documents import from_document\n"
        "from fopi_tune.proof.switched.recheck import recheck_system\n"
        "found = recheck_system(from_document(json.load(sys.stdin)))\n"
        "print(found.accepted, 'cvxpy' in sys.modules, 'clarabel' in sys.modules, 'numba' in sys.modules)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        input=json.dumps(to_document(switched.certificate("reset"))),
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["True", "False", "False", "False"]

"""Hostile and broken spec files: each ends in a `SpecError` of one-line reasons, soon, and in little memory."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest
from cases.project import CONTINUOUS, IMPORTED
from hypothesis import given, settings
from hypothesis import strategies as st

from fopi_tune.errors import Problem, SpecError
from fopi_tune.spec import load_spec, parse_spec
from fopi_tune.spec.yaml.composer import MAX_BYTES, MAX_NODES
from fopi_tune.spec.yaml.scalars import LARGEST, SMALLEST, parse_number

BRAKE = (CONTINUOUS / "brake.yaml").read_text(encoding="utf-8")
THROTTLE = (CONTINUOUS / "throttle.yaml").read_text(encoding="utf-8")
SYNTAX = "check the indentation, colons, quotes and brackets here"
BIG = MAX_BYTES - 1024


def brake_with(old: str, new: str) -> str:
    assert old in BRAKE
    return BRAKE.replace(old, new, 1)


def gain_as(text: str) -> str:
    return brake_with("static_gain: 1.0", f"static_gain: {text}")


def reasons(text: str | bytes) -> list[str]:
    with pytest.raises(SpecError) as caught:
        parse_spec(text, "s.yaml")
    return [str(problem) for problem in caught.value.problems]


# name: (spec, one of the reasons)
STRUCTURES: dict[str, tuple[str | bytes, str]] = {
    "anchor": (
        gain_as("&a 1.0"),
        "6:16: plant.static_gain: anchors (&name) are not allowed; remove it and write each value out",
    ),
    "alias": (gain_as("*a"), "6:16: plant.static_gain: aliases (*name) are not allowed; write the value out"),
    "tag": (gain_as("!!float 1"), "6:16: plant.static_gain: tags (!name) are not allowed; remove it"),
    "python tag": (
        gain_as("!!python/object/apply:os.system ['true']"),
        "6:16: plant.static_gain: tags (!name) are not allowed; remove it",
    ),
    "merge key": (
        brake_with("  model: lag", "  <<: {model: lag}\n  model: lag"),
        "5:3: plant.<<: merge keys are not allowed; write the keys out",
    ),
    "duplicate key": (
        brake_with("  static_gain: 1.0", "  static_gain: 1.0\n  static_gain: 2.0"),
        "7:3: plant.static_gain: the key is on line 6 and again on line 7; keep one",
    ),
    "list as a key": (BRAKE + "[1]: 2\n", "25:1: a list is used as a key; keys are words such as `plant`"),
    "mapping as a key": (BRAKE + "? {a: 1}\n: 2\n", "25:3: a mapping is used as a key; keys are words such as `plant`"),
    "alias as a key": (BRAKE + "*a : 2\n", "25:1: aliases (*name) are not allowed; write the value out"),
    "no key": (BRAKE + ": 2\n", "25:1: a key is missing before the colon; write one or remove the line"),
    "two documents": (
        BRAKE + "---\n" + BRAKE,
        "25:1: a second document begins here; a spec is one: remove the line ---",
    ),
    "directive": ("%YAML 1.1\n---\n" + BRAKE, "2:1: directives (lines that begin with %) are not allowed; remove them"),
    "bad directive": ("%YAML 99999999999.1\n---\n" + BRAKE, SYNTAX),
    "empty": ("", "1:1: the file is empty; `fopi init` writes a spec to start from"),
    "comment only": ("# nothing\n", "1:1: the file is empty; `fopi init` writes a spec to start from"),
    "null": ("~\n", "1:1: the file is no spec; `fopi init` writes one to start from"),
    "a list": ("- 1\n", "1:1: the file is no spec; `fopi init` writes one to start from"),
    "tab": (
        "plant:\n\tmodel: lag\n",
        "2:1: not valid YAML (while scanning for the next token, found character '\\t' that ",
    ),
    "open quote": ('name: "brake\n', SYNTAX),
    "open bracket": ("plant: {model: lag\n", SYNTAX),
    "bad indentation": ("plant:\n   model: lag\n  gain: 1\n", SYNTAX),
    "beyond Unicode": ('name: "\\UFFFFFFFF"\n', SYNTAX),
    "no space after the colon": (
        brake_with("objective: {minimize: phase_margin_spread_deg}", "objective: minimize:ki"),
        "22:12: objective: 'minimize:ki' is not a mapping; a space is missing after the colon",
    ),
    "Latin-1": (
        BRAKE.replace("brake", "br\xe4ke", 1).encode("latin-1"),
        "2:9: byte 0xe4 is not UTF-8; save the file as UTF-8",
    ),
    "UTF-16": (BRAKE.encode("utf-16"), "1:1: begins with a byte order mark (UTF-16); save the file as UTF-8"),
    "UTF-16 without mark": (
        BRAKE.encode("utf-16-le"),
        "1:2: contains the control character U+0000; remove it, or save",
    ),
    "UTF-8 with mark": (
        BRAKE.encode("utf-8-sig"),
        "1:1: begins with a byte order mark (UTF-8); save the file as UTF-8",
    ),
    "zeros": (b"\0" * 1000, "1:1: contains the control character U+0000; remove it, or save the file as UTF-8"),
    "escape codes": (BRAKE + "\x1b[31m", "25:1: contains the control character U+001B; remove it, or save"),
    "half a surrogate pair": (BRAKE + "\ud800", "25:1: contains the character U+D800, which is not text; remove it"),
    "key of control characters": (
        BRAKE + '"a\\n\\e[31mb": 1\n',
        "25:1: 'a\\n\\x1b[31mb': the key is not known here; remove it or",
    ),
}

HEAVY: dict[str, tuple[str | bytes, str]] = {
    "nested lists": ("plant: " + "[" * 5000, "1:27: plant: nested deeper than 20 levels; a spec needs at most 6"),
    "closed nested lists": ("plant: " + "[" * 5000 + "]" * 5000, "1:27: plant: nested deeper than 20 levels"),
    "nested mappings": ("{a: " * 5000, "nested deeper than 20 levels; a spec needs at most 6"),
    "nested blocks": ("- " * 5000 + "1\n", "1:41: nested deeper than 20 levels; a spec needs at most 6"),
    "nested keys": ("? " * 5000, "1:41: nested deeper than 20 levels; a spec needs at most 6"),
    "alias bomb": (
        "schema: 1\na0: &a0 [x, x]\n"
        + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 400)),
        "2:5: a0: anchors (&name) are not allowed; remove it and write each value out",
    ),
    "too large": (
        "a" * (100 * MAX_BYTES),
        "1:1: the file is larger than 128 KiB; a spec is a few KiB: is this the right",
    ),
    "long number": (
        gain_as("1" * 5000),
        "'111111111111111111111111'…'11111111' is 5000 characters long; write at most 100",
    ),
    "long fraction": (gain_as("0." + "1" * 5000), "is 5002 characters long; write at most 100 characters"),
    "long seed": (
        brake_with("seed: 1", "seed: " + "9" * 5000),
        "is 5000 characters long; write at most 100 characters",
    ),
    "many values": (
        f"a: [{'1, ' * (MAX_NODES + 1)}]",
        f"the spec has more than {MAX_NODES} values; split it or use fewer",
    ),
    "long key": ("a" * BIG + ": 1", SYNTAX),
    "long word": ("name: " + "b " * (BIG // 2), "1:7: name: 'b b b b b b b b b b b b '…' b b b b' cannot be used;"),
    "long quotes": ('name: "' + "\\n" * (BIG // 2) + '"', "cannot be used; a name becomes a folder's"),
    "long block": ("name: |\n" + "  x\n" * (BIG // 4), "cannot be used; a name becomes a folder's"),
    "comments": ("#\n" * (BIG // 2), "1:1: the file is empty; `fopi init` writes a spec to start from"),
    "blank lines": ("\n" * BIG, "1:1: the file is empty; `fopi init` writes a spec to start from"),
    "unknown keys": ("".join(f"validatiox{i}: 1\n" for i in range(MAX_NODES // 2 - 1)), "did you mean 'validation'?"),
    "one key again and again": (
        "name: a\n" * (MAX_NODES // 2 - 1),
        "the key is on line 1 and again on line 2499; keep one",
    ),
    "many contradictions": (
        BRAKE.split("requirements:")[0]
        + "requirements:\n"
        + "".join(f"- loop_gain_db: {{between: [{i}.1, {i}.2]}}\n" for i in range(500)),
        "between [499.1, 499.2] on line 513 contradicts between [0.1, 0.2] on line 14; relax one",
    ),
    "many requirements": (
        BRAKE.split("requirements:")[0] + "requirements:\n" + "- loop_gain_db: {at_least: 1}\n" * 501,
        "14:1: requirements: the list has 501 entries; write a list of at most 500 entries",
    ),
}

#: processor time; each takes a few tenths, and what grows with the square of its size or doubles takes minutes
TOO_LONG_S = 8.0

NUMBERS: dict[str, str] = {
    "0,5": "'0,5' has a decimal comma; write 0.5",
    "1,5e3": "'1,5e3' has a decimal comma; write 1.5e3",
    "1,000": "'1,000' has a comma; write 1000, or 1.000 if the comma is decimal",
    "−5": "'−5' contains minus sign (U+2212); write -5",
    "５": "'５' contains fullwidth digit five (U+FF15); write 5",
    "½": "'½' contains vulgar fraction one half (U+00BD); write plain digits, '-' and '.'",
    "٣": "'٣' contains arabic-indic digit three (U+0663); write plain digits, '-' and '.'",
    "'1.0'": "'1.0' in quotes is text where a number belongs; write 1.0 without quotes",
    '"one"': "'one' in quotes is text where a number belongs; write a number",
    "yes": "'yes' is yes or no where a number belongs; write a number",
    "No": "'No' is yes or no where a number belongs; write a number",
    "true": "'true' is yes or no where a number belongs; write a number",
    "on": "'on' is yes or no where a number belongs; write a number",
    ".nan": "'.nan' is not a finite number; write a number, or leave the key out where it may be missing",
    "nan": "'nan' is not a finite number; write a number, or leave the key out where it may be missing",
    ".inf": "'.inf' is not a finite number; write a number, or leave the key out where it may be missing",
    "-.Inf": "'-.Inf' is not a finite number; write a number, or leave the key out where it may be missing",
    "infinity": "'infinity' is not a finite number; write a number, or leave the key out where it may be missing",
    "1e400": "1e400 is too large to compute with; write at most 1e+100",
    "-1e308": "-1e308 is too large to compute with; write at most 1e+100",
    "1.001e100": "1.001e100 is too large to compute with; write at most 1e+100",
    "1e-400": "1e-400 is too small to compute with; write 0, or at least 1e-100",
    "-5e-324": "-5e-324 is too small to compute with; write 0, or at least 1e-100",
    "0x1F": "0x1F is not decimal; write 31",
    "0o17": "0o17 is not decimal; write 15",
    "0b11": "0b11 is not decimal; write 3",
    "0x_": "0x_ is not decimal; write a decimal number",
    "010": "010 begins with 0 and could be octal; write it without the leading 0",
    "1_000": "1_000 has underscores; write 1000",
    "1:30": "'1:30' is written in base 60; write a decimal number",
    "~": "the value is missing; write a number",
    "": "the value is missing; write a number",
    "null": "the value is missing; write a number",
    "90°": "'90°' has a unit; write 90 alone, in the unit of the key's name",
    "3 dB": "'3 dB' has a unit; write 3 alone, in the unit of the key's name",
    "-2rad/s": "'-2rad/s' has a unit; write -2 alone, in the unit of the key's name",
    "1/3": "'1/3' is a formula; write its value",
    "2*pi": "'2*pi' is a formula; write its value",
    "1.2.3": "'1.2.3' is not a number; write one such as 0.5 or 1e-3",
    "fast": "'fast' is not a number; write one such as 0.5 or 1e-3",
    "[1]": "a list is written where a number belongs; write a number",
}


@pytest.mark.parametrize(("text", "reason"), STRUCTURES.values(), ids=STRUCTURES.keys())
def test_a_broken_file_is_refused_with_a_reason(text: str | bytes, reason: str) -> None:
    found = reasons(text)
    assert any(reason in line for line in found), found
    assert all(re.fullmatch(r"s\.yaml:\d+:\d+: [^\n\x1b]+", line) for line in found)


@pytest.mark.parametrize(("text", "reason"), NUMBERS.items(), ids=repr)
def test_what_is_no_number_is_refused_with_what_to_write(text: str, reason: str) -> None:
    column = 3 if text == "" else 16  # where nothing is written, the key is shown
    assert reasons(gain_as(text)) == [f"s.yaml:6:{column}: plant.static_gain: {reason}"]


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("text", "reason"), HEAVY.values(), ids=HEAVY.keys())
def test_a_file_made_to_be_heavy_is_refused_soon(text: str | bytes, reason: str) -> None:
    start = time.process_time()
    found = reasons(text)
    assert time.process_time() - start < TOO_LONG_S
    assert any(reason in line for line in found), found[:3]
    assert all("\n" not in line and len(line) < 400 for line in found)


HEAVY_PROGRAM = """
import sys, time
from fopi_tune.spec import load_spec
for path in sys.argv[1:]:
    start = time.process_time()
    try:
        load_spec(path)
    except ValueError as error:
        str(error)
    else:
        sys.exit(f"{path} was accepted")
    took = time.process_time() - start
    if took > 8:
        sys.exit(f"{path} took {took} s")
# VmHWM is this program's own peak; ru_maxrss would include that of the process it was forked from.
status = open("/proc/self/status", encoding="ascii").read()
print(int(status.split("VmHWM:")[1].split()[0]) // 1024)
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="peak memory is read from /proc")
@pytest.mark.parametrize("step", [3, pytest.param(1, marks=pytest.mark.long)])
def test_heavy_files_take_less_than_300_megabytes(tmp_path: Path, step: int) -> None:
    for index, (text, _) in enumerate(list(HEAVY.values())[::step]):
        (tmp_path / f"{index}.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
    paths = [str(path) for path in tmp_path.iterdir()]
    environment = os.environ | {"PYTHONPATH": str(IMPORTED), "PYTHONSAFEPATH": "1"}
    command = [sys.executable, "-c", HEAVY_PROGRAM, *paths]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 300  # one process for all of them, NumPy included


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no endless file here")
def test_an_endless_file_is_not_read_to_its_end() -> None:
    with pytest.raises(SpecError, match="it is a device, and only regular files are read"):
        load_spec("/dev/zero")


def test_the_key_on_is_a_word_and_not_a_boolean() -> None:
    assert parse_spec(BRAKE).requirements[0].scope.value == "nominal"


def test_mistakes_beside_refused_structures_are_reported_as_well() -> None:
    text = gain_as("&a fast").replace("seed: 1", "seed: *a").replace("poles: 7", "poles: many")
    assert reasons(text) == [
        "s.yaml:6:16: plant.static_gain: anchors (&name) are not allowed; remove it and write each value out",
        "s.yaml:6:16: plant.static_gain: 'fast' is not a number; write one such as 0.5 or 1e-3",
        "s.yaml:23:57: digital.poles: 'many' is not a number; write one such as 0.5 or 1e-3",
        "s.yaml:24:36: validation.seed: aliases (*name) are not allowed; write the value out",
    ]


def problems_of(text: str | bytes) -> tuple[Problem, ...]:
    try:
        parse_spec(text)
    except SpecError as error:
        return error.problems
    return ()


def parse_or_refuse(text: str | bytes) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        problems = problems_of(text)
    places = [(problem.line, problem.column) for problem in problems]
    assert places == sorted(places)
    assert all(line >= 1 and column >= 1 for line, column in places)
    assert not any("\n" in str(problem) for problem in problems)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(
    st.binary(max_size=200)
    | st.text(max_size=200)
    | st.text("{}[]:,-?&*!|>'\"%@`# \n\t<=~.0123456789aeny_", max_size=80)
)
def test_any_text_is_a_spec_or_a_spec_error(text: str | bytes) -> None:
    parse_or_refuse(text)


SNIPPETS = st.sampled_from(
    [
        "&a ",
        "*a",
        "!!x ",
        "<<: ",
        "---\n",
        "...\n",
        "? ",
        "- ",
        ": ",
        "{",
        "}",
        "[",
        "]",
        ",",
        "'",
        '"',
        ">\n",
        "%",
        "#",
        "\n",
        "\t",
        "  ",
        "~",
        "null",
        "yes",
        "1e400",
        "0x1",
        ".nan",
        "−",
        "\ufeff",
        "\x85",
        "\u2028",
        "\r",
        "on: ",
        "min: ",
        "%YAML 1.1\n",
        "\\x",
        "!<a> ",
        "&",
        "*",
        "\\UFFFFFFFF",
    ]
)


@pytest.mark.parametrize("examples", [80, pytest.param(300, marks=pytest.mark.long)])
def test_any_mutation_of_a_spec_is_a_spec_or_a_spec_error(examples: int) -> None:
    @settings(max_examples=examples, deadline=None, derandomize=True)
    @given(st.data(), st.sampled_from([BRAKE, THROTTLE]))
    def check(data: st.DataObject, text: str) -> None:
        for _ in range(data.draw(st.integers(1, 4))):
            start = data.draw(st.integers(0, len(text)))
            stop = start + data.draw(st.integers(0, 12))
            text = text[:start] + data.draw(SNIPPETS | st.text(max_size=4)) + text[stop:]
        parse_or_refuse(text)

    check()


@pytest.mark.parametrize("examples", [60, pytest.param(200, marks=pytest.mark.long)])
def test_any_rearrangement_of_lines_is_a_spec_or_a_spec_error(examples: int) -> None:
    @settings(max_examples=examples, deadline=None, derandomize=True)
    @given(st.data(), st.sampled_from([BRAKE, THROTTLE]))
    def check(data: st.DataObject, text: str) -> None:
        rows = text.splitlines(keepends=True)
        chosen = data.draw(st.lists(st.sampled_from(rows), max_size=2 * len(rows)))
        parse_or_refuse("".join(chosen))

    check()


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.floats(-LARGEST, LARGEST).filter(lambda value: value == 0.0 or abs(value) >= SMALLEST))
def test_a_number_is_read_to_the_last_bit(value: float) -> None:
    assert parse_number(repr(value)) == value

"""JSON Schemas of results: what every command writes and prints is what they say, and nothing else is."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from cases.result_kinds import COMMANDS, QUICK, documents_of
from typer.testing import CliRunner

from fopi_tune.cli import app
from fopi_tune.cli.starting.schema import Result
from fopi_tune.results.schema.check import first_problem
from fopi_tune.results.schema.kinds import RESULT_KINDS, result_schema

pytestmark = pytest.mark.usefixtures("plain_figures")


@cache
def validator(kind: str) -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(result_schema(kind))


def definitions(kind: str) -> Iterator[tuple[str, dict[str, Any]]]:
    yield from result_schema(kind)["$defs"].items()


def names(command: str) -> Any:
    return pytest.param(command, marks=[] if command in QUICK else pytest.mark.long)


@pytest.mark.parametrize("kind", RESULT_KINDS)
def test_every_schema_is_one_and_is_printed(kind: str) -> None:
    jsonschema.Draft202012Validator.check_schema(result_schema(kind))
    printed = CliRunner().invoke(app, ["schema", "--result", kind])
    assert printed.exit_code == 0
    assert printed.stdout.startswith('{\n  "$schema": "https://json-schema.org/draft/2020-12/schema"')
    assert f"fopi-tune result, {kind}" in printed.stdout


def test_the_words_of_the_command_are_the_kinds_of_results() -> None:
    assert {each.value for each in Result} == set(RESULT_KINDS)
    refused = CliRunner().invoke(app, ["schema", "--result", "design", "--study"])
    assert refused.exit_code == 2
    assert "give one of them" in refused.stderr


@pytest.mark.parametrize("kind", RESULT_KINDS)
def test_every_entry_of_fixed_keys_is_described_and_takes_no_others(kind: str) -> None:
    for name, definition in definitions(kind):
        assert definition["additionalProperties"] is False, name
        for key, entry in definition["properties"].items():
            assert len(entry.get("description", "")) >= 2, f"{name}.{key}"


@pytest.mark.parametrize("command", [names(command) for command in COMMANDS])
def test_what_is_written_and_printed_is_what_the_schema_says(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    documents = documents_of(command, tmp_path)
    assert documents
    for kind, where, document in documents:
        problems = [f"{error.json_path}: {error.message}" for error in validator(kind).iter_errors(document)]
        assert problems == [], f"{where} as {kind}"
        assert first_problem(document, result_schema(kind)) is None


@pytest.mark.long
def test_every_kind_and_every_way_to_end_is_among_the_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: set[str] = set()
    ends: set[str] = set()
    for number, command in enumerate(COMMANDS):
        folder = tmp_path / str(number)
        folder.mkdir()
        monkeypatch.chdir(folder)
        for kind, _, document in documents_of(command, folder):
            seen.add(kind)
            ends.add(f"{kind} {document.get('status')}")
    assert seen == set(RESULT_KINDS)
    wanted = {"design solved", "design infeasible", "design unbounded", "check violated", "system_proof undecided"}
    assert wanted | {"system_proof cycles", "system_proof settles", "system_simulation chattering"} <= ends


def changed(document: Any) -> Iterator[tuple[str, Any]]:
    """The document with each key of each object left out once, and renamed once; and the key."""
    entries: Any = document.items() if isinstance(document, dict) else enumerate(document)
    for key, value in entries:
        if isinstance(document, dict):
            others = {other: each for other, each in document.items() if other != key}
            yield key, others
            yield key, {**others, f"{key}_": value}
        if isinstance(value, dict | list):
            for inner_key, inner in changed(value):
                again = copy.copy(document)
                again[key] = inner
                yield inner_key, again


def test_an_entry_that_is_missing_or_renamed_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (_, _, document), *_ = documents_of("not proved", tmp_path)
    schema, refused, accepted = result_schema("design"), 0, set[str]()
    for key, each in changed(document):
        if validator("design").is_valid(each):
            accepted.add(key)
        else:
            refused += 1
            assert first_problem(each, schema) is not None
    # keys that are names of something, and ends of a band, which may be left out
    names_of = {*document["stamp"]["versions"], *document["stamp"]["digests"], "time_constant_s"}
    assert accepted == {*names_of, "from_rad_s", "to_rad_s"}
    # each of five requirements alone has a dozen entries, twice
    assert refused > 200

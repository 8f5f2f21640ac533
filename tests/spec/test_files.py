"""Files that people give: only regular ones are opened, JSON is strict, and a refusal quotes nothing of a file."""

from __future__ import annotations

import json
import os
import random
import signal
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fopi_tune.errors import DomainError
from fopi_tune.spec import files
from fopi_tune.spec.files import MAX_JSON_DEPTH, NotRegularError, parse_json, read_bytes, read_json, read_text

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pipes and devices as POSIX has them")


@pytest.fixture(autouse=True)
def ends() -> Iterator[None]:
    """A read that waits fails instead of hanging."""
    signal.alarm(20)
    yield
    signal.alarm(0)


def irregular(folder: Path) -> dict[str, Path]:
    """One path of each kind that is no file, and links to them."""
    pipe, link, bound = folder / "pipe", folder / "link", folder / "socket"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    # a socket's address may have some hundred bytes, fewer than a temporary folder's path
    where = os.open(folder, os.O_RDONLY)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(f"/proc/self/fd/{where}/{bound.name}" if os.path.isdir("/proc/self/fd") else str(bound))
    os.close(where)
    return {"a pipe": pipe, "a link to a pipe": link, "a socket": bound, "a device": Path(os.devnull)}


def test_pipes_sockets_and_devices_are_refused_without_being_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> int:
        raise AssertionError("it was opened")

    paths = irregular(tmp_path)
    monkeypatch.setattr(files.os, "open", fails)
    for words, path in paths.items():
        with pytest.raises(NotRegularError, match=f"it is {words.removeprefix('a link to ')}, and only regular files"):
            read_bytes(path, 100)


def test_a_directory_and_what_is_not_there_are_the_systems_errors(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError):
        read_bytes(tmp_path, 100)
    with pytest.raises(FileNotFoundError):
        read_bytes(tmp_path / "nothing", 100)
    for impossible in ("a\0b", "a\ud800"):
        with pytest.raises(OSError, match=r"embedded null|surrogates"):
            read_bytes(impossible, 100)


def test_a_pipe_that_takes_a_files_place_while_it_is_opened_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "spec.yaml"
    path.write_text("schema: 1\n", encoding="utf-8")
    was = os.stat(path)
    path.unlink()
    os.mkfifo(path)
    monkeypatch.setattr(files.os, "stat", lambda _: was)
    descriptors = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0
    with pytest.raises(NotRegularError):
        read_bytes(path, 100)
    if descriptors:
        assert len(os.listdir("/proc/self/fd")) == descriptors


def test_one_byte_more_than_the_limit_is_read_and_no_more(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"x" * 1000)
    assert len(read_bytes(path, 10)) == 11
    assert read_bytes(path, 1000) == b"x" * 1000
    assert read_text(path, 1000) == "x" * 1000
    with pytest.raises(DomainError, match="is larger than"):
        read_text(path, 999)


def test_line_ends_are_line_feeds(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"a\r\nb\rc\n")
    assert read_text(tmp_path / "a", 100) == "a\nb\nc\n"


def numbers(chance: random.Random) -> Any:
    return chance.choice(
        (0, -1, 2**53 + 1, 10**300, 1.5, -0.0, 5e-324, 1.7976931348623157e308, "ü\U0001f600", None, True)
    )


def tree(chance: random.Random, levels: int) -> Any:
    if levels == 0 or chance.random() < 0.3:
        return numbers(chance)
    inner = [tree(chance, levels - 1) for _ in range(chance.randrange(4))]
    return inner if chance.random() < 0.5 else {f"k{index}": each for index, each in enumerate(inner)}


@pytest.mark.parametrize("ascii_only", [True, False])
def test_what_python_writes_as_strict_json_is_read_as_python_reads_it(ascii_only: bool) -> None:
    chance = random.Random(3)
    for _ in range(200):
        text = json.dumps(tree(chance, 6), allow_nan=False, ensure_ascii=ascii_only)
        assert repr(parse_json(text)) == repr(json.loads(text))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", r"is no JSON: Expecting value \(line 1, column 1\)"),
        ('{"a": 1,\n}', r"is no JSON: .* \(line \d, column \d\)"),
        ('{"a": NaN}', "is no JSON: it holds NaN"),
        ("[-Infinity]", "is no JSON: it holds -Infinity"),
        ('{"a": [0, 1e999]}', r"a\[1\] is a number beyond what a double holds"),
        ("-1e999", "the file is a number beyond"),
        ('{"a": ' + "9" * 309 + "}", "a is a number beyond what a double holds"),
        ("9" * 310, "holds a whole number of 310 digits"),
        ("9" * 100_000, "holds a whole number of 100000 digits"),
        ('{"a": 1, "a": 1}', "names an entry twice"),
        ('[{"b": {"a": 1, "c": 2, "a": 3}}]', "names an entry twice"),
        ('{"a": "\\ud800"}', "a holds half of a surrogate pair"),
        ('{"a": {"x\\udfffy": 1}}', "a key of a holds half of a surrogate pair"),
        ("[" * (MAX_JSON_DEPTH + 1) + "]" * (MAX_JSON_DEPTH + 1), f"nested deeper than {MAX_JSON_DEPTH} levels"),
        ("[" * 100_000, "nested deeper than"),
        ('{"a":' * 100_000, "nested deeper than"),
    ],
)
def test_what_no_document_holds_is_refused_with_its_place(text: str, said: str) -> None:
    with pytest.raises(DomainError, match=said):
        parse_json(text)


def test_the_largest_whole_numbers_that_a_double_holds_are_read() -> None:
    assert parse_json("-1" + "0" * 308) == -(10**308)


def test_a_pair_of_surrogates_is_a_character() -> None:
    assert parse_json('"\\ud83d\\ude00"') == "\U0001f600"
    assert len(parse_json("[" * MAX_JSON_DEPTH + "]" * MAX_JSON_DEPTH)) == 1


def test_bytes_that_are_no_text_are_told_by_their_line(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(b'{"a":\n"\xff"}')
    with pytest.raises(DomainError, match="line 2 has a byte that is not UTF-8"):
        read_json(tmp_path / "a.json")


def test_a_refusal_quotes_nothing_of_the_file(tmp_path: Path) -> None:
    chance, secret = random.Random(7), "tr0ub4dor&3"
    for _ in range(300):
        around = "".join(chance.choice('{}[],:"0 \n') for _ in range(chance.randrange(20)))
        at = chance.randrange(len(around) + 1)
        text = around[:at] + secret + around[at:]
        (tmp_path / "a.json").write_text(text, encoding="utf-8")
        try:
            read_json(tmp_path / "a.json")
        except DomainError as error:
            assert "tr0ub" not in str(error)  # noqa: PT017


def test_a_pipe_that_is_written_to_is_refused_as_well(tmp_path: Path) -> None:
    """The writer of the pipe is not waited for, nor is what it writes taken."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    writer = threading.Thread(target=lambda: pipe.write_bytes(b"schema: 1\n"))
    writer.start()
    with pytest.raises(NotRegularError):
        read_bytes(pipe, 100)
    writer.join()
    assert os.read(reader, 100) == b"schema: 1\n"
    os.close(reader)

"""Where the mistake is in text that is not YAML.

A parser reports where it gave up, often lines below the mistake: a bracket or a quote that is never closed swallows
what follows, and a block whose first line is indented wrongly breaks at its second.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from ruamel.yaml.error import MarkedYAMLError
from ruamel.yaml.events import ScalarEvent

from fopi_tune.spec.yaml.problems import Mark

_QUOTED = re.compile(r"\"(?:[^\"\\]|\\.)*\"|'(?:[^']|'')*'")
_COMMENT = re.compile(r"(?:^|\s)#.*$")
#: a key with its colon, or an entry of a list
_ENTRY = re.compile(r"\s*(?:-\s+.*|(?:-\s+)*[\w\"'.+-][^:]*:(?:\s.*)?)")
#: what every message ends with
CHECK = "check the indentation, colons, quotes and brackets here"
#: the start of no key: a missing one, a tag, an anchor or an alias
_ODD_START = re.compile(r"\s*(?:-\s+)*[:!&*]")
_FIRST_OF_BLOCK = "this line's indentation differs from that of the next ones"
_REASON_LENGTH = 160


def syntax_problem(error: MarkedYAMLError, text: str, last: ScalarEvent | None) -> tuple[Mark, str]:
    """The place of the mistake, and a message.

    Args:
        error: of the parser.
        text: that it read.
        last: the last value that could be read.
    """
    place = error.problem_mark or error.context_mark
    stopped, lines = _mark_of(place), re.split("\r\n|[\r\n\x85\u2028\u2029]", text)
    start = stopped if error.context_mark is None else _mark_of(error.context_mark)
    context, problem = str(error.context or ""), str(error.problem or "")
    mark, advice = _mistake(context, problem, start, stopped, lines, last)
    reason = " ".join(", ".join(part for part in (context, problem) if part).split())[:_REASON_LENGTH]
    gave_up = f", given up on line {stopped.line}" if stopped.line != mark.line else ""
    if "'\\t'" in problem:
        return stopped, f"not valid YAML ({reason}); indent with spaces, not with tabs"
    return mark, f"not valid YAML ({reason}{gave_up}){advice and f': {advice}'}; {CHECK}"


def _mistake(
    context: str, problem: str, start: Mark, stopped: Mark, lines: list[str], last: ScalarEvent | None
) -> tuple[Mark, str]:
    if "quoted scalar" in context and "end of" in problem:
        return start, "the quote that opens here is not closed"
    over_lines = last is not None and last.style in ("'", '"') and last.start_mark.line < last.end_mark.line
    if last is not None and over_lines and last.end_mark.line + 1 == stopped.line:
        return _mark_of(last.start_mark), "the quote that opens here is not closed on its line"
    if "flow" in context:
        return _in_brackets(start, stopped, lines)
    if "simple key" in context:
        return start, "a colon, and a space after it, is missing here, or a quote or bracket is too much"
    if "mapping values" in problem:
        return _second_colon(stopped, lines)
    if "<block end>" in problem and ("<block" in problem.partition("found")[2] or "'?'" in problem):
        return _in_block(stopped, lines)
    if "<document start>" in problem:
        # a directive, or a first line that is indented
        first = next((number for number, line in enumerate(lines, 1) if _content(line).strip()), stopped.line)
        return Mark(first, 1), ""
    return stopped, ""


def _in_brackets(start: Mark, stopped: Mark, lines: list[str]) -> tuple[Mark, str]:
    """A list or mapping in brackets goes on over lines only after a comma or an opening bracket."""
    for number in range(start.line, min(stopped.line, len(lines) + 1)):
        content = _content(lines[number - 1]).rstrip()
        if content and content[-1] not in ",[{:":
            column = start.column if number == start.line else len(content)
            return Mark(number, column), "a bracket that opens here or above is not closed, or a comma is missing"
    last = next((number for number in range(stopped.line, 0, -1) if _content(lines[number - 1]).strip()), 1)
    return (stopped if last == stopped.line else Mark(last, 1)), ""


def _in_block(stopped: Mark, lines: list[str]) -> tuple[Mark, str]:
    """Of the lines above with another indentation and those that follow with this one, the fewer are the mistake."""
    column = stopped.column - 1
    indents = [_indent(line) for line in lines]
    below = _run(indents[stopped.line - 1 :], lambda indent: indent >= column)
    above = _run(indents[stopped.line - 2 :: -1] if stopped.line > 1 else [], lambda indent: indent > column)
    previous = next((number for number in range(stopped.line - 1, 0, -1) if indents[number - 1] is not None), None)
    if previous is None:
        return stopped, ""
    for number in (previous, *(stopped.line - 1 - distance for distance in above)):
        if _ODD_START.match(lines[number - 1]):
            return Mark(number, 1), "a character that has a meaning of its own begins this line"
    if not above and indents[previous - 1] != column:
        return _deeper(stopped, lines)
    above = above or _run(indents[stopped.line - 2 :: -1], lambda indent: indent == column)
    siblings = list(above.values()).count(min(above.values(), default=0))
    if above and siblings < list(below.values()).count(column):
        number = stopped.line - 1 - max(above)
        return Mark(number, (indents[number - 1] or 0) + 1), _FIRST_OF_BLOCK
    return stopped, "this line's indentation, or how it begins, differs from that of the lines above"


def _run(indents: list[int | None], belongs: Callable[[int], bool]) -> dict[int, int]:
    """The first lines that belong, by their distance; empty lines are passed over."""
    found: dict[int, int] = {}
    for distance, indent in enumerate(indents):
        if indent is None:
            continue
        if not belongs(indent):
            break
        found[distance] = indent
    return found


def _second_colon(stopped: Mark, lines: list[str]) -> tuple[Mark, str]:
    """A colon where no key can be: in text, or in a line that a value above runs on to."""
    before = lines[stopped.line - 1][: stopped.column - 1]
    first = stopped
    if not _ENTRY.fullmatch(before):
        for number in range(stopped.line - 1, 0, -1):
            content = _content(lines[number - 1])
            if content.strip():
                if _ENTRY.fullmatch(content):
                    break
                first = Mark(number, len(content) - len(content.lstrip()) + 1)
        if first == stopped:
            return _deeper(Mark(stopped.line, len(before) - len(before.lstrip()) + 1), lines)
        return first, "a colon, or the space after it, is missing here"
    return stopped, "put text with a colon in it in quotes, and a mapping in braces"


def _deeper(stopped: Mark, lines: list[str]) -> tuple[Mark, str]:
    """A line below a value and deeper than it: one of both is indented wrongly."""
    indents = [_indent(line) for line in lines]
    above = next((number for number in range(stopped.line - 1, 0, -1) if indents[number - 1] is not None), None)
    if above is None:
        return stopped, ""
    own = indents[above - 1]
    alone = sum(i == own for i in _run(indents[above - 1 :: -1], lambda indent: indent >= (own or 0)).values()) == 1
    followed = len(_run(indents[stopped.line - 1 :], lambda indent: indent == stopped.column - 1)) > 1
    if alone and followed:
        return Mark(above, (own or 0) + 1), _FIRST_OF_BLOCK
    return stopped, "this line is indented deeper than the one above, which has a value already or begins a list"


def _content(line: str) -> str:
    """The line without its comment, quoted text replaced by quotes."""
    return _COMMENT.sub("", _QUOTED.sub('""', line))


def _indent(line: str) -> int | None:
    """Spaces before the line's text; None of a line without one."""
    content = _content(line)
    return len(content) - len(content.lstrip(" ")) if content.strip() else None


def _mark_of(mark: Any) -> Mark:
    return Mark(mark.line + 1, mark.column + 1)

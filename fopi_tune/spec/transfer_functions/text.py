"""Text -> statements of tokens, each with its place in the text.

A fraction that is printed in three lines, numerator, bar, denominator, becomes  before (numerator) / (denominator).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from fopi_tune.spec.parametric.descent import ExpressionError, Token
from fopi_tune.spec.yaml.problems import quoted

MAX_LENGTH = 4000
_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)|(?P<name>[A-Za-z_][A-Za-z0-9_]*)"
    r"|(?P<text>'[^'\n]*'|\"[^\"\n]*\")|(?P<sign>\*\*|\.[*/^]|[-+*/^()\[\]{},=.²³−–·×⋅∗÷])"
)
#: signs as papers and other languages print them
_SAME = {
    "^": "**", ".^": "**", ".*": "*", "./": "/", "−": "-", "–": "-", "·": "*", "×": "*", "⋅": "*", "∗": "*", "÷": "/",
    "{": "(", "}": ")",
}  # fmt: skip
#: a bar, and what may stand before it: a factor with its sign, or the name of an output
_BAR = re.compile(r"(?P<before>[^\n]*?[*:=]|)[ \t]*(?P<bar>[-─—]+)[ \t]*(?P<after>[^\n]*)")
_OUTPUT = re.compile(r"\s*[A-Za-z_]\w*\s*[:=]\s*")
_NAME_LINE = re.compile(r"\s*[A-Za-z_]\w*(?:\([sp]\))?\s*=\s*|\s*y\d+\s*:\s*")
#: lines that programs print around a transfer function
_AROUND = re.compile(
    r"\s*(?:continuous[- ]time\b.*|transfer function\b.*|model properties\.?|from input\b.*|<\w+>.*|"
    r"(?:inputs|outputs)\s*\(1\).*|ans\s*=\s*|>>\s*)",
    re.IGNORECASE,
)
_DISCRETE = re.compile(r"discrete[- ]time|sample time|sampling time|\bdt\s*=\s*(?:[0-9.]*[1-9]|True)", re.IGNORECASE)
#: MATLAB's cells of polynomials
_SEVERAL = re.compile(r"\{\s*\[")
_LEFT = re.compile(r"\s*(?P<name>[A-Za-z_]\w*)(?:\s*\(\s*[sp]\s*\)|\.(?P<option>[A-Za-z]\w*))?\s*=(?!=)")


@dataclass(frozen=True)
class Statement:
    """name = tokens, or name.option = tokens.

    Args:
        name: what is assigned; "" where nothing is named.
        option: a property of it, "" of none.
        tokens: the expression, the last of kind "end".
        at: where it begins.
    """

    name: str
    option: str
    tokens: tuple[Token, ...]
    at: int


def statements(text: str) -> list[Statement]:
    """What a text says, in order.

    Raises:
        ExpressionError: characters, lines or lengths that cannot be understood.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(0, f"the text has {len(text)} characters; give at most {MAX_LENGTH}")
    if (discrete := _DISCRETE.search(text)) is not None:
        raise ExpressionError(discrete.start(), DISCRETE)
    if (several := _SEVERAL.search(text)) is not None:
        raise ExpressionError(several.start(), SEVERAL)
    lines = _lines(text)
    bars = [k for k in range(1, len(lines) - 1) if _BAR.fullmatch(lines[k][1]) and lines[k + 1][1].strip()]
    if len(bars) > 1:
        at = lines[bars[1]][0]
        raise ExpressionError(at, SEVERAL)
    found = [_fraction(lines, bars[0], text)] if bars else list(_plain(lines))
    if not found:
        raise ExpressionError(0, "there is no transfer function; write one, such as 4.39/(s + 0.1746)")
    return found


SEVERAL = "this has several inputs, outputs or fractions; give one transfer function, of one input and one output"
DISCRETE = (
    "this is a system in discrete time; give the plant in continuous time (d2c), the controller's samples are the "
    "spec's `digital`"
)


def _lines(text: str) -> list[tuple[int, str]]:
    """Offset and text of the lines that say something; comments are blank."""
    found, at = [], 0
    for line in text.split("\n"):
        plain = re.sub(r"[%#].*", "", line).replace("\r", "")
        if plain.strip() and _AROUND.fullmatch(plain) is None:
            found.append((at, plain))
        at += len(line) + 1
    return found


def _fraction(lines: Sequence[tuple[int, str]], k: int, text: str) -> Statement:
    """The fraction whose bar is line `k`."""
    for j, (at, line) in enumerate(lines):
        if abs(j - k) > 1 and _NAME_LINE.fullmatch(line) is None:
            raise ExpressionError(
                at, f"{quoted(line.strip())} belongs to no fraction; give numerator, bar, denominator"
            )
    at, line = lines[k]
    match = _BAR.fullmatch(line)
    assert match is not None
    if match.group("after").strip():
        raise ExpressionError(at + match.start("after"), "what stands behind the bar is not understood; put it before")
    before = (
        _OUTPUT.sub("", match.group("before"), count=1) if _OUTPUT.match(match.group("before")) else match["before"]
    )
    bar = at + match.start("bar")
    above, below = (tuple(_tokens(lines[j][1], lines[j][0])) for j in (k - 1, k + 1))
    ahead = tuple(_tokens(before, at + match.end("before") - len(before)))
    end = lines[k + 1][0] + len(lines[k + 1][1].rstrip())

    def sign(what: str, where: int) -> Token:
        return Token("sign", what, where)

    tokens = (
        *ahead, sign("(", bar), *above, sign(")", bar), sign("/", bar), sign("(", bar), *below, sign(")", end),
        Token("end", "", min(end, len(text))),
    )  # fmt: skip
    return Statement("", "", tokens, lines[k - 1][0])


def _plain(lines: Sequence[tuple[int, str]]) -> Iterator[Statement]:
    """Statements between semicolons and lines; a line that ends within a parenthesis goes on."""
    whole = ""
    for at, line in lines:
        whole = whole.ljust(at - 1) + ("\n" if at else "") + line
    start = depth = 0
    for k, character in enumerate(whole + ";"):
        depth += (character in "([{") - (character in ")]}")
        if k == len(whole) or (character in ";\n" and depth <= 0):
            part = whole[start:k]
            if part.strip():
                yield _statement(part, start)
            start, depth = k + 1, 0


def _statement(part: str, start: int) -> Statement:
    left = _LEFT.match(part)
    first = left.end() if left else 0
    tokens = list(_tokens(part[first:], start + first))
    end = start + len(part.rstrip())
    if not tokens:
        raise ExpressionError(end, "an expression is missing; write one such as 4.39/(s + 0.1746)")
    name, option = (left["name"], left["option"] or "") if left else ("", "")
    return Statement(name, option, (*_separated(tokens), Token("end", "", end)), start)


def _tokens(text: str, at: int) -> Iterator[Token]:
    place = 0
    while place < len(text):
        if text[place].isspace() or text[place] == ";":
            # within a list a semicolon begins a row: it separates like a comma
            if text[place] == ";":
                yield Token("sign", ",", at + place)
            place += 1
            continue
        match = _TOKEN.match(text, place)
        if match is None:
            raise ExpressionError(at + place, _about_character(text[place]))
        kind, found = str(match.lastgroup), match.group()
        if found in "²³":
            yield from (Token("sign", "**", at + place), Token("number", {"²": "2", "³": "3"}[found], at + place))
        else:
            yield Token(kind, _SAME.get(found, found), at + place)
        place = match.end()


def _about_character(character: str) -> str:
    if character == "\\":
        return "LaTeX is not read; write (numerator)/(denominator)"
    return f"{character!r} does not belong here; write numbers, s, + - * / ^, parentheses, exp(-L*s), tf(…) or zpk(…)"


def _separated(tokens: Sequence[Token]) -> Iterator[Token]:
    """With the commas that blanks stand for in a list: [1 -2] has two entries, [1 - 2] and [1 -2*3 ] as it reads."""
    opened: list[str] = []
    for k, token in enumerate(tokens):
        last = tokens[k - 1] if k else None
        if opened and opened[-1] == "[" and last is not None and token.at > last.end and _ends(last):
            after = tokens[k + 1] if k + 1 < len(tokens) else token
            signed = token.kind == "sign" and token.text in "+-" and after.at == token.end
            if signed or token.kind in ("number", "name", "text") or token.text in ("(", "["):
                yield Token("sign", ",", token.at)
        if token.kind == "sign" and token.text in ("(", "["):
            opened.append(token.text)
        elif token.kind == "sign" and token.text in (")", "]") and opened:
            opened.pop()
        yield token


def _ends(token: Token) -> bool:
    return token.kind in ("number", "name", "text") or token.text in (")", "]")

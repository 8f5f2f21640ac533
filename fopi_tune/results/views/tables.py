"""Tables of results:  the JSON of a result -> rows, one for each requirement, limit or measure."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

Row = dict[str, Any]

_SIGNS = {"at_least": ">=", "at_most": "<=", "equals": "="}
_DIGITS = 5
#: words of a row -> what a table has above them
_HEADS = {"requirement": "requirement or limit", "low": "at least", "high": "at most"}


def rows_of(document: Mapping[str, Any]) -> list[Row]:
    """The rows of a result, in the order of the spec; no rows of a result without requirements.

    Args:
        document: as `to_dict()` gives it, of a design, a check, evidence or a simulation, of a loop or a system.
    """
    rows = [_counted("all at once", document["joint_yield"])] if "joint_yield" in document else []
    if "stable" in document:
        rows.append(_counted("stable loop", document["stable"]))
    for part in ("requirements", "scenario_requirements", "limits"):
        rows += [_judged(entry) for entry in document.get(part, ())]
    for scenario in document.get("scenarios", ()):
        rows += _of_scenario(scenario)
    return rows


def phrase_of(entry: Mapping[str, Any]) -> str:
    """A requirement or limit as a formula: "phase_margin_deg >= 80"."""
    limits = entry.get("limits", entry.get("limit"))
    numbers = [f"{each:.10g}" for each in (limits if isinstance(limits, Sequence) else [limits])]
    relation = entry.get("side", entry["relation"])
    if relation == "between":
        return f"{entry['name']} in [{', '.join(numbers)}]"
    return f"{entry['name']} {_SIGNS[relation]} {numbers[-1 if relation == 'at_most' else 0]}"


def html_table(rows: Sequence[Row]) -> str:
    """Rows as an HTML table; columns are those of any row, numbers have five digits."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    head = "".join(f"<th>{html.escape(_HEADS.get(name, name.replace('_', ' ')))}</th>" for name in columns)
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(_shown(row.get(name)))}</td>" for name in columns) + "</tr>" for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _judged(entry: Mapping[str, Any]) -> Row:
    if "fraction" in entry:
        median = [each["value"] for each in entry["quantiles"] if each["probability"] == 0.5]
        worst = entry["worst"][0]["value"] if entry["worst"] else None
        return {**_counted(phrase_of(entry), entry["fraction"]), "median": (median or [None])[0], "worst": worst}
    proof = entry.get("proof") or {}
    verdict = entry.get("verdict") or proof.get("verdict") or ("met" if entry["met"] else "violated")
    if not entry["met"]:
        verdict = "violated" if entry.get("achieved") is not None or entry.get("outcome") else "open"
    return {
        "requirement": phrase_of(entry),
        "on": entry.get("scenario") or entry.get("on"),
        "verdict": verdict,
        "achieved": entry.get("achieved"),
        "score": entry.get("score"),
        "multiplier": entry.get("multiplier"),
    }


def _counted(what: str, counted: Mapping[str, Any]) -> Row:
    return {"requirement": what, **{name: counted[name] for name in ("met", "total", "low", "high")}}


def _of_scenario(scenario: Mapping[str, Any]) -> Iterator[Row]:
    name = scenario["name"]
    if "measures" not in scenario:
        for entry in scenario["limits"]:
            yield {"scenario": name, **_judged(entry)}
        return
    limits = {entry["name"]: entry for entry in scenario["limits"]}
    for measure, value in scenario["measures"].items():
        entry = limits.get(measure)
        told = {} if entry is None else {"requirement": phrase_of(entry), "met": entry["met"]}
        yield {"scenario": name, "measure": measure, "value": value, **told}


def _shown(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.{_DIGITS}g}"
    return str(value)

"""Words and signs for pages:  "phase_margin_deg >= 80" -> "phase margin ≥ 80°"."""

from __future__ import annotations

import re

from fopi_tune.core.plant import PLANT_MODELS
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.report.text.formatting import TIE
from fopi_tune.spec.measures import MEASURES

#: end of an identifier -> its unit as people write it, the longest first
_UNITS = {
    "_deg_per_decade": f"{TIE}°/decade",
    "_m_s2": f"{TIE}m/s²",
    "_per_s2": f"{TIE}per s²",
    "_per_s": f"{TIE}per s",
    "_rad_s": f"{TIE}rad/s",
    "_deg": "°",
    "_db": f"{TIE}dB",
    "_s": f"{TIE}s",
}
#: what has letters of its own
_OWN = {
    "iae": "∫|r − y| dt",
    "ise": "∫(r − y)² dt",
    "iae_disturbance": "∫e(t) dt after a load step",
    "depth": "depth inside all requirements",
    "sensitivity_db": f"|S|{TIE}dB",
    "complementary_sensitivity_db": f"|T|{TIE}dB",
    "control_sensitivity_db": f"|C S|{TIE}dB",
    "load_sensitivity_db": f"|P S|{TIE}dB",
    "loop_gain_db": f"|L|{TIE}dB",
}
_SIGNS = {">=": "≥", "<=": "≤"}
#: a relation as specs write it, before its value
_SPELT = re.compile(r" (at_least|at_most|equals) (?=-?[0-9])")
_SPELT_SIGNS = {"at_least": ">=", "at_most": "<=", "equals": "="}
#: every identifier that pages put into words; a family's own names stay as they were written
_KNOWN = {
    *QUANTITIES, *MEASURES, *(kind.value for kind in ObjectiveKind),
    *(name for model in PLANT_MODELS.values() for name in model.scalars),
}  # fmt: skip
#: the name of a mode before one of its plant's numbers: "brake.time_constant_s"
_OF_MODE = re.compile(r"\b([a-z][a-z0-9_]*)\.([a-z][a-z0-9_]*)\b")
_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
#: an identifier, a relation and its value: the value takes the unit
_RELATION = re.compile(rf"\b([a-z][a-z0-9_]*)([{TIE} ](?:>=|<=|=|≈)[{TIE} ])(-?[0-9][0-9.e+-]*)")


def name_and_unit(identifier: str) -> tuple[str, str]:
    """An identifier's words, and its unit with the space before it: ("phase margin", "°"); an unknown one as it is."""
    if identifier not in _KNOWN:
        return identifier, ""
    if identifier in _OWN:
        word, _, unit = _OWN[identifier].partition(TIE)
        return word, f"{TIE}{unit}" if unit else ""
    for end, unit in _UNITS.items():
        if identifier.endswith(end):
            return identifier.removesuffix(end).replace("_", " "), unit
    return identifier.replace("_", " "), ""


def axis_label(identifier: str) -> str:
    """An identifier as the label of an axis: "time constant, s"."""
    name, unit = name_and_unit(identifier)
    return ", ".join(part for part in (name, unit.strip(f"{TIE} ")) if part)


def in_words(text: str) -> str:
    """A sentence or formula with known identifiers as words, the values after them with their units, and with signs.

    "phase_margin_deg >= 80" becomes "phase margin ≥ 80°"; "omega" becomes "ω".
    """

    def of_mode(found: re.Match[str]) -> str:
        return f"{found[1]} {found[2]}" if found[2] in _KNOWN else found[0]

    def relation(found: re.Match[str]) -> str:
        name, unit = name_and_unit(found[1])
        return f"{name}{found[2]}{found[3]}{unit}" if found[1] in _KNOWN else found[0]

    def word(found: re.Match[str]) -> str:
        return {"omega": "ω", "alpha": "α", "mu": "μ"}.get(found[0], name_and_unit(found[0])[0])

    text = _SPELT.sub(lambda found: f" {_SPELT_SIGNS[found[1]]} ", text)
    said = _WORD.sub(word, _RELATION.sub(relation, _OF_MODE.sub(of_mode, text)))
    for sign, shown in _SIGNS.items():
        said = said.replace(sign, shown)
    return re.sub(r"(?<![\w.])-(?=\d)", "−", said)

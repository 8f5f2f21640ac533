"""The shape of `objective:`, made from the registry of objectives."""

from __future__ import annotations

from fopi_tune.quantities.objectives import OBJECTIVES
from fopi_tune.spec.model import Objective, Sense
from fopi_tune.spec.places import Place
from fopi_tune.spec.records import Key, OneKeyOf, Record, Values
from fopi_tune.spec.shapes import Choice, Number, Shape

_HORIZON_OBJECTIVE = "iae_disturbance"


def objective_shape() -> Shape:
    """Reads to an `Objective`."""
    records = {sense: _sense_record(Sense(sense), words) for sense, words in OBJECTIVES.items()}
    return OneKeyOf("what to do with the freedom the requirements leave", "sense", records, "{maximize: ki}")


def _sense_record(sense: Sense, words: tuple[str, ...]) -> Record:
    keys = {sense.value: Key(Choice(f"what to {sense.value}", words))}
    reason = f"horizon_s belongs to minimize: {_HORIZON_OBJECTIVE} alone; remove it"

    def build(values: Values, place: Place) -> Objective | None:
        word = values[sense.value]
        if "horizon_s" in values and word != _HORIZON_OBJECTIVE:
            place.child("horizon_s").refuse(reason)
            return None
        return Objective(sense, word, values.get("horizon_s"))

    meaning = f"{sense.value} one number"
    if _HORIZON_OBJECTIVE not in words:
        return Record(meaning, keys, build, "{maximize: ki}", {"horizon_s": reason})
    keys["horizon_s"] = Key(Number("discount time T of the error integral, s", above=0), required=False)
    rules = {"dependentSchemas": {"horizon_s": {"properties": {sense.value: {"const": _HORIZON_OBJECTIVE}}}}}
    return Record(meaning, keys, build, "{maximize: ki}", rules=rules)

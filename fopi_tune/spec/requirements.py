"""The shapes of `requirements:` and `objective:`, and the contradictions that are found without solving."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.core.plant import PlantFamily
from fopi_tune.quantities import QUANTITIES, Quantity
from fopi_tune.quantities.objectives import OBJECTIVES
from fopi_tune.spec.measure_words import measure_as_requirement, measure_meant
from fopi_tune.spec.measures import DESIGNED_MEASURES
from fopi_tune.spec.model import Objective, Relation, Requirement, Scope, Sense
from fopi_tune.spec.scenarios import limit_records
from fopi_tune.spec.yaml.advice import Advised, relation_advice, word_advice
from fopi_tune.spec.yaml.hints import closest
from fopi_tune.spec.yaml.nodes import Place, ScalarNode
from fopi_tune.spec.yaml.problems import quoted
from fopi_tune.spec.yaml.records import Key, OneKeyOf, Record, Values
from fopi_tune.spec.yaml.shapes import Choice, JsonSchema, ListOf, Number, Pair, PlainOrMapping, Shape, Text

#: every pair is checked for contradictions
MAX_REQUIREMENTS = 500
_BAND_KEYS: tuple[str, ...] = ("from_rad_s", "to_rad_s", "at_rad_s")
_RELATION_EXAMPLE = "{at_least: 60} or {between: [60, 70]}"
_EXAMPLE = "{phase_margin_deg: {at_least: 60}}"
BY_FREQUENCY = "by_frequency"
#: of a limit by the frequency
MAX_POINTS = 50
_SHAPED_EXAMPLE = "{by_frequency: [[0.01, -40], [0.1, -20], [2, 3]]}"


@dataclass(frozen=True)
class PlacedRequirement:
    """A requirement and where it is written."""

    requirement: Requirement
    place: Place

    @property
    def limit_place(self) -> Place:
        """Where its limit is written."""
        return self.place.child(self.requirement.quantity).child(self.requirement.relation.value)


def requirements_shape() -> ListOf:
    """Reads to a list of `PlacedRequirement`, of measures of scenarios `PlacedLimit`; None for each that is wrong.

    An entry with `by_frequency` is a list of them.
    """
    records = {name: _record(quantity) for name, quantity in QUANTITIES.items()}
    records |= limit_records(DESIGNED_MEASURES)
    requirement = OneKeyOf("one quantity with one relation", "quantity", records, _EXAMPLE, measure_as_requirement)
    return ListOf("what the loop must do; all of them hold together", requirement, 0, MAX_REQUIREMENTS)


def refuse_equalities_over_families(placed: Sequence[PlacedRequirement], plant: PlantFamily) -> None:
    """Reports `equals` over an uncertain family or several plants, which no controller can meet."""
    if plant.has_one_plant:
        return
    for each in placed:
        if each.requirement.relation is Relation.EQUALS and each.requirement.scope is Scope.FAMILY:
            plants = "a list" if isinstance(plant, PlantList) else "an uncertain family"
            message = f"not every plant of {plants} can have the same value; write between, or on: nominal"
            each.limit_place.refuse(message)


def refuse_bands_above_nyquist(placed: Sequence[PlacedRequirement], nyquist_rad_s: float) -> None:
    """Reports bands that begin at Nyquist's frequency or above, where a loop on samples has no response."""
    for each in placed:
        if each.requirement.end_limit is not None:
            if each.requirement.to_rad_s >= nyquist_rad_s:
                message = f"reaches to Nyquist's frequency, {nyquist_rad_s:.6g} rad/s, or beyond; end it below"
                each.limit_place.refuse(message)
        elif each.requirement.from_rad_s >= nyquist_rad_s:
            key = "at_rad_s" if each.place.has("at_rad_s") else "from_rad_s"
            message = f"lies above Nyquist's frequency, {nyquist_rad_s:.6g} rad/s; sample faster, or lower it"
            each.place.child(key).refuse(message)


def refuse_contradictions(placed: Sequence[PlacedRequirement]) -> None:
    """Reports every requirement that contradicts an earlier one, once.

    The nominal plant is a member of the family, so two limits of the same quantity always share that plant.
    """
    for number, later in enumerate(placed):
        earlier = next((each for each in placed[:number] if _contradict(each.requirement, later.requirement)), None)
        if earlier is not None:
            line, here = earlier.limit_place.mark.line, later.limit_place.mark.line
            message = f"{_in_words(later)} on line {here} contradicts {_in_words(earlier)} on line {line}; relax one"
            later.limit_place.refuse(message)


def _contradict(a: Requirement, b: Requirement) -> bool:
    if a.end_limit is not None or b.end_limit is not None:
        return False
    if a.quantity != b.quantity or (a.lower <= b.upper and b.lower <= a.upper):
        return False
    # a quantity without a band has the default one, all frequencies; touching bands share one frequency
    return max(a.from_rad_s, b.from_rad_s) <= min(a.to_rad_s, b.to_rad_s)


def _in_words(placed: PlacedRequirement) -> str:
    requirement = placed.requirement
    limits = ", ".join(f"{limit:g}" for limit in requirement.limits)
    return f"{requirement.relation.value} {limits if len(requirement.limits) == 1 else f'[{limits}]'}"


def _record(quantity: Quantity) -> Record:
    keys = {
        quantity.name: Key(_relation_shape(quantity)),
        "on": Key(Choice("every plant, or the nominal one alone", [s.value for s in Scope]), False, Scope.FAMILY.value),
    }
    build = partial(_build_requirement, quantity)
    simulated = f"{quantity.name} is about the loop's frequency response, whatever is simulated; remove the key"
    elsewhere = {"scenario": simulated}
    if not quantity.takes_band:
        reason = f"{quantity.name} is one number a loop, not a function of frequency; remove the key"
        elsewhere |= dict.fromkeys(_BAND_KEYS, reason)
        return Record(quantity.meaning, keys, build, _EXAMPLE, elsewhere)
    meanings = ("lower end of the band", "upper end of the band", "the only frequency")
    for key, meaning in zip(_BAND_KEYS, meanings, strict=True):
        keys[key] = Key(Number(f"{meaning}, rad/s", above=0), required=False)
    return Record(quantity.meaning, keys, build, _EXAMPLE, elsewhere, rules=_band_rules(quantity.name))


def _band_rules(name: str) -> JsonSchema:
    # at_rad_s excludes the other two, and equals needs it
    return {
        "dependentSchemas": {"at_rad_s": {"properties": {"from_rad_s": False, "to_rad_s": False}}},
        "if": {"properties": {name: {"required": ["equals"]}}},
        "then": {"required": ["at_rad_s"]},
    }


def _relation_shape(quantity: Quantity) -> Shape:
    number = Number("the limit, in the unit of the quantity's name")
    records = {
        relation.value: Record(
            f"{quantity.name} {relation.value.replace('_', ' ')} the limit",
            {relation.value: Key(_limit_shape(quantity, relation, number))},
            partial(_build_limits, quantity, relation),
            _RELATION_EXAMPLE,
        )
        for relation in Relation
    }
    relation = OneKeyOf("how the quantity relates to its limit", "relation", records, _RELATION_EXAMPLE)
    return Advised(relation, relation_advice(tuple(Relation)))


@dataclass(frozen=True)
class LimitByFrequency:
    """A limit in dB that is straight over log omega between points.

    Args:
        points: rad/s and dB; two at least, the frequencies increasing.
    """

    points: tuple[tuple[float, float], ...]

    def lines(self, requirement: Requirement) -> list[Requirement]:
        """A requirement for each line; that of equal limits at both ends has one number."""
        found = []
        for (low, first), (high, last) in zip(self.points, self.points[1:], strict=False):
            end = None if first == last else last
            found.append(replace(requirement, limits=(first,), from_rad_s=low, to_rad_s=high, end_limit=end))
        return found


def _shaped_or_plain(number: Number) -> Shape:
    """A number, or points by the frequency; reads to a float or a `LimitByFrequency`."""
    point = ListOf("[rad/s, dB]", number, 2, 2)
    keys = {BY_FREQUENCY: Key(ListOf("points [rad/s, dB], the frequencies increasing", point, 2, MAX_POINTS))}
    record = Record("a limit that is straight over log omega between points", keys, _build_points, _SHAPED_EXAMPLE)
    return PlainOrMapping(number, record)


def _build_points(values: Values, place: Place) -> LimitByFrequency | None:
    points = tuple((omega, limit) for omega, limit in values[BY_FREQUENCY])
    where, before = place.child(BY_FREQUENCY), 0.0
    for index, (omega, _) in enumerate(points):
        if omega <= before:
            advice = "a frequency must be greater than 0" if index == 0 else "frequencies must increase"
            where.item(index).item(0).refuse(f"{advice}; write points as [rad/s, dB]")
            return None
        before = omega
    return LimitByFrequency(points)


def _limit_shape(quantity: Quantity, relation: Relation, number: Number) -> Shape:
    if relation is Relation.BETWEEN:
        return Pair("[low, high]", number)
    one_sided = relation in (Relation.AT_MOST, Relation.AT_LEAST)
    return _shaped_or_plain(number) if one_sided and quantity.takes_band else number


def _build_limits(quantity: Quantity, relation: Relation, values: Values, place: Place) -> Values | None:
    limit = place.child(relation.value)
    value = values[relation.value]
    if isinstance(value, LimitByFrequency):
        return {"relation": relation, "limits": value}
    ends = value if isinstance(value, tuple) else (value,)
    places = [limit.item(i) for i in range(2)] if isinstance(value, tuple) else [limit]
    checked = [(where, quantity.check_limit(end)) for where, end in zip(places, ends, strict=True)]
    for where, wrong in checked:
        if wrong is not None:
            where.refuse(wrong)
    return {"relation": relation, "limits": ends} if all(wrong is None for _, wrong in checked) else None


def _build_requirement(
    quantity: Quantity, values: Values, place: Place
) -> PlacedRequirement | list[PlacedRequirement] | None:
    limits = values[quantity.name]
    if isinstance(limits["limits"], LimitByFrequency):
        return _lines(quantity, values, place)
    band = _band(values, place)
    if quantity.takes_band and limits["relation"] is Relation.EQUALS and "at_rad_s" not in values:
        where = place.child(quantity.name).child("equals")
        where.refuse("no controller keeps a function of frequency at one value; add at_rad_s, or write between")
        return None
    if band is None:
        return None
    scope = Scope(values.get("on", Scope.FAMILY.value))
    requirement = Requirement(
        quantity.name, **limits, scope=scope, from_rad_s=band[0], to_rad_s=band[1], line=place.mark.line
    )
    return PlacedRequirement(requirement, place)


def _lines(quantity: Quantity, values: Values, place: Place) -> list[PlacedRequirement] | None:
    """A requirement for each line of `by_frequency`."""
    beside = [key for key in _BAND_KEYS if key in values]
    for key in beside:
        place.child(key).refuse(
            f"is given beside {BY_FREQUENCY}, whose band is from its first to its last point; remove it"
        )
    if beside:
        return None
    said, scope = values[quantity.name], Scope(values.get("on", Scope.FAMILY.value))
    whole = Requirement(quantity.name, said["relation"], (0.0,), scope=scope, line=place.mark.line)
    return [PlacedRequirement(line, place) for line in said["limits"].lines(whole)]


def _band(values: Values, place: Place) -> tuple[float, float] | None:
    if "at_rad_s" in values:
        wrong = [key for key in ("from_rad_s", "to_rad_s") if key in values]
        for key in wrong:
            place.child(key).refuse("is given beside at_rad_s; keep at_rad_s alone, or from_rad_s and to_rad_s")
        return None if wrong else (values["at_rad_s"], values["at_rad_s"])
    low, high = values.get("from_rad_s", 0.0), values.get("to_rad_s", math.inf)
    if low < high:
        return low, high
    place.child("from_rad_s").refuse(f"from {low} is not less than to {high}; swap them, or write at_rad_s for one")
    return None


_HORIZON_OBJECTIVE = "iae_disturbance"


def _unoptimised(place: Place) -> str | None:
    text = place.node.text if isinstance(place.node, ScalarNode) else ""
    known = [*(word for words in OBJECTIVES.values() for word in words), *DESIGNED_MEASURES]
    found, measure = measure_meant(text)
    if not found or text in known or closest(text, known) is not None:
        return None
    if measure in DESIGNED_MEASURES:
        return f"{quoted(text)} is no measure; write minimize: {measure}, with scenario: and the scenario's name"
    return f"{quoted(text)} is not optimised; {measure or 'overshoot'} can be limited under limits"


def objective_shape() -> Shape:
    """Reads to an `Objective`."""
    records = {sense: _sense_record(Sense(sense), words) for sense, words in OBJECTIVES.items()}
    objective = OneKeyOf("what to do with the freedom the requirements leave", "sense", records, "{maximize: ki}")
    return Advised(objective, word_advice(OBJECTIVES))


def _sense_record(sense: Sense, words: tuple[str, ...]) -> Record:
    reason = f"horizon_s belongs to minimize: {_HORIZON_OBJECTIVE} alone; remove it"
    of_scenarios = "scenario belongs to minimize: and a measure of it, such as iae; remove it"
    minimised = sense is Sense.MINIMIZE
    every = (*words, *DESIGNED_MEASURES) if minimised else words
    keys = {sense.value: Key(Advised(Choice(f"what to {sense.value}", every), _unoptimised))}

    def build(values: Values, place: Place) -> Objective | None:
        word, wrong = values[sense.value], False
        for key, belongs, message in (
            ("horizon_s", word == _HORIZON_OBJECTIVE, reason),
            ("scenario", word in DESIGNED_MEASURES, of_scenarios),
        ):
            if key in values and not belongs:
                place.child(key).refuse(message)
                wrong = True
        return None if wrong else Objective(sense, word, values.get("horizon_s"), values.get("scenario"))

    meaning = f"{sense.value} one number"
    if not minimised:
        return Record(meaning, keys, build, "{maximize: ki}", {"horizon_s": reason, "scenario": of_scenarios})
    keys["horizon_s"] = Key(Number("discount time T of the error integral, s", above=0), required=False)
    keys["scenario"] = Key(Text("whose measure it is; of the only scenario where left out"), required=False)
    rules = {
        "dependentSchemas": {
            "horizon_s": {"properties": {sense.value: {"const": _HORIZON_OBJECTIVE}}},
            "scenario": {"properties": {sense.value: {"enum": list(DESIGNED_MEASURES)}}},
        }
    }
    return Record(meaning, keys, build, "{minimize: iae, scenario: step}", rules=rules)

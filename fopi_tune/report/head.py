"""The head of a report:  what was asked for and of which plants, in a few lines, and where the files are."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from fopi_tune.core.controller import DERIVATIVE_NAMES, FoPi, structure_of
from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.report.documents import ResultDocuments
from fopi_tune.report.text.formatting import filter_formula, number, samples_phrase
from fopi_tune.report.words import in_words, name_and_unit
from fopi_tune.results.documents import loop_name
from fopi_tune.spec.model import ControllerSpec, DesignSpec, GainRange

#: numbers of a plant that are told one by one
_MOST = 12
_FORMULAS = {
    "lag": "P(s) = K e^(−Ls)/(τs + 1)",
    "pole": "P(s) = K e^(−Ls)/(s + p)",
}
_STRUCTURES = {
    "fopi": "C(s) = kp + ki/s^α",
    "pid": "C(s) = kp + ki/s + kd s/(Tf s + 1)",
    "fopid": "C(s) = kp + ki/s^α + kd s^μ/(Tf s + 1)",
}
_LETTERS = {"alpha": "α", "mu": "μ", "derivative_filter_time_constant_s": "Tf"}
#: a result's file -> what it is called; those that a run writes beside the page
_FILES = {
    "spec.yaml": "spec",
    "design.json": "design",
    "certificate.json": "certificate",
    "digital.json": "digital controller",
    "digital_certificate.json": "its certificate",
    "c/": "C code",
    "evidence.json": "drawn plants",
}


def head_of(documents: ResultDocuments) -> Iterator[tuple[str, str]]:
    """Plant, controller, loop and objective: a word and what is to be said about it."""
    spec = documents.spec
    yield "plant", _plant(spec)
    yield "controller", _controller(spec.controller)
    yield "loop", _loop(spec)
    if spec.scenarios:
        yield "scenarios", ", ".join(f"{each.name} ({number(each.duration_s)} s)" for each in spec.scenarios)
    yield "tool", f"fopi_tune {documents.design['stamp']['versions'].get('fopi-tune', '')}".rstrip()


def controller_words(gains: FoPi) -> str:
    """A controller as a formula with its numbers."""
    structure = structure_of(gains)
    names = {
        "fopi": ("kp", "ki", "alpha"),
        "pid": ("kp", "ki", *DERIVATIVE_NAMES),
        "fopid": ("kp", "ki", "alpha", "mu", *DERIVATIVE_NAMES),
    }[structure]
    values = ", ".join(f"{_LETTERS.get(name, name)} = {number(getattr(gains, name))}" for name in names)
    formula = _STRUCTURES[structure].removeprefix("C(s) = ")
    if gains.measurement_filter is None:
        return f"C(s) = {formula} with {values}"
    filtered = filter_formula(gains.measurement_filter)
    return f"C(s) = F(s) ({formula}) with {values} and {filtered} on the measurement"


def files_of_page(documents: ResultDocuments, certificate: bool) -> list[tuple[str, str]]:
    """The files beside the page, as address and word.

    Args:
        documents: of the page.
        certificate: whether the design has one.
    """
    there = {"spec.yaml", "design.json"} | ({"certificate.json"} if certificate else set())
    if documents.digital is not None:
        there |= {"digital.json", "c/"}
        there |= {"digital_certificate.json"} if _has_certificate(documents.digital) else set()
    there |= {"evidence.json"} if documents.evidence is not None else set()
    return [(file, word) for file, word in _FILES.items() if file in there]


def _has_certificate(document: Mapping[str, object]) -> bool:
    proof = document.get("proof")
    return isinstance(proof, Mapping) and proof.get("certificate_digest") is not None


def _plant(spec: DesignSpec) -> str:
    family = spec.plant
    if spec.is_measured:
        return "measured frequency responses"
    if isinstance(family, PlantList):
        each = (f"{member.name}: {_family(member.family)}" for member in family.members)
        return f"a list of {len(family.members)}. {'; '.join(each)}"
    return _family(family)


def _family(family: PlantFamily) -> str:
    named = {name: value for name, value in family.parameters.items() if value != Uncertain(0.0, 0.0, 0.0)}
    formula = _FORMULAS.get(family.model, family.model.replace("_", " "))
    if family.model == "transfer_function":
        formula = _nominal(family, " e^(−Ls)" if "dead_time_s" in named else "")
        named = {name: value for name, value in named.items() if not value.is_exact or name == "dead_time_s"}
    if family.model == "expressions":
        late = family.member(family.nominal_point).dead_time_s
        formula = _nominal(family, f" e^(−{number(late)} s)" if late else "")
    numbers = [f"{name_and_unit(name)[0]}{_range(value, name_and_unit(name)[1])}" for name, value in named.items()]
    shown = numbers[:_MOST] + ([f"and {len(numbers) - _MOST} more"] if len(numbers) > _MOST else [])
    return ": ".join(part for part in (formula, ", ".join(shown)) if part)


def _nominal(family: PlantFamily, late: str) -> str:
    """The nominal transfer function, with the factor of its dead time."""
    plant = family.member(family.nominal_point)
    return f"P(s) = ({_polynomial(plant.numerator)}){late}/({_polynomial(plant.denominator)}), the nominal one"


def _polynomial(values: Sequence[float]) -> str:
    """A polynomial of descending powers: "s^2 + 1.2 s + 1"."""
    terms = []
    for power, value in zip(range(len(values) - 1, -1, -1), values, strict=True):
        unit = "" if power == 0 else "s" if power == 1 else f"s^{power}"
        factor = "" if value == 1.0 and unit else number(value)
        terms += [f"{factor} {unit}".strip()] if value else []
    return " + ".join(terms).replace("+ -", "− ") or "0"


def _range(value: Uncertain, unit: str) -> str:
    if value.is_exact:
        return f" {number(value.nominal)}{unit}"
    return f" {number(value.nominal)}{unit}, anywhere in [{number(value.min)}, {number(value.max)}]"


def _controller(box: ControllerSpec) -> str:
    ranges = ", ".join(f"{in_words(name)}{_gain(gain)}" for name, gain in box.ranges.items())
    said = f"{_STRUCTURES[box.structure]} with {ranges}"
    return said if box.setpoint_weight == 1.0 else f"{said}; weight of the setpoint {number(box.setpoint_weight)}"


def _gain(gain: GainRange) -> str:
    if gain.is_fixed:
        return f" = {number(gain.min)}"
    if math.isinf(gain.min) and math.isinf(gain.max):
        return " free"
    if math.isinf(gain.max):
        return f" ≥ {number(gain.min)}"
    return f" ≤ {number(gain.max)}" if math.isinf(gain.min) else f" in [{number(gain.min)}, {number(gain.max)}]"


def _loop(spec: DesignSpec) -> str:
    digital = spec.digital
    if digital is None:
        return "in continuous time"
    said = f"a computer with samples of {number(digital.sample_time_s)} s"
    if digital.delay_samples:
        said += f", {samples_phrase(digital.delay_samples)} of computing delay"
    if digital.output_limits is not None:
        low, high = digital.output_limits
        said += f", control in [{number(low)}, {number(high)}]"
    if digital.output_rate_per_s is not None:
        said += f", at most {number(digital.output_rate_per_s)} per s"
    about = "on samples" if loop_name(spec) == "sampled" else "in continuous time"
    return f"{said}; requirements are about the loop {about}"

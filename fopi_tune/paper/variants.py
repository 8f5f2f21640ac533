"""The paper's specs and systems, which come with the package, and variants of them."""

from __future__ import annotations

from dataclasses import replace

from fopi_tune.core.plant import Plant, PlantFamily, Uncertain
from fopi_tune.paper.published import TAU_NOMINAL_S
from fopi_tune.spec.load import packaged_spec, packaged_system
from fopi_tune.spec.model import DesignSpec, GainRange, Objective, Requirement, Scope, Sense, SystemSpec

_PACKAGE = "fopi_tune.paper"


def spec(name: str) -> DesignSpec:
    """One of the shipped specs, by its name."""
    return packaged_spec(_PACKAGE, f"specs/{name}.yaml")


def manoeuvre(gain: int) -> DesignSpec:
    """The brake manoeuvre for a static gain of 1 or 10."""
    return packaged_spec(_PACKAGE, f"systems/manoeuvre_gain_{gain}.yaml")


def system(name: str) -> SystemSpec:
    """One of the shipped systems, by its name."""
    return packaged_system(_PACKAGE, f"systems/{name}.yaml")


def brake_plant(static_gain: float = 1.0, tau_s: float = TAU_NOMINAL_S, dead_time_s: float = 0.0) -> Plant:
    """static_gain e^{-Ls}/(tau s + 1)."""
    return Plant((static_gain,), (tau_s, 1.0), dead_time_s)


def with_numbers(wanted: DesignSpec, **numbers: float | Uncertain) -> DesignSpec:
    """A spec whose plant has these numbers in place of its own."""
    told = {n: v if isinstance(v, Uncertain) else Uncertain.exactly(v) for n, v in numbers.items()}
    return replace(wanted, plant=PlantFamily(wanted.plant.model, {**wanted.plant.parameters, **told}))


def with_alpha(wanted: DesignSpec, low: float, high: float) -> DesignSpec:
    """A spec that searches these orders."""
    return replace(wanted, controller=replace(wanted.controller, alpha=GainRange(low, high)))


def with_objective(wanted: DesignSpec, quantity: str) -> DesignSpec:
    """A spec that minimises something else."""
    return replace(wanted, objective=Objective(Sense.MINIMIZE, quantity))


def with_requirements(wanted: DesignSpec, *requirements: Requirement) -> DesignSpec:
    """A spec with these requirements alone and no objective."""
    return replace(wanted, requirements=requirements, objective=None)


def nominal_requirements(wanted: DesignSpec) -> tuple[Requirement, ...]:
    """The requirements about the nominal plant."""
    return tuple(each for each in wanted.requirements if each.scope is Scope.NOMINAL)

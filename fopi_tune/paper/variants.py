"""The paper's specs and systems, shipped with the package, and variants of them."""

from __future__ import annotations

from dataclasses import replace

from fopi_tune.core.plant import Plant, PlantFamily, Uncertain
from fopi_tune.paper.published import TAU_NOMINAL_S
from fopi_tune.spec.load import packaged_spec, packaged_system
from fopi_tune.spec.model import (
    ControllerSpec,
    DesignSpec,
    GainRange,
    Limit,
    Objective,
    Relation,
    Requirement,
    Scope,
    Sense,
    SystemSpec,
)

_PACKAGE = "fopi_tune.paper"


def spec(name: str) -> DesignSpec:
    """One of the shipped specs, by its name, about the loop in continuous time as in the paper."""
    shipped = packaged_spec(_PACKAGE, f"specs/{name}.yaml")
    assert shipped.digital is not None
    return replace(shipped, digital=replace(shipped.digital, design="continuous"))


def manoeuvre(gain: int) -> DesignSpec:
    """The brake manoeuvre for a static gain of 1 or 10."""
    return packaged_spec(_PACKAGE, f"systems/manoeuvre_gain_{gain}.yaml")


def system(name: str) -> SystemSpec:
    """One of the shipped systems, by its name."""
    return packaged_system(_PACKAGE, f"systems/{name}.yaml")


def brake_plant(static_gain: float = 1.0, tau_s: float = TAU_NOMINAL_S, dead_time_s: float = 0.0) -> Plant:
    """static_gain e^{-Ls}/(tau s + 1)."""
    return Plant((static_gain,), (tau_s, 1.0), dead_time_s)


def with_numbers(base: DesignSpec, **numbers: float | Uncertain) -> DesignSpec:
    """The spec with these uncertain or known numbers of its plant replaced."""
    given = {n: v if isinstance(v, Uncertain) else Uncertain.exactly(v) for n, v in numbers.items()}
    return replace(base, plant=PlantFamily(base.plant.model, {**base.plant.parameters, **given}))


def with_alpha(base: DesignSpec, low: float, high: float) -> DesignSpec:
    """The spec with another range of alpha."""
    return replace(base, controller=replace(base.controller, alpha=GainRange(low, high)))


def with_comfort(base: DesignSpec, scenario: str, most_m_s2: float) -> DesignSpec:
    """The spec with free gains that are to keep an acceleration in a scenario, and follow its reference best.

    Args:
        base: with the scenario.
        scenario: its name.
        most_m_s2: the limit.
    """
    robust = (
        Requirement("sensitivity_db", Relation.AT_MOST, (2.0,)),
        Requirement("phase_margin_deg", Relation.AT_LEAST, (60.0,)),
    )
    assert base.digital is not None
    return replace(
        base,
        controller=ControllerSpec(GainRange(0.0, 5.0), GainRange(0.0, 5.0), GainRange(0.3, 1.5)),
        requirements=robust,
        scenario_requirements=(Limit("acceleration_m_s2", Relation.AT_MOST, most_m_s2, scenario),),
        objective=Objective(Sense.MINIMIZE, "iae", scenario=scenario),
        digital=replace(base.digital, design="sampled"),
    )


def with_objective(base: DesignSpec, quantity: str) -> DesignSpec:
    """The spec with another quantity to minimise."""
    return replace(base, objective=Objective(Sense.MINIMIZE, quantity))


def with_requirements(base: DesignSpec, *requirements: Requirement) -> DesignSpec:
    """The spec with only these requirements, and no objective."""
    return replace(base, requirements=requirements, objective=None)


def nominal_requirements(base: DesignSpec) -> tuple[Requirement, ...]:
    """The requirements on the nominal plant."""
    return tuple(each for each in base.requirements if each.scope is Scope.NOMINAL)

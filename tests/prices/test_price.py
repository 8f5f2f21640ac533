"""Prices by solving again: against the solver's multipliers, closed forms and kinks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases.project import CONTINUOUS
from cases.shipped_designs import design_of

import fopi_tune as ft
from fopi_tune.prices.price import price_of
from fopi_tune.report import design_text
from fopi_tune.results.status import Price

#: relative; the exchange's rounding is 4e-4 of a price (see `fopi_tune.prices.price`), what was seen is 1.1e-4
AGREES = 5e-4
#: three uncertain numbers, or two and a third-order loop: ten seconds each
SLOW = ("lag_gain_and_delay", "second_order")


def spec_of(*requirements: str, objective: str = "", alpha: str = "{min: 0.3, max: 1.5}") -> ft.DesignSpec:
    plant = "{model: lag, static_gain: 1.0, time_constant_s: 1.0, dead_time_s: 0.2}"
    controller = f"{{kp: {{min: 0, max: 10}}, ki: {{min: 0, max: 10}}, alpha: {alpha}}}"
    lines = ["schema: 1", "name: t", f"plant: {plant}", f"controller: {controller}", "requirements:"]
    lines += [f"  - {{{requirement}}}" for requirement in requirements]
    return ft.parse_spec("\n".join([*lines, *([f"objective: {{{objective}}}"] if objective else [])]) + "\n")


def checked(spec: ft.DesignSpec) -> list[tuple[float | None, Price | None]]:
    design = ft.price(ft.tune(spec, proof=False))
    return [(report.multiplier, report.price) for report in design.requirements]


def agree(multiplier: float | None, price: Price) -> None:
    assert price.agrees
    assert not price.has_kink
    assert price.relaxed == pytest.approx(multiplier, rel=AGREES)
    assert price.tightened == pytest.approx(multiplier, rel=AGREES)


@pytest.mark.thinned(slow=["brake"])
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.long if n in SLOW else ())
        for n in sorted(p.stem for p in CONTINUOUS.glob("*.yaml"))
    ],
)
def test_solving_again_confirms_every_multiplier_of_a_shipped_spec(name: str) -> None:
    design = design_of(name, proof=False)
    priced = ft.price(design)
    found = [report for report in priced.requirements if report.price is not None]
    assert found
    for report in found:
        assert report.price is not None
        agree(report.multiplier, report.price)
    document = priced.to_dict()["requirements"]
    assert [entry["multiplier_checked"] is not None for entry in document] == [
        report.price is not None for report in priced.requirements
    ]
    assert all(entry["multiplier_checked"] is None for entry in design.to_dict()["requirements"])


@pytest.mark.thinned(slow=["depth"])
@pytest.mark.parametrize(
    "spec",
    [
        spec_of("phase_margin_deg: {at_least: 50}", "sensitivity_db: {at_most: 4}", "crossover_rad_s: {at_least: 1.0}"),
        spec_of("phase_margin_deg: {between: [50, 60]}", "sensitivity_db: {at_most: 4}", objective="maximize: ki"),
        spec_of("crossover_rad_s: {equals: 1.5}, on: nominal", objective="minimize: sensitivity_peak_db"),
        spec_of("crossover_rad_s: {at_least: 1.5}", objective="minimize: control_sensitivity_peak_db"),
    ],
    ids=["depth", "between", "equality", "control"],
)
def test_every_kind_of_objective_and_relation_has_its_price(spec: ft.DesignSpec) -> None:
    found = [(multiplier, price) for multiplier, price in checked(spec) if price is not None]
    assert found
    for multiplier, price in found:
        agree(multiplier, price)


def test_the_price_of_two_equalities_is_the_closed_forms_derivative() -> None:
    spec = spec_of(
        "crossover_rad_s: {equals: 1.5}, on: nominal",
        "phase_margin_deg: {equals: 60}, on: nominal",
        objective="maximize: ki",
        alpha="1.1",
    )

    def ki(omega: float, margin_deg: float) -> float:
        plant = np.exp(-0.2j * omega) / (1.0 + 1j * omega)
        x = np.exp(1j * (np.radians(margin_deg) - np.pi)) / plant
        return float(-x.imag * omega**1.1 / np.sin(0.55 * np.pi))

    by_omega = (ki(1.5 + 1e-5, 60.0) - ki(1.5 - 1e-5, 60.0)) / 2e-5
    by_margin = (ki(1.5, 60.0 + 1e-4) - ki(1.5, 60.0 - 1e-4)) / 2e-4
    for (_, price), slope in zip(checked(spec), (by_omega, by_margin), strict=True):
        assert price is not None
        # central differences above to 1e-9; formula (1) to h^2 J'''/3 J' with h = 2e-3
        assert price.relaxed == pytest.approx(abs(slope), rel=1e-5)
        assert price.tightened == pytest.approx(abs(slope), rel=1e-5)


def test_where_a_limit_just_begins_to_bind_the_two_prices_differ() -> None:
    # crossover and margin leave alpha alone free; past some limit of |S| it is a gain's bound that holds ki back
    throttle = ft.load_spec(CONTINUOUS / "throttle.yaml")
    loose = replace(
        throttle, requirements=(*throttle.requirements[:2], replace(throttle.requirements[2], limits=(-5.0,)))
    )
    reached = ft.tune(loose, proof=False).requirements[2].result
    assert reached is not None
    assert reached.achieved is not None
    here = replace(throttle.requirements[2], limits=(reached.achieved,))
    kink = replace(throttle, requirements=(*throttle.requirements[:2], here))
    found = ft.tune(kink, proof=False)
    assert found.gains is not None
    price = price_of(kink, found.gains, 3, 0.003)
    assert price is not None
    assert price.relaxed is not None
    assert price.tightened is not None
    # nothing is gained where the other bound holds ki back; tightening costs what the curve shows: 0.01 for a dB
    assert abs(price.relaxed) < 1e-4
    assert price.tightened > 0.005
    assert not price.agrees
    assert price.has_kink
    report = replace(found.requirements[2], multiplier=0.003, price=price)
    text = design_text(replace(found, requirements=(*found.requirements[:2], report))).plain
    assert "0.003*" in text
    assert "another requirement comes into play" in " ".join(text.split())


def test_a_wrong_multiplier_is_marked() -> None:
    spec = spec_of("sensitivity_db: {at_most: 4}", objective="maximize: ki")
    design = ft.tune(spec, proof=False)
    multiplier = design.requirements[0].multiplier
    assert multiplier is not None
    assert design.gains is not None
    right = price_of(spec, design.gains, 1, multiplier)
    wrong = price_of(spec, design.gains, 1, 1.05 * multiplier)
    assert right is not None
    assert wrong is not None
    assert (right.agrees, wrong.agrees, wrong.has_kink) == (True, False, False)
    text = design_text(replace(design, requirements=(replace(design.requirements[0], price=wrong),))).plain
    assert f"{multiplier:.3g}*" in text
    assert max(map(len, text.splitlines())) <= 80


def test_what_costs_nothing_or_is_not_solved_has_no_price() -> None:
    spec = spec_of("sensitivity_db: {at_most: 4}", "delay_margin_s: {at_least: 0.01}", objective="maximize: ki")
    assert checked(spec)[1][1] is None
    assert price_of(spec, ft.FoPi(1.0, 1.0, 1.0), 1, None) is None
    infeasible = replace(ft.tune(spec, proof=False), status=ft.Status.INFEASIBLE)
    assert ft.price(infeasible) == infeasible


@pytest.mark.thinned(slow=["delay"])
@pytest.mark.parametrize(
    "name", ["throttle", "brake_delay", pytest.param("lag_gain_and_delay", marks=pytest.mark.long)]
)
def test_the_prices_of_a_design_for_samples_agree_with_solving_again(name: str) -> None:
    spec = ft.load_spec(CONTINUOUS / f"{name}.yaml")
    assert spec.digital is not None
    design = ft.price(ft.tune(replace(spec, digital=replace(spec.digital, design="sampled")), proof=False))
    prices = [report.price for report in design.requirements if report.price is not None]
    assert prices
    assert all(price.agrees or price.has_kink for price in prices), prices
    assert any(price.agrees for price in prices)


def test_a_kink_is_two_different_prices() -> None:
    assert not Price(1.0, 2.0, 2.0, True).has_kink
    assert Price(1.0, 0.0, 2.0, False).has_kink
    assert not Price(1.0, None, 2.0, True).has_kink

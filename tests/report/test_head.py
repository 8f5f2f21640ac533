"""The head of a report: the plant, the controller and the loop as the spec has them, and the files beside the page."""

from __future__ import annotations

import re
from dataclasses import replace

from cases.plants import PUBLISHED_BRAKE
from cases.reports import BRAKE, brake_documents, run_of

from fopi_tune.core.controller import FoPid
from fopi_tune.report.documents import documents_of_run
from fopi_tune.report.head import controller_words, files_of_page, head_of
from fopi_tune.spec import parse_spec


def test_the_head_says_plant_box_and_loop() -> None:
    said = dict(head_of(brake_documents()))
    assert said["plant"].startswith(
        "P(s) = K e^(−Ls)/(τs + 1): static gain 1, time constant 2.25\N{NO-BREAK SPACE}s, anywh"
    )
    assert "[1.6, 3.1]" in said["plant"]
    assert "dead time" not in said["plant"]
    assert said["controller"] == "C(s) = kp + ki/s^α with kp in [0, 10], ki in [0, 10], α in [0.3, 1.5]"
    assert said["loop"].startswith("a computer with samples of 0.2 s")
    assert said["tool"] == f"fopi_tune {brake_documents().design['stamp']['versions']['fopi-tune']}"


def test_a_transfer_function_is_told_by_its_polynomials_and_its_ranges() -> None:
    plant = "{model: transfer_function, numerator: [1, -2], denominator: [1, {nominal: 1.2, min: 0.9, max: 1.5}, 0]}"
    text = re.sub(r"plant:\n(?:  .*\n)+", f"plant: {plant}\n", BRAKE)
    said = dict(head_of(replace(brake_documents(), spec=parse_spec(text))))["plant"]
    assert said == "P(s) = (s − 2)/(s^2 + 1.2 s), the nominal one: denominator[1] 1.2, anywhere in [0.9, 1.5]"


def test_a_plant_of_expressions_is_told_by_its_nominal_polynomials_and_its_own_numbers() -> None:
    parameters = "{K: {nominal: 1.5, min: 1, max: 2}, w: 3}"
    shape = "numerator: [K*w**2], denominator: [1, w, w**2], dead_time_s: 0.1"
    plant = f"{{model: transfer_function, parameters: {parameters}, {shape}}}"
    text = re.sub(r"plant:\n(?:  .*\n)+", f"plant: {plant}\n", BRAKE)
    said = dict(head_of(replace(brake_documents(), spec=parse_spec(text))))["plant"]
    assert said == "P(s) = (13.5) e^(−0.1 s)/(s^2 + 3 s + 9), the nominal one: K 1.5, anywhere in [1, 2], w 3"


def test_links_are_to_the_files_that_a_run_writes() -> None:
    without = documents_of_run(run_of(BRAKE.replace("digital:", "# digital:").replace("validation:", "# validation:")))
    assert [file for file, _ in files_of_page(without, certificate=False)] == ["spec.yaml", "design.json"]
    named = [file for file, _ in files_of_page(brake_documents(), certificate=True)]
    assert named[:3] == ["spec.yaml", "design.json", "certificate.json"]
    assert {"digital.json", "c/"} <= set(named)


def test_a_controller_is_its_formula_with_its_numbers() -> None:
    assert controller_words(PUBLISHED_BRAKE).startswith("C(s) = kp + ki/s^α with kp = ")
    said = controller_words(FoPid(1.0, 2.0, 0.9, kd=0.5, mu=0.7, derivative_filter_time_constant_s=0.01))
    assert said == "C(s) = kp + ki/s^α + kd s^μ/(Tf s + 1) with kp = 1, ki = 2, α = 0.9, μ = 0.7, kd = 0.5, Tf = 0.01"

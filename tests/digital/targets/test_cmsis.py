"""The arrays for CMSIS-DSP: the library's own cascade runs them within the stated error."""

from __future__ import annotations

import re

import numpy as np
import pytest
from cases.targets import exported

from fopi_tune.digital.realise import Form, Precision, run_parallel, run_second_order
from fopi_tune.digital.targets import Target, export_target
from fopi_tune.errors import DomainError


def header(structure: str = "fopi") -> str:
    text = export_target(exported(structure), Target.CMSIS)["Brake-1.2_cmsis.h"]
    assert isinstance(text, str)
    return text


def array_of(text: str, name: str) -> list[float]:
    found = re.search(rf"{name}\[(\d+)\] = {{(.*?)}};", text, re.DOTALL)
    assert found is not None
    numbers = [float.fromhex(word.strip().rstrip("f")) for word in found.group(2).split(",") if word.strip()]
    assert len(numbers) == int(found.group(1))
    return numbers


@pytest.mark.parametrize(("precision", "suffix"), [(Precision.FLOAT32, "f32"), (Precision.FLOAT64, "f64")])
def test_the_library_runs_the_arrays_within_the_stated_error(precision: Precision, suffix: str) -> None:
    dsp = pytest.importorskip("cmsisdsp", reason="no cmsisdsp: the arrays are not run by CMSIS-DSP")
    controller, numbers = exported("fopi").controller, array_of(header(), f"fopi_brake_1_2_cmsis_{suffix}")
    (made,) = [r for r in controller.realisations if r.form is Form.CMSIS and r.precision is precision]
    stages = len(numbers) // 5
    filter_ = getattr(dsp, f"arm_biquad_cascade_df2T_instance_{suffix}")()
    rounded, state = np.array(numbers, dtype=precision.dtype), np.zeros(2 * stages, dtype=precision.dtype)
    getattr(dsp, f"arm_biquad_cascade_df2T_init_{suffix}")(filter_, stages, rounded, state)
    inputs = 1.0 + 0.1 * np.random.default_rng(3).standard_normal(2000)
    outputs = getattr(dsp, f"arm_biquad_cascade_df2T_{suffix}")(filter_, inputs.astype(precision.dtype))
    expected = run_parallel(controller.sections, inputs, Precision.FLOAT64)
    # another input than the one that was measured: three times its error
    assert np.abs(outputs - expected).max() / np.abs(expected).max() < 3.0 * made.error


def test_the_arrays_are_those_of_the_stored_controller() -> None:
    for made in exported("fopi").controller.realisations:
        if made.form is Form.CMSIS:
            suffix = "f32" if made.precision is Precision.FLOAT32 else "f64"
            numbers = array_of(header(), f"fopi_brake_1_2_cmsis_{suffix}")
            assert numbers == [number for row in made.coefficients for number in row]


def test_a_weight_or_a_measurement_filter_is_refused() -> None:
    for structure in ("all", "weighted"):
        with pytest.raises(DomainError, match="a filter of r - y alone"):
            export_target(exported(structure), Target.CMSIS)


def test_a_derivative_of_the_setpoint_is_told() -> None:
    assert "The derivative acts on r - y here" in header("derivative_alone")
    assert "derivative" not in header()


@pytest.mark.parametrize("structure", ["fopi", "least_order", "negative", "tiny", "huge", "derivative_alone"])
def test_the_stated_error_is_that_of_the_input_that_is_named(structure: str) -> None:
    # the input of the header's words, drawn again: largest errors of two draws differ by less than five times
    inputs = 0.3 + np.random.default_rng(1).normal(size=2000)
    controller = exported(structure).controller
    reference = run_parallel(controller.sections, inputs, Precision.FLOAT64)
    for made in controller.realisations:
        if made.form is Form.CMSIS:
            table = np.array(made.coefficients)
            rows = np.column_stack([table[:, :3], np.ones(len(table)), -table[:, 3:]])
            outputs = run_second_order(rows, inputs, made.precision)
            found = np.abs(outputs - reference).max() / np.abs(reference).max()
            assert 0.2 * made.error < found < 5.0 * made.error
    assert "2000 samples of a\n   step of 0.3 with noise of standard deviation 1" in header(structure)

"""Curves of a designed loop: those of formulas of this test, on given axes, refused where there are none."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import fopi_tune as ft

PI = {
    "name": "pi",
    "plant": {"model": "lag", "static_gain": 1.0, "time_constant_s": {"nominal": 2.0, "min": 1.6, "max": 3.1}},
    "controller": {"kp": 0.5, "ki": 0.3, "alpha": 0.9},
    "requirements": [{"phase_margin_deg": {"at_least": 60}}],
}
DIGITAL = {"sample_time_s": 0.2, "design": "sampled"}


def test_the_response_is_that_of_the_formula() -> None:
    design = ft.tune(PI, proof=False)
    omega = np.array([0.01, 0.3, 4.0])
    found = design.bode(omega)
    for row, lag in enumerate((2.0, 1.6, 3.1)):
        expected = (0.5 + 0.3 / (1j * omega) ** 0.9) / (lag * 1j * omega + 1.0)
        np.testing.assert_allclose(found.loop[row], expected, rtol=1e-12)
        np.testing.assert_allclose(found.magnitude_db[row], 20.0 * np.log10(np.abs(expected)), rtol=1e-12)
        np.testing.assert_allclose(found.phase_deg[row], np.degrees(np.angle(expected)), rtol=1e-12)
    assert design.controller is not None
    np.testing.assert_allclose(design.controller(1j * omega), 0.5 + 0.3 / (1j * omega) ** 0.9, rtol=1e-12)
    assert design.nyquist(omega).tobytes() == found.loop.tobytes()


def test_on_samples_the_loop_is_the_filters_with_the_hold() -> None:
    design = ft.tune({**PI, "digital": DIGITAL}, proof=False)
    sections = ft.discretize(design.spec, design.gains or ft.FoPi(1, 1, 1)).controller.sections
    omega = np.array([0.05, 0.9])
    z = np.exp(1j * omega * 0.2)
    controller = sections.direct + sum(r / (z - p) for p, r in zip(sections.poles, sections.residues, strict=True))
    pole = np.exp(-0.2 / 2.0)
    np.testing.assert_allclose(design.bode(omega).loop[0], controller * (1.0 - pole) / (z - pole), rtol=1e-9)
    assert design.bode().omega_rad_s[-1] < np.pi / 0.2
    with pytest.raises(ft.DomainError, match=r"between 0 and 15\.708 rad/s"):
        design.bode(np.array([16.0]))


def test_the_step_is_the_simulation() -> None:
    design = ft.tune({**PI, "digital": DIGITAL}, proof=False)
    found = design.step()
    assert design.gains is not None
    driven = ft.simulate(design.spec, design.gains).driven[0]
    np.testing.assert_array_equal(found.output[0], driven.traces.output[0])
    np.testing.assert_array_equal(found.control[0], driven.traces.applied[0])
    assert found.output.shape == (3, len(found.time_s))


def test_figures_are_drawn_on_given_axes_and_on_new_ones() -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("Agg")
    design = ft.tune({**PI, "digital": DIGITAL}, proof=False)
    _, axes = pyplot.subplots(2)
    assert design.plot_bode(tuple(axes)) == tuple(axes)
    assert len(axes[0].lines) == len(axes[1].lines) == 3
    # the point -1 beside the loops; the reference beside the outputs
    assert len(design.plot_nyquist().lines) == 4
    above, below = design.plot_step()
    assert (len(above.lines), len(below.lines)) == (4, 3)
    pyplot.close("all")


def test_what_has_no_curves_is_refused() -> None:
    design = ft.tune(PI, proof=False)
    with pytest.raises(ft.DomainError, match="pi has no gains, and no loop to look at"):
        dataclasses.replace(design, gains=None).bode()
    listed = {key: value for key, value in PI.items() if key != "plant"}
    design = ft.tune({**listed, "plants": [PI["plant"], {**PI["plant"], "static_gain": 1.2}]}, proof=False)
    with pytest.raises(ft.DomainError, match="curves are of one family"):
        design.bode()
    with pytest.raises(ft.DomainError, match="has no section digital"):
        ft.tune(PI, proof=False).step()

"""A controller's numbers and their derivatives by the gains: against differences of the controller that runs."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.digital.derivatives import ControllerDerivatives, controller_derivatives
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import DomainError
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

TEXT = """
schema: 1
name: derivatives
plant:
  {{model: lag, static_gain: 1.0, time_constant_s: {{min: 1.6, max: 3.1, nominal: 2.3}}, dead_time_s: 0.1}}
controller: {controller}
requirements: [{{phase_margin_deg: {{at_least: 60}}}}]
digital: {{sample_time_s: 0.2, {digital}}}
"""
FREE = "{kp: {min: -9, max: 9}, ki: {min: -9, max: 9}, alpha: {min: 0.1, max: 1.9}}"
FILTERS = {
    "oustaloup": "poles: 7",
    "wide": "poles: 9, band_rad_s: [1.0e-5, 1.0e+4]",
    "narrow": "poles: 12, band_rad_s: [0.01, 8]",
    "one pole": "poles: 1",
    "modified": "poles: 6, method: modified_oustaloup",
    "matched": "poles: 7, rule: matched",
    "matched, modified": "poles: 5, method: modified_oustaloup, rule: matched",
    "prewarped": "poles: 7, prewarp: crossover",
    "prewarped, modified": "poles: 5, prewarp: crossover, method: modified_oustaloup",
}
#: weights of both signs, of one sign, of the sizes of residues; a gain of the anti-windup of 1, and below
GAINS = [
    (0.33, 0.31, 0.96),
    (0.33, 0.31, 1.0),
    (2.0, 0.1, 1.0),
    (0.33, 0.31, 1.000001),
    (0.33, 0.31, 0.999999),
    (0.3, 0.4, 0.5),
    (0.3, 0.4, 1.3),
    (2.0, 0.2, 1.75),
    (-0.2, 0.4, 0.7),
    (-2.0, -0.4, 1.1),
    (0.0, 0.5, 0.9),
    (0.0, -0.5, 1.0),
]
#: central difference of order 8
OFFSETS = np.array([-4, -3, -2, -1, 1, 2, 3, 4])
SHARES = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
STEP = 2e-3
#: of the largest derivative of one kind; rounding of numbers of size 1 over the step: 2e-16/2e-3, and some more in the
#: weights, which are quotients of differences
DIFFERENCE = 2e-9


def spec_of(digital: str, controller: str = FREE) -> DesignSpec:
    return parse_spec(TEXT.format(digital=digital, controller=controller))


def runtime_of(spec: DesignSpec, gains: FoPi) -> Runtime:
    return Runtime.of(implementation_of(spec, gains).sections, Precision.FLOAT64, None)


def numbers(spec: DesignSpec, gains: FoPi) -> list[np.ndarray]:
    """Direct, gain of the anti-windup, poles, weights, residues."""
    found = runtime_of(spec, gains)
    return [
        np.array(part) for part in ([found.direct], [found.tracking_gain], found.poles, found.weights, found.residues)
    ]


def parts(found: ControllerDerivatives) -> list[np.ndarray]:
    return [found.direct[None], found.tracking_gain[None], found.poles, found.weights, found.residues]


def moved(gains: FoPi, column: int, by: float) -> FoPi:
    name = ("kp", "ki", "alpha")[column]
    return dataclasses.replace(gains, **{name: getattr(gains, name) + by})


def differences(spec: DesignSpec, gains: FoPi, column: int) -> list[np.ndarray]:
    each = [numbers(spec, moved(gains, column, STEP * offset)) for offset in OFFSETS]
    return [np.tensordot(SHARES, np.array(values), axes=1) / STEP for values in zip(*each, strict=True)]


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", FILTERS)
def test_derivatives_are_the_differences_of_the_controller_that_runs(name: str) -> None:
    spec = spec_of(FILTERS[name])
    for gains in (FoPi(*values) for values in GAINS):
        found = parts(controller_derivatives(spec, gains))
        for column in range(3):
            for part, expected in zip(found, differences(spec, gains, column), strict=True):
                scale = max(np.abs(part).max(), 1e-3)
                # at alpha = 1 only the integrator is there to take a difference of; the next test is about the others
                part = part[: len(expected)]
                np.testing.assert_allclose(
                    part[:, 1 + column], expected, rtol=0.0, atol=DIFFERENCE * scale, err_msg=f"{gains} {column}"
                )


def test_weights_from_the_sizes_of_residues() -> None:
    # poles so close to 1 that weights of both signs do not count as stable
    spec = spec_of("poles: 6, band_rad_s: [1.5e-9, 4.0e-7]")
    for gains, at_most in ((FoPi(-0.05, 0.5, 1.1), 1.0), (FoPi(5.0, 0.05, 1.1), 0.999)):
        runs, found = runtime_of(spec, gains), controller_derivatives(spec, gains)
        shares = np.where(np.array(runs.poles) > 0.0, runs.residues, 0.0)
        assert np.abs(shares / shares.sum() - runs.weights).max() > 0.1
        assert 0.01 < runs.tracking_gain <= at_most
        for column in range(3):
            for part, expected in zip(parts(found), differences(spec, gains, column), strict=True):
                scale = max(np.abs(part).max(), np.abs(expected).max(), 1e-3)
                np.testing.assert_allclose(part[:, 1 + column], expected, rtol=0.0, atol=1e-8 * scale)


@pytest.mark.parametrize("name", FILTERS)
def test_the_values_are_those_of_the_controller_that_runs(name: str) -> None:
    spec = spec_of(f"{FILTERS[name]}, output_limits: [-1, 2]")
    for gains in (FoPi(*values) for values in GAINS):
        found, runs = controller_derivatives(spec, gains), runtime_of(spec, gains)
        assert found.controller == dataclasses.replace(runs, limits=(-1.0, 2.0))
        count = len(runs.poles)
        for part, values in zip(parts(found)[2:], (runs.poles, runs.weights, runs.residues), strict=True):
            assert tuple(part[:count, 0]) == values
        # sections that are not there have no effect
        assert not np.any([found.residues[count:, 0], found.weights[count:, 0]])
        assert (found.direct[0], found.tracking_gain[0]) == (runs.direct, runs.tracking_gain)


def test_sections_that_vanish_at_alpha_1_are_there_with_the_poles_of_its_neighbours() -> None:
    for name in ("oustaloup", "modified", "matched"):
        spec = spec_of(FILTERS[name])
        found = controller_derivatives(spec, FoPi(0.3, 0.2, 1.0))
        near = runtime_of(spec, FoPi(0.3, 0.2, np.nextafter(1.0, 2.0)))
        np.testing.assert_allclose(found.poles[:, 0], near.poles, rtol=1e-14)
        assert np.abs(found.residues[1:, 3]).min() > 0.0


def test_without_an_integral_its_derivative_is_the_filter_of_ki_1() -> None:
    for name in ("oustaloup", "prewarped", "matched"):
        spec = spec_of(FILTERS[name])
        found = controller_derivatives(spec, FoPi(1.4, 0.0, 0.8))
        assert found.controller.poles == ()
        # one-sided: the gain of the anti-windup goes with |ki|
        small = 1e-9
        near = runtime_of(spec, FoPi(1.4, small, 0.8))
        np.testing.assert_allclose(found.poles[:, 0], near.poles, rtol=1e-8)
        np.testing.assert_allclose(found.residues[:, 2], np.array(near.residues) / small, rtol=1e-7)
        np.testing.assert_allclose(found.direct[2], (near.direct - 1.4) / small, rtol=1e-6)
        np.testing.assert_allclose(found.weights[:, 0], near.weights, rtol=1e-7)
        np.testing.assert_allclose(found.tracking_gain[2], near.tracking_gain / small, rtol=1e-7)
        assert not found.residues[:, [0, 1, 3]].any()
        assert found.tracking_gain[0] == 0.0


def test_the_side_of_ki_0_is_the_inside_of_its_range() -> None:
    negative = "{kp: {min: -9, max: 0}, ki: {min: -9, max: 0}, alpha: {min: 0.3, max: 1.5}}"
    above, below = (
        controller_derivatives(spec_of("poles: 5", box), FoPi(-0.4, 0.0, 1.2)).tracking_gain[2]
        for box in (FREE, negative)
    )
    assert above > 0.0
    assert below == -above
    # no controller at all: nothing to take the output back to
    assert controller_derivatives(spec_of("poles: 5"), FoPi(0.0, 0.0, 1.2)).tracking_gain.tolist() == [0.0] * 4


def test_a_fit_has_derivatives_for_a_fixed_alpha_only() -> None:
    with pytest.raises(DomainError, match=r"fit has no derivative by alpha, .* alpha, or take method: oustaloup"):
        controller_derivatives(spec_of("method: fit, poles: 4"), FoPi(0.3, 0.2, 0.8))
    fixed = spec_of("method: fit, poles: 4", FREE.replace("{min: 0.1, max: 1.9}", "0.8"))
    gains = FoPi(0.3, 0.2, 0.8)
    found = controller_derivatives(fixed, gains)
    for column in range(2):
        for part, expected in zip(parts(found), differences(fixed, gains, column), strict=True):
            np.testing.assert_allclose(part[:, 1 + column], expected, rtol=0.0, atol=1e-9 * np.abs(part).max())
    assert not any(part[:, 3].any() for part in parts(found))


def test_an_approximation_that_fixed_gains_do_not_need_is_not_asked_for() -> None:
    # the neighbours of alpha = 1 cannot be made: this filter needs two poles
    digital = "method: modified_oustaloup, poles: 1"
    with pytest.raises(DomainError, match="at least 2 poles"):
        controller_derivatives(spec_of(digital), FoPi(0.3, 0.2, 1.0))
    found = controller_derivatives(spec_of(digital, FREE.replace("{min: 0.1, max: 1.9}", "1")), FoPi(0.3, 0.2, 1.0))
    np.testing.assert_allclose(found.residues, [[0.04, 0.0, 0.2, 0.0]], rtol=1e-14)
    np.testing.assert_allclose(found.direct, [0.32, 1.0, 0.1, 0.0], rtol=1e-14)
    matched = "rule: matched, poles: 4, band_rad_s: [1.0e-3, 1.0e+9]"
    with pytest.raises(DomainError, match="poles fall together"):
        controller_derivatives(spec_of(matched), FoPi(0.3, 0.2, 1.0))
    proportional = spec_of(matched, FREE.replace("ki: {min: -9, max: 9}", "ki: 0"))
    assert controller_derivatives(proportional, FoPi(0.3, 0.0, 0.8)).direct.tolist()[:2] == [0.3, 1.0]


def test_a_crossover_without_a_derivative_is_refused() -> None:
    # |L| of a proportional controller on a resonance touches 1 from below
    text = TEXT.format(digital="rule: matched", controller=FREE).replace(
        "{model: lag, static_gain: 1.0, time_constant_s: {min: 1.6, max: 3.1, nominal: 2.3}, dead_time_s: 0.1}",
        "{model: transfer_function, numerator: [1.0], denominator: [1.0, 1.0, 1.0], dead_time_s: 0.1}",
    )
    spec = parse_spec(text)
    # |P| is largest, 2/sqrt(3), at omega^2 = 1/2: just above that gain L crosses 1 twice, just below never
    touching, refused = 0.5 * np.sqrt(3.0), 0
    for steps in range(-40, 41):
        try:
            found = controller_derivatives(spec, FoPi(touching * (1.0 + steps * 2.0**-52), 0.0, 0.8))
            assert np.isfinite(found.direct).all()
        except DomainError as problem:
            refused += "only touches 1 at 0.7071 rad/s" in str(problem)
    assert refused

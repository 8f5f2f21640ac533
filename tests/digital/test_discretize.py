"""Digital controllers: approximations of s^-alpha, sampling rules, the fit, and the rounding error of each form."""

from __future__ import annotations

import numpy as np
import pytest
from cases.project import ROOT
from scipy import signal

import fopi_tune as ft
from fopi_tune.core.controller import FoPi, Pid
from fopi_tune.core.parallel_form import Sections
from fopi_tune.digital import discretize
from fopi_tune.digital.discretize import APPROXIMATIONS, Method
from fopi_tune.digital.fit import fit
from fopi_tune.digital.oustaloup import modified_oustaloup, oustaloup
from fopi_tune.digital.realise import (
    Form,
    Precision,
    checked_realisation,
    realise,
    second_order_sections,
    zeros_poles_gain,
)
from fopi_tune.digital.transforms import matched, tustin
from fopi_tune.errors import DomainError
from fopi_tune.report.text.digital import digital_text
from fopi_tune.spec import parse_spec
from fopi_tune.spec.digital import METHODS
from fopi_tune.spec.model import DigitalSpec

BAND, TS = (1e-3, 1e3), 0.2
ALPHAS = [0.05, 0.3, 0.45, 0.55, 0.8, 1.0, 1.2, 1.5, 1.95]
#: where the fit is checked: from 10^-2.5 rad/s to 0.3 of Nyquist's frequency
JUDGED = np.geomspace(10**-2.5, 0.3 * np.pi / TS, 1500)


def error(sections: Sections, alpha: float, omega: np.ndarray) -> float:
    """Largest relative error of an approximation of s^-alpha."""
    return float(np.abs(sections.response(omega) * (1j * omega) ** alpha - 1.0).max())


# -- continuous approximations --------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [oustaloup, modified_oustaloup])
@pytest.mark.parametrize("alpha", ALPHAS)
def test_an_approximation_is_stable_integrates_and_is_exact_in_gain_mid_band(make, alpha: float) -> None:
    found = make(alpha, 7, BAND)
    assert sorted(found.poles)[-1] == 0.0
    assert sum(pole == 0.0 for pole in found.poles) == 1
    assert all(pole < 0.0 for pole in found.poles if pole != 0.0)
    assert all(zero < 0.0 for zero in found.zeros)  # none at the origin: the integrator is not cancelled
    assert len(found.poles) == (1 if alpha == 1.0 else 8)
    assert abs(found.response(np.array([1.0]))[0]) == pytest.approx(1.0, rel=1e-12)  # 1 rad/s is the middle
    # the DC gain is infinite: like 1/omega below the band
    low = np.abs(found.response(np.array([1e-9, 1e-10])))
    assert low[1] / low[0] == pytest.approx(10.0, rel=1e-6)


@pytest.mark.parametrize("alpha", [0.3, 0.55, 0.8, 1.2, 1.5])
def test_more_poles_in_a_wide_band_approach_the_ideal_integral(alpha: float) -> None:
    omega = np.geomspace(1e-1, 1e1, 200)
    ideal = (1j * omega) ** -alpha
    # a wide band, so that its ends do not limit what its middle can do
    errors = [np.abs(oustaloup(alpha, n, (1e-6, 1e6)).response(omega) / ideal - 1.0).max() for n in (8, 14, 36)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 2e-3  # three poles a decade


def test_residues_rebuild_the_filter() -> None:
    found = oustaloup(0.55, 9, BAND)
    omega = np.geomspace(1e-4, 1e4, 100)
    rebuilt = (found.residues / (1j * omega[:, None] - np.array(found.poles))).sum(axis=1)
    assert np.abs(rebuilt / found.response(omega) - 1.0).max() < 1e-11  # rounding of nine residues


def test_the_modified_filter_as_printed_has_the_three_faults_that_are_mended() -> None:
    """PAPER.md: a gain bias mid-band, a zero at s = 0, and for negative orders an unstable pole."""
    b, d, high = 10.0, 9.0, BAND[1]
    for beta in (0.55, -0.3):
        top, bottom = np.roots([d, b * high, 0.0]), np.roots([d * (1 - beta), b * high, d * beta])
        assert 0.0 in top
        assert bool(bottom.max() > 0.0) is (beta < 0.0)
    # -0.50 dB at order 0.55 is the bias (d/b)^beta
    assert 20 * 0.55 * np.log10(d / b) == pytest.approx(-0.5033, abs=1e-4)


# -- sampling -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("alpha", ALPHAS)
def test_tustin_is_scipys_bilinear_transformation(alpha: float) -> None:
    gains, integral = FoPi(0.4, 0.3, alpha), oustaloup(alpha, 7, BAND)
    sections = tustin(gains, integral, TS)
    z, p, k = signal.bilinear_zpk(np.array(integral.zeros), np.array(integral.poles), integral.gain, 1.0 / TS)
    omega = np.geomspace(1e-3, 0.99 * np.pi / TS, 200)
    points = np.exp(1j * omega * TS)[:, None]
    expected = k * np.prod(points - z, axis=1) / np.prod(points - p, axis=1)
    assert np.abs(sections.response(omega) / (0.4 + 0.3 * expected) - 1.0).max() < 1e-8  # products of 8 factors near 1
    assert sections.poles[0] == 1.0
    assert all(abs(pole) < 1.0 for pole in sections.poles[1:])


def test_prewarping_makes_one_frequency_exact() -> None:
    gains, integral = FoPi(0.0, 1.0, 0.55), oustaloup(0.55, 7, BAND)
    at = np.array([4.0])
    plain, warped = tustin(gains, integral, TS), tustin(gains, integral, TS, 4.0)
    assert abs(warped.response(at)[0] / integral.response(at)[0] - 1.0) < 1e-12
    assert abs(plain.response(at)[0] / integral.response(at)[0] - 1.0) > 1e-2
    with pytest.raises(DomainError, match="Nyquist"):
        tustin(gains, integral, TS, 16.0)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_matched_poles_are_exponentials_and_the_gain_is_kept(alpha: float) -> None:
    gains, integral = FoPi(0.0, 1.0, alpha), oustaloup(alpha, 5, (1e-2, 1e1))
    sections = matched(gains, integral, TS, 0.3)
    assert np.array(sections.poles) == pytest.approx(np.exp(np.array(integral.poles) * TS), rel=1e-15)
    at = np.array([0.3])
    assert abs(sections.response(at)[0]) == pytest.approx(abs(integral.response(at)[0]), rel=1e-12)


def test_without_an_integral_only_the_direct_path_is_left() -> None:
    for method in ("oustaloup", "modified_oustaloup", "fit"):
        made = discretize(FoPi(0.7, 0.0, 0.5), DigitalSpec(TS, method))
        assert (made.sections.direct, made.sections.poles) == (0.7, ())


# -- the fit --------------------------------------------------------------------------------------------------------


@pytest.mark.thinned(6)
@pytest.mark.parametrize("alpha", [0.3, 0.45, 0.55, 0.8, 1.2])
def test_the_fit_is_five_times_better_than_oustaloup_and_tustin(alpha: float) -> None:
    gains = FoPi(0.0, 1.0, alpha)
    sections = fit(gains, TS, 7, (10**-2.5, 1e3))
    usual = error(tustin(gains, oustaloup(alpha, 7, BAND), TS), alpha, JUDGED)
    found = error(sections, alpha, JUDGED)
    assert found <= 0.012
    assert found <= usual / 5.0
    assert sections.poles[0] == 1.0
    assert all(0.0 <= pole < 1.0 for pole in sections.poles[1:])
    # no wild gain where no fit is possible
    beyond = np.linspace(0.3 * np.pi / TS, np.pi / TS, 100)
    assert error(sections, alpha, beyond) < 4.0


def test_oustaloup_and_tustin_err_as_published() -> None:
    gains = FoPi(0.0, 1.0, 0.55)
    assert error(tustin(gains, oustaloup(0.55, 7, BAND), TS), 0.55, JUDGED) == pytest.approx(0.115, abs=5e-4)


@pytest.mark.parametrize("gains", [FoPi(0.0, 0.0, 0.5), Pid(0.0, 0.0, 0.0, 1.0)])
def test_gains_that_are_all_0_are_no_controller(gains: FoPi) -> None:
    with pytest.raises(DomainError, match="all gains are 0: there is no controller, so there is no loop; give one"):
        discretize(gains, DigitalSpec(0.1))
    with pytest.raises(DomainError, match="brake: all gains are 0, and code of a mode is that of its controller"):
        ft.discretize_system(ROOT / "systems" / "car.yaml", {"throttle": FoPi(0.1, 0.1, 0.8), "brake": gains})


@pytest.mark.thinned(6)
@pytest.mark.parametrize("alpha", [0.05, 0.95, 1.6, 1.9])
def test_the_fit_takes_any_order(alpha: float) -> None:
    sections = fit(FoPi(0.0, 1.0, alpha), TS, 7, (10**-2.5, 1e3))
    assert error(sections, alpha, JUDGED) < 0.02


def test_the_fit_of_an_ordinary_integral_is_exact() -> None:
    sections = fit(FoPi(0.2, 0.5, 1.0), TS, 7, BAND)
    assert sections == Sections(TS, 0.2 + 0.5 * TS / 2, (1.0,), (0.5 * TS,))


def test_a_band_above_the_fits_end_is_refused() -> None:
    with pytest.raises(DomainError, match="band begins"):
        fit(FoPi(0.0, 1.0, 0.5), TS, 7, (10.0, 1e3))


# -- forms and precisions -------------------------------------------------------------------------------------------


def designs(count: int) -> list[Sections]:
    rng = np.random.default_rng(3)
    made = []
    for _ in range(count):
        kp, ki = (10 ** rng.uniform(-1.5, 0.5, 2)).tolist()
        gains = FoPi(kp, ki, float(rng.uniform(0.2, 1.5)))
        made.append(tustin(gains, oustaloup(gains.alpha, int(rng.integers(3, 10)), BAND), TS))
    return made


def test_float32_keeps_the_parallel_form_and_spoils_the_cascade() -> None:
    inputs = 0.3 + np.random.default_rng(4).normal(size=600)
    parallel, cascade = [], []
    for sections in designs(200):
        parallel.append(realise(sections, Form.PARALLEL, Precision.FLOAT32, inputs).error)
        if len(cascade) < 40:
            cascade.append(realise(sections, Form.SECOND_ORDER, Precision.FLOAT32, inputs).error)
    assert np.median(parallel) <= 5e-6
    assert max(parallel) <= 5e-5
    assert np.median(cascade) > 50 * np.median(parallel)


def test_every_form_computes_the_same_filter_in_float64() -> None:
    inputs = np.random.default_rng(5).normal(size=500)
    for sections in designs(10):
        table = second_order_sections(sections)
        found = realise(sections, Form.SECOND_ORDER, Precision.FLOAT64, inputs)
        assert found.stable
        assert found.error < 1e-7  # a cascade of poles near 1
        # SciPy's own filters agree with the run sample by sample
        parallel = sections.direct * inputs
        for pole, residue in zip(sections.poles, sections.residues, strict=True):
            parallel = parallel + np.asarray(signal.lfilter([0.0, residue], [1.0, -pole], inputs), dtype=float)
        scipys = np.asarray(signal.sosfilt(table, inputs), dtype=float)
        assert np.abs(scipys - parallel).max() < 1e-7 * np.abs(parallel).max()
        cmsis = np.array(realise(sections, Form.CMSIS, Precision.FLOAT64, inputs).coefficients)
        assert cmsis == pytest.approx(np.hstack([table[:, :3], -table[:, 4:]]))


def test_zeros_come_from_the_sections_without_a_polynomial() -> None:
    sections = designs(1)[0]
    zeros, poles, gain = zeros_poles_gain(sections)
    omega = np.geomspace(1e-2, 10, 50)
    z = np.exp(1j * omega * TS)[:, None]
    rebuilt = gain * np.prod(z - zeros, axis=1) / np.prod(z - poles, axis=1)
    assert np.abs(rebuilt / sections.response(omega) - 1.0).max() < 1e-9


def test_a_controller_without_a_direct_path_has_every_form() -> None:
    sections = Sections(TS, 0.0, (1.0, 0.5, 0.1), (0.1, 0.2, -0.05))
    inputs = np.random.default_rng(6).normal(size=200)
    for form in Form:
        # 1e-12: three sections in double precision
        assert realise(sections, form, Precision.FLOAT64, inputs).error < 1e-12


def test_a_form_whose_pole_leaves_the_unit_circle_is_refused() -> None:
    # 1 - 1e-9 rounds to 1 in float32
    sections = Sections(TS, 1.0, (1.0, 1.0 - 1e-9), (0.1, 0.1))
    spoiled = realise(sections, Form.PARALLEL, Precision.FLOAT32, np.ones(50))
    assert not spoiled.stable
    with pytest.raises(DomainError, match="outside the unit circle"):
        checked_realisation(spoiled, 1.0)
    cascade = realise(designs(1)[0], Form.SECOND_ORDER, Precision.FLOAT32, np.ones(50))
    with pytest.raises(DomainError, match="errs by"):
        checked_realisation(cascade, 1e-12)


def test_the_papers_printed_filters_are_unstable_and_ours_are_not() -> None:
    """PAPER.md: four digits of a seventh-order direct form put poles at 1.0487 and 1.0151; sections do not."""
    for gains in (FoPi(0.09, 0.025, 0.8), FoPi(0.07, 0.11, 0.45)):
        made = discretize(gains, DigitalSpec(TS, "modified_oustaloup", 7))
        assert len(made.sections.poles) == 8
        assert made.sections.poles[0] == 1.0
        assert max(abs(pole) for pole in made.sections.poles[1:]) < 1.0


def test_the_printed_coefficients_are_filters_with_poles_outside_the_unit_circle() -> None:
    """The paper's R_dT and R_dB as they are printed, 1 + sum a_k z^-k: one pole at 1.0487, two at 1.0151 and -1.001."""
    throttle = [1.0, -0.8662, -2.746, 2.339, 2.507, -2.095, -0.7602, 0.6211]
    brake = [1.0, -0.54, -2.88062, 1.5053, 2.7658, -1.3952, -0.8852, 0.4299]
    poles = [np.roots(denominator) for denominator in (throttle, brake)]
    assert np.sort(np.abs(poles[0]))[-1] == pytest.approx(1.0487, abs=5e-5)
    outside = np.sort(poles[1][np.abs(poles[1]) > 1.0].real)
    assert outside == pytest.approx([-1.001, 1.0151], abs=5e-4)


def test_four_digits_of_the_expanded_denominator_are_not_stable() -> None:
    """That is what rounding the expanded form does to ours too."""
    made = discretize(FoPi(0.09, 0.025, 0.8), DigitalSpec(TS, "modified_oustaloup", 7))
    printed = np.round(np.poly(made.sections.poles), 4)
    assert np.abs(np.roots(printed)).max() > 1.0


#: a plant in hours: its loop crosses 1 near 3e-4 rad/s
_HOURS = (
    "schema: 1\nname: hours\nplant: {model: lag, static_gain: 2, time_constant_s: {min: 6000, max: 9000}}\n"
    "controller: {kp: 0.6, ki: 2.0e-3, alpha: 0.8}\nrequirements: [{phase_margin_deg: {at_least: 30}}]\n"
    "digital: {sample_time_s: 60, design: sampled"
)


def test_a_default_band_above_the_crossover_is_noted_with_one_that_holds_it() -> None:
    spec = parse_spec(_HOURS + "}\n")
    made = ft.discretize(spec, FoPi(0.6, 2.0e-3, 0.8), proof=False)
    assert "does not hold the loop's gain crossover" in made.to_dict()["band_note"]
    text = " ".join(digital_text(made).plain.split())
    assert "NOTE: the filter's band_rad_s, 0.001 to 1000, does not hold" in text
    written = made.controller.band_note.partition("write ")[2].partition(" in the spec")[0]
    assert written in text
    again = ft.discretize(parse_spec(f"{_HOURS}, {written}}}\n"), FoPi(0.6, 2.0e-3, 0.8), proof=False)
    assert again.controller.band_note == ""
    assert "band_note" not in again.to_dict()


def test_errors_are_stated_from_where_the_loop_needs_the_filter() -> None:
    gains = FoPi(0.6, 2.0e-3, 0.8)
    made = ft.discretize(parse_spec(_HOURS + "}\n"), gains, proof=False).controller
    assert made.crossover_rad_s is not None
    assert made.errors_from_rad_s == pytest.approx(0.01 * made.crossover_rad_s)
    omega = np.geomspace(made.errors_from_rad_s, 1e-3, 50)
    wrong = np.abs(made.sections.response(omega) / (gains.kp + gains.ki * (1j * omega) ** -gains.alpha) - 1.0)
    assert made.errors[0][1] >= wrong.max() * (1.0 - 1e-9)  # both begin at the same frequency, where it is largest
    assert wrong.max() > 0.05
    assert made.accurate_rad_s is not None
    assert made.accurate_rad_s[0] > made.errors_from_rad_s


def test_a_crossover_inside_the_band_changes_no_error() -> None:
    digital = DigitalSpec(0.2)
    assert discretize(FoPi(0.4, 0.3, 0.6), digital, 0.3).errors == discretize(FoPi(0.4, 0.3, 0.6), digital).errors
    assert discretize(FoPi(0.4, 0.3, 0.6), digital, 0.3).band_note == ""


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("crossover", "noted"), [(0.0999, True), (0.1001, False), (999.0, False), (1001.0, True)])
def test_the_default_band_suits_the_crossovers_that_its_description_names(crossover: float, noted: bool) -> None:
    digital = DigitalSpec(1e-3)
    assert bool(discretize(FoPi(0.4, 0.3, 0.6), digital, crossover).band_note) == noted
    # an integral of order one needs no band
    assert discretize(FoPi(0.4, 0.3, 1.0), digital, crossover).band_note == ""


def test_every_method_of_the_spec_language_is_an_approximation_of_its_own() -> None:
    assert set(METHODS) == {method.value for method in Method}
    assert set(APPROXIMATIONS) == set(Method) - {Method.FIT}
    assert len(set(APPROXIMATIONS.values())) == len(APPROXIMATIONS)

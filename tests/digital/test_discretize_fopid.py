"""Orders of integral and derivative on samples, against their approximations in s, written down anew."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.fopid_loops import bilinear, oustaloup

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.digital import discretize, sections_of, to_document
from fopi_tune.digital.realise import Form, Precision
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import DigitalSpec

#: relative to the terms' and the sections' sizes
SAME = 1e-12


def random_fopid(rng: np.random.Generator, sample_time_s: float) -> FoPid:
    """With signs mixed, a gain of 0 at times, orders over their ranges, and Tf from Ts/2 to 1000 Ts."""
    kp, ki, kd = (np.exp(rng.normal(size=3)) * rng.choice([1.0, -1.0, 0.0], p=[0.7, 0.2, 0.1], size=3)).tolist()
    filter_s = sample_time_s * float(np.exp(rng.uniform(np.log(0.5), np.log(1e3))))
    return FoPid(kp, ki, float(rng.uniform(0.2, 1.8)), kd, float(rng.uniform(0.1, 1.0)), filter_s)


def test_the_sum_of_all_sections_is_tustins_substitution_in_the_approximations() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        digital = DigitalSpec(float(np.exp(rng.uniform(-5.0, 1.0))), poles=int(rng.integers(1, 9)))
        gains = random_fopid(rng, digital.sample_time_s)
        omega = np.geomspace(1e-3, 0.999, 50) * np.pi / digital.sample_time_s
        s = bilinear(omega, digital.sample_time_s)
        integral = gains.ki * oustaloup(1.0 - gains.alpha, s, digital) / s
        derivative = gains.kd * s * oustaloup(gains.mu - 1.0, s, digital)
        derivative = derivative / (gains.derivative_filter_time_constant_s * s + 1.0)
        sections = sections_of(gains, digital)
        assert sections.parts is not None
        # a lag next to a pole of the filter makes two large terms that cancel, as residues do towards z = -1
        size = np.abs(gains.kp) + np.abs(integral) + np.abs(derivative)
        size = size + np.abs(sections.parts.derivative).sum() + np.abs(sections.residues).sum()
        error = np.abs(sections.response(omega) - (gains.kp + integral + derivative))
        assert np.all(error <= SAME * size)


@pytest.mark.parametrize("method", ["oustaloup", "modified_oustaloup"])
def test_the_derivative_is_stable_and_0_at_frequency_0(method: str) -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        digital = DigitalSpec(0.05, method=method)
        gains = random_fopid(rng, 0.05)
        alone = sections_of(FoPid(0.0, 0.0, 1.0, 1.0, gains.mu, gains.derivative_filter_time_constant_s), digital)
        assert alone.parts is not None
        assert len(alone.poles) == len(alone.parts.derivative) == digital.poles + 1
        assert np.all(np.abs(alone.poles) < 1.0)
        at_rest = alone.direct + sum(r / (1.0 - p) for p, r in zip(alone.poles, alone.residues, strict=True))
        # each term k - k q/(z - p) vanishes at z = 1 up to rounding
        assert abs(at_rest) <= 1e-12 * np.abs(alone.parts.derivative).sum()


@pytest.mark.parametrize("method", ["oustaloup", "modified_oustaloup", "fit"])
@pytest.mark.parametrize(("rule", "prewarp"), [("tustin", "none"), ("tustin", "crossover"), ("matched", "none")])
def test_a_derivative_of_order_1_is_that_of_a_pid(method: str, rule: str, prewarp: str) -> None:
    digital = DigitalSpec(0.1, method=method, rule=rule, prewarp="none" if method == "fit" else prewarp)
    found = sections_of(FoPid(1.0, 0.4, 1.0, 0.3, 1.0, 0.05), digital, 3.0)
    pid = sections_of(Pid(1.0, 0.4, 0.3, 0.05), digital, 3.0)
    assert found == pid
    assert found.parts == pid.parts


def test_the_derivative_is_sampled_by_tustins_rule_whatever_the_integral_is() -> None:
    fopid = FoPid(1.0, 0.4, 0.8, 0.3, 0.6, 0.05)
    plain = sections_of(fopid, DigitalSpec(0.1))
    for rule, prewarp in (("tustin", "crossover"), ("matched", "none")):
        digital = DigitalSpec(0.1, rule=rule, prewarp=prewarp)
        whole, integral = sections_of(fopid, digital, 3.0), sections_of(FoPi(1.0, 0.4, 0.8), digital, 3.0)
        count = whole.integral_sections
        assert (whole.poles[:count], whole.residues[:count]) == (integral.poles, integral.residues)
        assert (whole.poles[count:], whole.residues[count:]) == (plain.poles[count:], plain.residues[count:])


def test_poles_of_both_groups_may_be_equal() -> None:
    # with alpha + mu = 2 both are of the same approximation
    found = sections_of(FoPid(1.0, 0.4, 1.4, 0.3, 0.6, 0.2), DigitalSpec(0.1))
    count = found.integral_sections
    assert found.poles[1:count] == pytest.approx(found.poles[count:-1], rel=1e-12)
    assert discretize(FoPid(1.0, 0.4, 1.4, 0.3, 0.6, 0.2), DigitalSpec(0.1)).realisations[1].error < 1e-4


def test_a_lag_on_a_pole_of_the_filter_is_refused() -> None:
    digital = DigitalSpec(0.1, band_rad_s=(0.01, 100.0), poles=1)
    # of a single pole wb (wh/wb)^(1/2 + (mu - 1)/2)
    own = 0.01 * 1e4**0.25
    for filter_s in (1.0 / own, 1.0 / own * (1.0 + 1e-15), 1.0 / own * (1.0 - 5e-7)):
        with pytest.raises(DomainError, match=r"derivative_filter_time_constant_s 10 .* a pole of the filter"):
            sections_of(FoPid(1.0, 0.0, 1.0, 0.3, 0.5, filter_s), digital)
    assert len(sections_of(FoPid(1.0, 0.0, 1.0, 0.3, 0.5, 1.001 / own), digital).poles) == 2


def test_a_fit_has_no_derivative_of_another_order() -> None:
    with pytest.raises(DomainError, match=r"no derivative of an order other than 1; take method: oustaloup"):
        sections_of(FoPid(1.0, 0.4, 1.0, 0.3, 0.6, 0.05), DigitalSpec(0.1, method="fit"))


def test_a_filter_faster_than_half_the_sample_time_is_refused() -> None:
    with pytest.raises(DomainError, match=r"derivative_filter_time_constant_s 0.04 .* write 0.05 or more"):
        sections_of(FoPid(1.0, 0.4, 0.9, 0.3, 0.6, 0.04), DigitalSpec(0.1))


def test_errors_are_those_of_the_whole_and_of_each_term_against_its_ideal() -> None:
    gains, digital = FoPid(1.0, 0.5, 0.9, 0.4, 0.7, 0.1), DigitalSpec(0.01)
    made = discretize(gains, digital, 2.0)
    omega = np.geomspace(made.errors_from_rad_s, np.pi / 0.01, 600)
    s, z = 1j * omega, bilinear(omega, 0.01)
    ideals = {"integral": s**-0.9, "derivative": s**0.7 / (0.1 * s + 1.0)}
    filters = {
        "integral": oustaloup(0.1, z, digital) / z,
        "derivative": z * oustaloup(-0.3, z, digital) / (0.1 * z + 1.0),
    }
    assert list(made.errors_of_terms) == ["integral", "derivative"]
    for name, stated in made.errors_of_terms.items():
        largest = np.abs(filters[name] / ideals[name] - 1.0)
        for end, error in stated:
            # at Nyquist's frequency itself tan is at its pole
            inside = omega <= end * (1.0 + 1e-12)
            assert error == pytest.approx(largest[inside].max(), rel=1e-6)
    whole = 1.0 + 0.5 * ideals["integral"] + 0.4 * ideals["derivative"]
    made_of = 1.0 + 0.5 * filters["integral"] + 0.4 * filters["derivative"]
    for end, error in made.errors:
        assert error == pytest.approx(np.abs(made_of / whole - 1.0)[omega <= end * (1.0 + 1e-12)].max(), rel=1e-6)
    assert discretize(Pid(1.0, 0.5, 0.4, 0.1), digital, 2.0).errors_of_terms == {}
    assert list(discretize(FoPid(1.0, 0.0, 1.0, 0.4, 0.7, 0.1), digital, 2.0).errors_of_terms) == ["derivative"]


def test_in_the_band_the_derivative_errs_by_little() -> None:
    """Up to a tenth of Nyquist's frequency, more than a decade above the band's lower end."""
    for mu in (0.3, 0.5, 0.7, 0.9):
        digital, gains = DigitalSpec(0.01), FoPid(0.0, 0.0, 1.0, 1.0, mu, 0.05)
        omega = np.geomspace(0.05, 31.0, 300)
        error = np.abs(sections_of(gains, digital).response(omega) / gains(1j * omega) - 1.0)
        # the ripple of seven poles over six decades
        assert error.max() < 0.04


@pytest.mark.parametrize(("mu", "own", "other"), [(0.8, 0.0125, 0.1131), (0.5, 0.0381, 0.0848), (0.2, 0.0685, 0.0657)])
def test_a_filter_of_the_order_itself_errs_by_more_unless_the_order_is_small(
    mu: float, own: float, other: float
) -> None:
    digital, gains = DigitalSpec(0.01), FoPid(0.0, 0.0, 1.0, 1.0, mu, 0.02)
    nyquist = np.pi / 0.01
    omega = np.geomspace(0.003, 0.3, 300) * nyquist
    s, ideal = bilinear(omega, 0.01), gains(1j * omega)
    assert np.abs(sections_of(gains, digital).response(omega) / ideal - 1.0).max() == pytest.approx(own, abs=1e-4)
    direct = oustaloup(mu, s, digital) / (0.02 * s + 1.0)
    assert np.abs(direct / ideal - 1.0).max() == pytest.approx(other, abs=1e-4)


def test_every_realisation_is_of_the_whole_sum() -> None:
    made = discretize(FoPid(1.0, 0.5, 0.9, 0.4, 0.7, 0.1), DigitalSpec(0.01), 2.0)
    for each in made.realisations:
        # the forms are the same filter: cascades of sixteen poles near 1 lose half of the digits
        assert each.precision is Precision.FLOAT32 or each.error < 1e-7, each.form
    of = {(each.form, each.precision): each for each in made.realisations}
    parallel = of[Form.PARALLEL, Precision.FLOAT32]
    assert parallel.stable
    # a few times the project's bar of one group
    assert parallel.error < 1e-5


def test_the_document_names_the_derivatives_sections_and_the_terms_errors() -> None:
    made = discretize(FoPid(1.0, 0.5, 0.9, 0.4, 0.7, 0.1), DigitalSpec(0.01), 2.0)
    document = to_document(made)
    said = document["controller"]
    assert said["derivative"]["acts_on"] == "-measurement"
    assert said["sections"][-8:] == said["derivative"]["sections"]
    assert made.sections.parts is not None
    expected = 1.0 + made.sections.parts.integral + said["derivative"]["direct"]
    assert said["direct"] == pytest.approx(expected, rel=1e-14)
    assert list(document["errors_of_terms"]) == ["integral", "derivative"]
    assert "errors_of_terms" not in to_document(discretize(Pid(1.0, 0.5, 0.4, 0.1), DigitalSpec(0.01)))


def test_a_band_that_does_not_hold_the_crossover_is_noted_for_the_derivatives_order_too() -> None:
    digital = DigitalSpec(0.01, band_rad_s=(1.0, 100.0))
    assert "band_rad_s" in discretize(FoPid(1.0, 0.5, 1.0, 0.4, 0.7, 0.1), digital, 2.0).band_note
    assert discretize(FoPid(1.0, 0.5, 1.0, 0.0, 0.7, 0.1), digital, 2.0).band_note == ""

"""The derivative of a PID on samples, against Tustin's substitution in C(s) itself."""

from __future__ import annotations

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi, Pid
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import Plant
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import unstable_closed_loop_poles
from fopi_tune.digital import discretize, sections_of, to_document
from fopi_tune.digital.realise import Form, Precision
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import DigitalSpec

#: relative; sums of a few terms that cancel by less than a factor of 100 here
SAME = 1e-12


def random_pid(rng: np.random.Generator, sample_time_s: float) -> Pid:
    """With signs mixed, a gain of 0 at times, and Tf from Ts/2 to 1000 Ts."""
    kp, ki, kd = np.exp(rng.normal(size=3)) * rng.choice([1.0, -1.0, 0.0], p=[0.7, 0.2, 0.1], size=3)
    return Pid(float(kp), float(ki), float(kd), sample_time_s * float(np.exp(rng.uniform(np.log(0.5), np.log(1e3)))))


def test_the_sum_of_all_sections_is_tustins_substitution_in_the_controller() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        digital = DigitalSpec(float(np.exp(rng.uniform(-5.0, 1.0))))
        pid = random_pid(rng, digital.sample_time_s)
        omega = np.geomspace(1e-3, 0.999, 50) * np.pi / digital.sample_time_s
        s = 2j / digital.sample_time_s * np.tan(0.5 * omega * digital.sample_time_s)
        terms = (
            np.abs(pid.kp) + np.abs(pid.ki / s) + np.abs(pid.kd * s / (pid.derivative_filter_time_constant_s * s + 1.0))
        )
        error = np.abs(sections_of(pid, digital).response(omega) - pid(s))
        assert np.all(error <= SAME * terms)


@pytest.mark.parametrize(("rule", "prewarp"), [("tustin", "crossover"), ("matched", "none")])
def test_the_derivative_is_sampled_by_tustins_rule_whatever_the_integral_is(rule: str, prewarp: str) -> None:
    pid, digital = Pid(1.0, 0.4, 0.3, 0.05), DigitalSpec(0.1, rule=rule, prewarp=prewarp)
    alone = sections_of(FoPi(1.0, 0.4, 1.0), digital, 3.0)
    whole = sections_of(pid, digital, 3.0)
    assert whole.poles == (*alone.poles, (2.0 * 0.05 - 0.1) / (2.0 * 0.05 + 0.1))
    assert whole.residues[:-1] == alone.residues
    assert whole.parts is not None
    assert alone.parts is not None
    assert (whole.parts.proportional, whole.parts.integral) == (alone.parts.proportional, alone.parts.integral)
    assert whole.parts.derivative == (pytest.approx(2.0 * 0.3 / (2.0 * 0.05 + 0.1), rel=1e-15),)


def test_a_derivative_of_gain_0_has_no_section() -> None:
    digital = DigitalSpec(0.1)
    found = sections_of(Pid(1.0, 0.4, 0.0, 0.05), digital)
    assert found == sections_of(FoPi(1.0, 0.4, 1.0), digital)
    assert not found.has_derivative


def test_a_filter_faster_than_half_the_sample_time_is_refused_with_what_to_write() -> None:
    with pytest.raises(DomainError, match=r"derivative_filter_time_constant_s 0.04 .* write 0.05 or more"):
        sections_of(Pid(1.0, 0.4, 0.3, 0.04), DigitalSpec(0.1))
    assert sections_of(Pid(1.0, 0.4, 0.3, 0.05), DigitalSpec(0.1)).poles == (1.0, 0.0)


def test_errors_are_those_against_the_whole_controller() -> None:
    pid, digital = Pid(1.0, 0.5, 0.4, 0.1), DigitalSpec(0.01)
    made = discretize(pid, digital, 2.0)
    omega = np.geomspace(made.errors_from_rad_s, np.pi / 0.01, 600)
    s = 1j * omega
    ideal = 1.0 + 0.5 / s + 0.4 * s / (0.1 * s + 1.0)
    largest = np.abs(made.sections.response(omega) / ideal - 1.0)
    for end, error in made.errors:
        assert error == pytest.approx(largest[omega <= end * (1.0 + 1e-12)].max(), rel=1e-9)
    # a tenth of Nyquist's frequency is 31 rad/s, where Tustin's rule is off by (omega Ts)^2/12 of the slope
    assert made.errors[0][1] < 0.01


def test_every_realisation_of_a_pid_is_of_the_whole_sum() -> None:
    made = discretize(Pid(1.0, 0.5, 0.4, 0.1), DigitalSpec(0.01), 2.0)
    for each in made.realisations:
        assert each.stable
        # the forms are the same filter: float64 rounds at 1e-16, cascades of poles near 1 lose some digits of it
        assert each.error < (1e-9 if each.precision is Precision.FLOAT64 else 1e-3), each.form
    # the project's bar of the parallel form in float32
    assert (
        next(e.error for e in made.realisations if (e.form, e.precision) == (Form.PARALLEL, Precision.FLOAT32)) < 2e-6
    )


def test_without_an_integral_the_derivative_is_stable_in_every_precision() -> None:
    made = discretize(Pid(1.0, 0.0, 0.4, 0.1), DigitalSpec(0.01), 2.0)
    assert made.sections.poles == ((0.2 - 0.01) / (0.2 + 0.01),)
    assert all(each.stable for each in made.realisations)


def test_the_document_names_the_derivatives_part_of_the_sum() -> None:
    made = discretize(Pid(1.0, 0.5, 0.4, 0.1), DigitalSpec(0.01), 2.0)
    said = to_document(made)["controller"]
    assert said["derivative"]["acts_on"] == "-measurement"
    assert said["sections"][-1] == {name: said["derivative"][name] for name in ("pole", "residue")}
    assert said["direct"] == pytest.approx(1.0 + 0.5 * 0.005 + said["derivative"]["direct"], rel=1e-15)
    assert "derivative" not in to_document(discretize(FoPi(1.0, 0.5, 1.0), DigitalSpec(0.01)))["controller"]


def test_closed_loop_poles_of_sampled_pid_loops_are_counted_right() -> None:
    rng, Ts, seen = np.random.default_rng(3), 0.1, set()
    for _ in range(60):
        pid, tau = random_pid(rng, Ts), float(np.exp(rng.normal()))
        if pid.is_zero:
            continue
        sections = sections_of(pid, DigitalSpec(Ts))
        loops = SampledLoops.implemented(pid, Implementation(sections), Plants.of(Plant((1.0,), (tau, 1.0))))
        # y = q/(z - p) u with p = e^(-Ts/tau);  u = C (-y) by the sections' own states: x+ = A x - b y,  y+ = p y + q u
        p = np.exp(-Ts / tau)
        n = len(sections.poles)
        matrix = np.zeros((n + 1, n + 1))
        matrix[:n, :n], matrix[:n, n] = np.diag(sections.poles), -np.array(sections.residues)
        matrix[n, :n], matrix[n, n] = 1.0 - p, p - (1.0 - p) * sections.direct
        sizes = np.abs(np.linalg.eigvals(matrix))
        if np.any(np.abs(sizes - 1.0) < 1e-6):
            continue
        wanted = int((sizes > 1.0).sum())
        seen.add(wanted)
        assert unstable_closed_loop_poles(loops)[0] == wanted
    assert {0, 1} <= seen

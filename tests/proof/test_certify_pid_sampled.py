"""A PID on samples by Tustin's rule: limits around the worst case against state space and eigenvalues.

Its sections are written down by hand; the pole of the derivative's filter is (2 Tf - Ts)/(2 Tf + Ts), negative for a
filter that is faster than half a sample.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable

import numpy as np
import pytest
from cases.plants import spec_of
from cases.random_pids import on_samples, pid_for, plants_of, sized, uncertain
from flint import acb, arb, ctx
from oracles.sampled_families import worst_of

from fopi_tune.core.controller import Pid
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import is_stable
from fopi_tune.errors import DomainError
from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.balls.sampled_controllers import sections_of, value_and_derivative
from fopi_tune.proof.certificate import Certificate, Verdict
from fopi_tune.proof.documents import to_document
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import DesignSpec, Relation, Requirement, Scope

OFFSET = 1e-5
ASKED = (
    *((name, True) for name in ("sensitivity_db", "complementary_sensitivity_db", "control_sensitivity_db") * 2),
    ("loop_gain_db", True),
    ("sensitivity_db", False),
    *((name, False) for name in ("phase_margin_deg", "gain_margin_db", "delay_margin_s")),
    *(("crossover_rad_s", upper) for upper in (True, False)),
)


def test_the_sections_written_down_by_hand_are_the_bilinear_map_of_the_pid() -> None:
    rng = np.random.default_rng(31)
    with ctx.workprec(64):
        for _ in range(30):
            ts = sized(rng, 0.01, 0.5)
            kp, ki, kd = rng.normal(size=3).tolist()
            pid = Pid(kp, ki, kd, sized(rng, 0.1 * ts, 10.0 * ts))
            sections = on_samples(pid, ts)
            nu = sized(rng, 1e-3, 1e3)
            # s = (2/Ts) w with w = j nu
            expected = complex(pid(2j * nu / ts))
            value, _ = value_and_derivative(sections_of(Implementation(sections)), acb(0, arb(nu)))
            # direct and residues are rounded to doubles, and cancel where the filter is fast
            size = abs(pid.kp) + abs(pid.ki) * ts / nu + abs(pid.kd) / pid.derivative_filter_time_constant_s
            assert abs(complex(value.mid()) - expected) < 1e-12 * size
            assert abs(sections.response(np.array([2.0 / ts * math.atan(nu)]))[0] - expected) < 1e-12 * size


def _loop(rng: np.random.Generator) -> tuple[PlantFamily, Pid, Implementation]:
    plants = uncertain(rng, plants_of(rng), least=1)
    pid = pid_for(rng, plants)
    # filters of a fifth of a sample up to many samples
    sample_time_s = pid.derivative_filter_time_constant_s * sized(rng, 0.1, 5.0)
    delay = float(rng.choice([0.0, 0.0, 1.0, rng.uniform(0.0, 2.0)]))
    return plants, pid, Implementation(on_samples(pid, sample_time_s), delay)


def design(seed: int) -> tuple[DesignSpec, Pid, Implementation]:
    """Stable at the corners in most cases, with one or two uncertain numbers; the limit is not set yet."""
    rng = np.random.default_rng([seed, 22])
    plants, pid, implementation = _loop(rng)
    for _ in range(39):
        members = Plants.members(plants, plants.corners())
        if rng.random() < 0.05 or is_stable(SampledLoops.implemented(pid, implementation, members)).all():
            break
        plants, pid, implementation = _loop(rng)
    name, upper = ASKED[int(rng.integers(len(ASKED)))]
    low, high, nyquist = 0.0, math.inf, implementation.nyquist_rad_s
    if QUANTITIES[name].takes_band and (name == "loop_gain_db" or not upper or rng.random() < 0.4):
        low = float(nyquist * 10.0 ** rng.uniform(-2.0, -0.5))
        high = math.inf if upper and rng.random() < 0.5 else low * float(rng.uniform(1.2, 3.0))
    asked = Requirement(name, Relation.AT_MOST if upper else Relation.AT_LEAST, (1.0,), Scope.FAMILY, low, high)
    return spec_of(plants, asked, name=f"seed_{seed}"), pid, implementation


def certificate_at(spec: DesignSpec, pid: Pid, implementation: Implementation, natural: float) -> Certificate:
    """The certificate of the spec with its limit at this value; it must also stand on its own."""
    asked = spec.requirements[0]
    limit = QUANTITIES[asked.quantity].from_natural(natural)
    moved = Requirement(asked.quantity, asked.relation, (limit,), asked.scope, asked.from_rad_s, asked.to_rad_s)
    with_limit = spec_of(spec.plant, moved, name=spec.name)
    certificate = certify(with_limit, verify(with_limit, pid, implementation=implementation), {}, implementation)
    assert recheck(to_document(certificate)).problems == ()
    return certificate


def answer(seed: int) -> str:
    """What became of a pair.

    Raises:
        AssertionError: a wrong proof or refutation, or a certificate that does not stand on its own.
    """
    spec, pid, implementation = design(seed)
    worst, radius = worst_of(spec, implementation)
    if abs(radius - 1.0) < 1e-4:
        return "marginal"
    asked = spec.requirements[0]
    if radius > 1.0:
        certificate = certify(spec, verify(spec, pid, implementation=implementation), {}, implementation)
        assert certificate.stability.verdict is Verdict.REFUTED, seed
        return "unstable"
    if math.isnan(worst) or abs(worst) > 20.0 or (asked.quantity == "delay_margin_s" and worst <= 0.0):
        return "no value"
    relative = asked.quantity in ("phase_margin_deg", "delay_margin_s")
    step = OFFSET * (max(abs(worst), 0.2) if relative else 1.0) * (1.0 if asked.relation is Relation.AT_MOST else -1.0)
    try:
        beyond, short = (certificate_at(spec, pid, implementation, worst + s) for s in (step, -step))
    except DomainError:
        return "no value"
    assert short.requirements[0].verdict is not Verdict.PROVED, (seed, worst)
    assert beyond.requirements[0].verdict is not Verdict.REFUTED, (seed, worst)
    verdicts = beyond.stability.verdict, beyond.requirements[0].verdict, short.requirements[0].verdict
    return "undecided" if Verdict.UNDECIDED in verdicts else "told apart"


def outcomes(seeds: Iterable[int]) -> tuple[Counter[str], list[int]]:
    """How many answers of each sort, and the undecided seeds."""
    said = {seed: answer(seed) for seed in seeds}
    return Counter(said.values()), [seed for seed, word in said.items() if word == "undecided"]


@pytest.mark.parametrize("seeds", [range(4), pytest.param(range(4, 8), marks=pytest.mark.long)])
def test_limits_around_the_worst_case_of_a_pid_on_samples_are_told_apart(seeds: range) -> None:
    counted, undecided = outcomes(seeds)
    assert undecided == []
    assert counted["told apart"] >= 5 * len(seeds) // 8, counted


@pytest.mark.long
def test_limits_around_the_worst_cases_of_forty_pids_on_samples_are_told_apart(
    record_property: Callable[[str, object], None],
) -> None:
    counted, undecided = outcomes(range(100, 140))
    record_property("outcomes", dict(counted))
    print(dict(counted), "undecided:", undecided)
    assert len(undecided) <= 1, undecided
    assert counted["told apart"] >= 30, counted

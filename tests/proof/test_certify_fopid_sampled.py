"""A fopid on samples, of several methods and rules: limits around the worst case against state space and eigenvalues.

That the sections are what they should be is tested in `digital/test_discretize_fopid.py`; here they are given.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from cases.plants import spec_of
from cases.random_fopids import fopid_for
from cases.random_pids import plants_of, sized, uncertain
from cases.sampled_limits_told_apart import outcomes
from flint import acb, arb, ctx
from oracles.fopid_loops import on_samples
from oracles.sampled_loops import sample

from fopi_tune.core.controller import FoPid
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import PlantFamily
from fopi_tune.digital import sections_of
from fopi_tune.proof import verify
from fopi_tune.proof.balls.sampled_controllers import sections_of as sections_in_w
from fopi_tune.proof.balls.sampled_controllers import value_and_derivative
from fopi_tune.spec.model import DigitalSpec, Relation, Requirement, Scope

#: of the random numbers
SALT = 41


def _loop(rng: np.random.Generator) -> tuple[PlantFamily, FoPid, Implementation]:
    plants = uncertain(rng, plants_of(rng), least=1)
    gains = fopid_for(rng, plants)
    filter_s = gains.derivative_filter_time_constant_s
    rule = str(rng.choice(["tustin", "matched"], p=[0.8, 0.2]))
    digital = DigitalSpec(
        filter_s * sized(rng, 0.1, 1.9),
        method=str(rng.choice(["oustaloup", "modified_oustaloup"])),
        poles=int(rng.integers(3, 6)),
        band_rad_s=(1e-3 / filter_s, (2.0 if rule == "matched" else 30.0) / filter_s),
        rule=rule,
    )
    delay = float(rng.choice([0.0, 0.0, 1.0, rng.uniform(0.0, 2.0)]))
    return plants, gains, Implementation(sections_of(gains, digital, 0.2 / filter_s), delay)


def test_balls_hold_the_controller_and_its_slope() -> None:
    rng = np.random.default_rng(32)
    with ctx.workprec(64):
        for _ in range(20):
            _, _, implementation = _loop(rng)
            sections, nu = implementation.sections, sized(rng, 1e-3, 1e2)
            omega = 2.0 / sections.sample_time_s * math.atan(nu)
            value, slope = value_and_derivative(sections_in_w(implementation), acb(0, arb(nu)))
            size = abs(sections.direct) + np.abs(sections.residues).sum()
            found = complex(sections.response(np.array([omega]))[0])
            # sums in floating point lose the digits that terms of either sign share
            assert abs(complex(value.mid()) - found) < 1e-11 * (size + abs(found))
            step = 1e-4
            above, below = (
                complex(sections.response(2.0 / sections.sample_time_s * np.arctan([nu * math.exp(h)]))[0])
                for h in (step, -step)
            )
            # a central difference errs by the third derivative times its step squared
            rough = (above - below) / (2.0 * step)
            assert abs(complex(slope.mid()) - rough) < 1e-6 * (size + abs(found)) + 1e-6 * abs(rough)


def test_margins_and_peaks_are_those_of_a_dense_evaluation_in_z() -> None:
    rng, compared = np.random.default_rng(33), 0
    asked = [
        Requirement(name, relation, (limit,), Scope.NOMINAL)
        for name, relation, limit in (
            ("phase_margin_deg", Relation.AT_LEAST, 1.0),
            ("gain_margin_db", Relation.AT_LEAST, 0.1),
            ("sensitivity_db", Relation.AT_MOST, 40.0),
        )
    ]
    while compared < 6:
        plants = plants_of(rng)
        gains = fopid_for(rng, plants)
        filter_s = gains.derivative_filter_time_constant_s
        digital = DigitalSpec(filter_s * sized(rng, 0.1, 1.9), band_rad_s=(1e-3 / filter_s, 30.0 / filter_s), poles=5)
        implementation = Implementation(sections_of(gains, digital), 0.5)
        found = verify(spec_of(plants, *asked), gains, implementation=implementation)
        if not found.stability.stable:
            continue
        omega = np.geomspace(1e-5, 1.0 - 1e-9, 40_000) * np.pi / digital.sample_time_s
        plant = sample(plants.member(plants.nominal_point), digital.sample_time_s, 0.5)
        loop = on_samples(gains, digital, omega) * plant.response(omega)
        peak = -20.0 * np.log10(np.abs(1.0 + loop).min())
        # a dense grid misses the peak itself by its second order
        assert found.requirements[2].achieved == pytest.approx(peak, abs=2e-3)
        above = np.abs(loop) > 1.0
        crossing = np.flatnonzero(above[1:] != above[:-1])
        if len(crossing):
            margin = np.degrees(np.abs(np.angle(-loop[crossing]))).min()
            assert found.requirements[0].achieved == pytest.approx(margin, abs=0.2)
        # L crosses the negative real axis below 1
        turns = np.flatnonzero((np.diff(np.sign(loop.imag)) != 0.0) & (loop.real[1:] < 0.0))
        ends = [k for k in (0, -1) if loop[k].real < 0.0 and abs(loop[k].imag) < 1e-3 * abs(loop[k])]
        sizes = np.abs(loop[[*turns, *ends]])
        if np.any(sizes < 0.99):
            assert found.requirements[1].achieved == pytest.approx(-20.0 * np.log10(sizes[sizes < 1.0].max()), abs=0.05)
        compared += 1


@pytest.mark.parametrize("seeds", [range(3, 5), pytest.param(range(5, 12), marks=pytest.mark.long)])
def test_limits_around_the_worst_case_of_a_fopid_on_samples_are_told_apart(seeds: range) -> None:
    counted, undecided = outcomes(seeds, _loop, SALT)
    assert undecided == []
    assert counted["told apart"] >= len(seeds) // 2, counted


@pytest.mark.long
@pytest.mark.parametrize("block", range(4))
def test_limits_around_the_worst_cases_of_forty_fopids_on_samples_are_told_apart(
    block: int, record_property: Callable[[str, object], None]
) -> None:
    counted, undecided = outcomes(range(100 + 10 * block, 110 + 10 * block), _loop, SALT)
    record_property("outcomes", dict(counted))
    print(dict(counted), "undecided:", undecided)
    assert len(undecided) <= 1, undecided
    assert counted["told apart"] >= 5, counted

"""Correlated draws: their moments, their own distributions, what does not change, and what is refused."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

import fopi_tune as ft
from fopi_tune.core.bode_form import Array
from fopi_tune.core.distributions.correlation import Correlation, correlated
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.errors import DomainError, SpecError
from fopi_tune.montecarlo.documents import to_document
from fopi_tune.montecarlo.draws import sample_points
from fopi_tune.montecarlo.montecarlo import monte_carlo
from fopi_tune.montecarlo.outcomes import sampling_plan_of
from fopi_tune.spec.load import parse_spec
from fopi_tune.spec.model import DesignSpec

MANY = 40_000
#: standard errors of a moment that a right sampler does not exceed, but once in 15,000
FAR = 4.0
SPEC = """
schema: 1
name: together
plant:
  model: lag
  static_gain: {nominal: 1, min: 0.8, max: 1.2}
  time_constant_s: {nominal: 2.25, min: 1.6, max: 3.1}
  dead_time_s: {nominal: 0.2, min: 0.1, max: 0.3}
controller: {kp: 0.44651, ki: 0.37033, alpha: 0.83197}
requirements: [{phase_margin_deg: {at_least: 60}}]
digital: {sample_time_s: 0.2}
validation: VALIDATION
"""
NORMALS = (
    "distributions: {static_gain: {normal: {mean: 1, std: 0.1}}, time_constant_s: {normal: {mean: 2.3, std: 0.3}}, "
    "dead_time_s: {normal: {mean: 0.2, std: 0.02}}}"
)


def spec_with(validation: str) -> DesignSpec:
    return parse_spec(SPEC.replace("VALIDATION", validation))


def drawn(validation: str) -> Array:
    spec = spec_with(validation)
    assert spec.validation is not None
    return sample_points(sampling_plan_of(spec.validation), spec.plant, 0, spec.validation.samples)


def pairs(**coefficients: float) -> str:
    """Of names with two underscores between: gain__lag=0.6."""
    names = {"gain": "static_gain", "lag": "time_constant_s", "delay": "dead_time_s"}
    listed = [
        f"{{numbers: [{', '.join(names[each] for each in pair.split('__'))}], coefficient: {coefficient}}}"
        for pair, coefficient in coefficients.items()
    ]
    return f"correlations: [{', '.join(listed)}]"


def spearman(one: Array, other: Array) -> float:
    """The rank correlation, by SciPy."""
    found: Any = stats.spearmanr(one, other)
    return float(found.statistic)


@pytest.mark.parametrize("design", ["random", "sobol"])
def test_moments_of_correlated_normal_numbers(design: str) -> None:
    """Standard errors for independent draws:  of a mean s/sqrt n, of a std s/sqrt(2 n), of atanh r 1/sqrt(n - 3)."""
    told = pairs(gain__lag=0.6, lag__delay=-0.3)
    x = drawn(f"{{samples: {MANY}, seed: 5, design: {design}, {NORMALS}, {told}}}")
    wanted = {"static_gain": (1.0, 0.1), "time_constant_s": (2.3, 0.3), "dead_time_s": (0.2, 0.02)}
    spec = spec_with("{samples: 1}")
    for column, name in enumerate(spec.plant.uncertain_names):
        mean, std = wanted[name]
        assert abs(x[:, column].mean() - mean) < FAR * std / math.sqrt(MANY)
        assert abs(x[:, column].std() - std) < FAR * std / math.sqrt(2 * MANY)
    order = [spec.plant.uncertain_names.index(name) for name in wanted]
    found = np.asarray(np.corrcoef(x[:, order].T))
    for (i, j), coefficient in {(0, 1): 0.6, (1, 2): -0.3, (0, 2): 0.0}.items():
        assert abs(math.atanh(found[i, j]) - math.atanh(coefficient)) < FAR / math.sqrt(MANY - 3)


@pytest.mark.parametrize("coefficient", [0.95, -0.5])
def test_other_distributions_keep_their_own_and_have_spearmans_coefficient(coefficient: float) -> None:
    kinds = "distributions: {static_gain: {beta: {a: 2, b: 3}}}"
    x = drawn(f"{{samples: {MANY}, seed: 8, {kinds}, {pairs(gain__lag=coefficient)}}}")
    names = spec_with("{samples: 1}").plant.uncertain_names
    gain, lag, delay = (x[:, names.index(name)] for name in ("static_gain", "time_constant_s", "dead_time_s"))
    assert stats.kstest(gain, stats.beta(2, 3, 0.8, 0.4).cdf).pvalue > 1e-3
    assert stats.kstest(lag, stats.uniform(1.6, 1.5).cdf).pvalue > 1e-3
    rank = 6.0 / math.pi * math.asin(coefficient / 2.0)
    assert abs(spearman(gain, lag) - rank) < 0.01
    assert abs(spearman(gain, delay)) < 0.02


def test_numbers_that_are_not_correlated_keep_their_bits_and_pieces_are_the_whole() -> None:
    names = spec_with("{samples: 1}").plant.uncertain_names
    plain = drawn(f"{{samples: 3001, {NORMALS}}}")
    together = drawn(f"{{samples: 3001, {NORMALS}, {pairs(gain__lag=0.7)}}}")
    delay = names.index("dead_time_s")
    assert together[:, delay].tobytes() == plain[:, delay].tobytes()
    # of the pair the first that is drawn is what it was
    first, second = sorted(names.index(name) for name in ("static_gain", "time_constant_s"))
    assert together[:, first].tobytes() == plain[:, first].tobytes()
    assert not np.isclose(together[:, second], plain[:, second]).any()
    spec = spec_with(f"{{samples: 3001, {NORMALS}, {pairs(gain__lag=0.7)}}}")
    assert spec.validation is not None
    plan = sampling_plan_of(spec.validation)
    cuts = [0, 1, 2, 7, 1024, 3001]
    parts = [sample_points(plan, spec.plant, a, b - a) for a, b in itertools.pairwise(cuts)]
    assert np.concatenate(parts).tobytes() == together.tobytes()


def test_the_cube_is_never_left() -> None:
    ends = np.array([2.0**-54, 0.5, 1.0 - 2.0**-53])
    corners = np.array(np.meshgrid(ends, ends, ends)).reshape(3, -1).T
    told = [Correlation(("a", "b"), 0.6), Correlation(("b", "c"), 0.6), Correlation(("a", "c"), 0.6)]
    found = correlated(corners, "abc", told)
    assert ((found > 0.0) & (found < 1.0)).all()


def test_evidence_says_the_correlations() -> None:
    spec = spec_with(f"{{samples: 300, {NORMALS}, {pairs(gain__lag=0.6)}}}")
    gains = ft.FoPi(0.44651, 0.37033, 0.83197)
    told = to_document(monte_carlo(spec, gains, implementation_of(spec, gains)))["drawn"]
    assert told["correlations"] == [{"numbers": ["static_gain", "time_constant_s"], "coefficient": 0.6}]
    assert told["outside_the_family"] > 0


WRONG = [
    (
        "[{numbers: [static_gain, time_constant], coefficient: 0.5}]",
        "correlations[0].numbers[1]: 'time_constant' is no number",
    ),
    ("[{numbers: [static_gain, static_gain], coefficient: 0.5}]", "'static_gain' is there twice; write two uncertain"),
    ("[{numbers: [static_gain], coefficient: 0.5}]", "the list has 1 entry; write a list of 2 entries"),
    ("[{numbers: [static_gain, time_constant_s], coefficient: 1}]", "1 is out of range; it must be"),
    ("[{numbers: [static_gain, time_constant_s]}]", "coefficient: the key is missing"),
    ("[]", "write a list of at least 1"),
    ("{static_gain: 0.5}", "a mapping is written where a list belongs"),
    (
        "[{numbers: [static_gain, time_constant_s], coefficient: 0.5}, "
        "{numbers: [time_constant_s, static_gain], coefficient: 0.4}]",
        "a pair of numbers has two correlations; write one",
    ),
    (
        "[{numbers: [static_gain, time_constant_s], coefficient: 0.9}, "
        "{numbers: [time_constant_s, dead_time_s], coefficient: 0.9}]",
        "these correlations cannot hold together",
    ),
]


@pytest.mark.parametrize(("written", "words"), WRONG)
def test_wrong_correlations_are_refused_at_their_place(written: str, words: str) -> None:
    with pytest.raises(SpecError) as caught:
        spec_with(f"{{correlations: {written}}}")
    (problem,) = (str(each) for each in caught.value.problems)
    assert problem.startswith("<spec>:12:")
    assert words in problem


def test_rows_of_a_file_and_lists_have_no_correlations() -> None:
    text = SPEC.replace("VALIDATION", f"{{samples_file: f.csv, {pairs(gain__lag=0.6)}}}")
    rows = b"static_gain,time_constant_s,dead_time_s\n1,2,0.2\n"
    with pytest.raises(SpecError, match="the plants are those of samples_file; remove this or samples_file"):
        parse_spec(text, files={"f.csv": rows})


def test_numbers_that_are_all_but_fixed_by_others_are_refused() -> None:
    with pytest.raises(DomainError, match="cannot hold together"):
        correlated(np.full((1, 2), 0.5), "ab", [Correlation(("a", "b"), 1.0 - 1e-9)])
    with pytest.raises(DomainError, match="not among the numbers"):
        correlated(np.full((1, 2), 0.5), "ab", [Correlation(("a", "c"), 0.5)])

"""Random families on samples with a controller; limits around the worst case by state space and eigenvalues."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable

import numpy as np
from cases.plants import spec_of
from oracles.sampled_families import badness, worst_of

from fopi_tune.core.controller import FoPid
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import is_stable
from fopi_tune.errors import DomainError
from fopi_tune.proof import certify, recheck, verify
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
Asked = tuple[tuple[str, bool], ...]
#: draws a family with a controller and its filter
Draw = Callable[[np.random.Generator], tuple[PlantFamily, FoPid, Implementation]]


def design(seed: int, draw: Draw, salt: int, what: Asked = ASKED) -> tuple[DesignSpec, FoPid, Implementation]:
    """Stable at the corners in most cases, with one or two uncertain numbers; the limit is not set yet."""
    rng = np.random.default_rng([seed, salt])
    plants, pid, implementation = draw(rng)
    for _ in range(39):
        members = Plants.members(plants, plants.corners())
        if rng.random() < 0.05 or is_stable(SampledLoops.implemented(pid, implementation, members)).all():
            break
        plants, pid, implementation = draw(rng)
    name, upper = what[int(rng.integers(len(what)))]
    low, high, nyquist = 0.0, math.inf, implementation.nyquist_rad_s
    if QUANTITIES[name].takes_band and (name == "loop_gain_db" or not upper or rng.random() < 0.4):
        low = float(nyquist * 10.0 ** rng.uniform(-2.0, -0.5))
        high = math.inf if upper and rng.random() < 0.5 else low * float(rng.uniform(1.2, 3.0))
    asked = Requirement(name, Relation.AT_MOST if upper else Relation.AT_LEAST, (1.0,), Scope.FAMILY, low, high)
    return spec_of(plants, asked, name=f"seed_{seed}"), pid, implementation


def certificate_at(spec: DesignSpec, pid: FoPid, implementation: Implementation, natural: float) -> Certificate:
    """The certificate of the spec with its limit at this value; it must also stand on its own."""
    asked = spec.requirements[0]
    limit = QUANTITIES[asked.quantity].from_natural(natural)
    moved = Requirement(asked.quantity, asked.relation, (limit,), asked.scope, asked.from_rad_s, asked.to_rad_s)
    with_limit = spec_of(spec.plant, moved, name=spec.name)
    certificate = certify(with_limit, verify(with_limit, pid, implementation=implementation), {}, implementation)
    assert recheck(to_document(certificate)).problems == ()
    return certificate


def answer(seed: int, draw: Draw, salt: int, what: Asked = ASKED) -> str:
    """What became of a pair.

    Raises:
        AssertionError: a wrong proof or refutation, or a certificate that does not stand on its own.
    """
    spec, pid, implementation = design(seed, draw, salt, what)
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
    if beyond.requirements[0].verdict is Verdict.REFUTED:
        # the reference looks at few members: the certificate may have found a worse one
        (side,) = beyond.requirements[0].sides
        sign = 1.0 if asked.relation is Relation.AT_MOST else -1.0
        reached = badness(spec, implementation, np.array(side.worst.point, dtype=float), fine=True)
        assert reached > sign * (worst + step), (seed, "refuted beyond the worst case", worst, reached)
        return "worse found"
    verdicts = beyond.stability.verdict, beyond.requirements[0].verdict, short.requirements[0].verdict
    return "undecided" if Verdict.UNDECIDED in verdicts else "told apart"


def outcomes(seeds: Iterable[int], draw: Draw, salt: int, what: Asked = ASKED) -> tuple[Counter[str], list[int]]:
    """How many answers of each sort, and the undecided seeds."""
    said = {seed: answer(seed, draw, salt, what) for seed in seeds}
    return Counter(said.values()), [seed for seed, word in said.items() if word == "undecided"]

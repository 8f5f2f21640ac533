"""Random families with a controller, and limits 1e-5 around the worst case: which of them are proved."""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from cases.plants import spec_of
from oracles.dense_margins import UncertainError
from oracles.pid_loops import RESPONSES, PidFamily

from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.certificate import Certificate, Verdict
from fopi_tune.proof.documents import to_document
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import Relation, Requirement, Scope

#: distance of a limit from the worst value: neper, and relative of margins and slopes
OFFSET = 1e-5
#: natural units of a relative quantity below which the tolerance of 1e-6 decides
LEAST = 0.2
RELATIVE = ("phase_margin_deg", "delay_margin_s", "phase_slope_deg_per_decade")
#: quantities, and whether the limit is an upper one
ASKED = (
    *((name, True) for name in ("sensitivity_db", "complementary_sensitivity_db", "control_sensitivity_db")),
    *((name, True) for name in ("sensitivity_db", "control_sensitivity_db")),
    *((name, upper) for name in RESPONSES for upper in (True, False)),
    *((name, False) for name in ("phase_margin_deg", "gain_margin_db", "delay_margin_s") * 2),
    *((name, True) for name in ("phase_margin_deg", "gain_margin_db", "delay_margin_s")),
    *(("crossover_rad_s", upper) for upper in (True, False)),
    *(("phase_slope_deg_per_decade", upper) for upper in (True, False)),
)
Asked = tuple[tuple[str, bool], ...]
#: draws a family with a controller
Draw = Callable[[np.random.Generator], PidFamily]
#: s of process time for one pair
SLOW_S = 10.0


@dataclass(frozen=True)
class Pair:
    """A family with its PID, and one quantity in a band."""

    family: PidFamily
    quantity: str
    upper: bool
    low: float
    high: float

    def asked(self, natural: float) -> Requirement:
        """The requirement with its limit at this value."""
        relation = Relation.AT_MOST if self.upper else Relation.AT_LEAST
        limit = QUANTITIES[self.quantity].from_natural(natural)
        return Requirement(self.quantity, relation, (limit,), Scope.FAMILY, self.low, self.high)

    def certificate(self, natural: float) -> Certificate:
        """What is proved of this limit."""
        spec = spec_of(self.family.plants, self.asked(natural))
        return certify(spec, verify(spec, self.family.pid), {})

    @cached_property
    def worst(self) -> float:
        """The worst value over the family by the dense evaluation; nan where a plant has none."""
        return self.family.worst(lambda loop: loop.read(self.quantity, self.low, self.high, self.upper), self.upper)

    def value_at(self, point: tuple[float, ...]) -> float:
        """Of one plant by the dense evaluation; nan where it has none or is not stable."""
        loop = self.family.loop(np.array(point, dtype=float))
        return loop.read(self.quantity, self.low, self.high, self.upper) if loop.is_stable else math.nan


def pair(seed: int, draw: Draw, salt: int, asked: Asked = ASKED) -> Pair:
    """Nominally stable in most cases, as what is drawn at random is not."""
    rng = np.random.default_rng([seed, salt])
    family = draw(rng)
    for _ in range(11):
        if rng.random() < 0.06 or family.loop(family.plants.nominal_point).is_stable:
            break
        family = draw(rng)
    quantity, upper = asked[int(rng.integers(len(asked)))]
    low, high = 0.0, math.inf
    if QUANTITIES[quantity].takes_band and (quantity == "loop_gain_db" or not upper or rng.random() < 0.4):
        low = float(10.0 ** rng.uniform(-2.0, 0.5))
        high = low * float(10.0 ** rng.uniform(0.1, 1.5)) if not upper or rng.random() < 0.5 else math.inf
    late = float(family.plants.parameters["dead_time_s"].max)
    if quantity == "control_sensitivity_db" and late > 0.0 and rng.random() < 0.7:
        # far up |C S| ripples about |C|, which the dense evaluation follows turn by turn
        high = min(high, max(100.0 / late, 2.0 * low))
    return Pair(family, quantity, upper, low, high)


def answer(seed: int, draw: Draw, salt: int, rechecked: bool, what: Asked = ASKED) -> tuple[str, float]:
    """What became of a pair, and the process time of its certificates in s.

    Raises:
        AssertionError: a wrong proof or refutation, or a certificate that does not stand on its own.
    """
    try:
        asked = pair(seed, draw, salt, what)
        if not asked.family.is_stable():
            certificate = asked.certificate(1.0)
            assert certificate.stability.verdict is not Verdict.PROVED, seed
            return "unstable" if certificate.stability.verdict is Verdict.REFUTED else "undecided", 0.0
        worst = asked.worst
    except UncertainError:
        return "not told", 0.0
    # a margin that does not end, no crossover, a response next to 0
    if not math.isfinite(worst) or abs(worst) > 20.0 or (asked.quantity == "delay_margin_s" and worst <= 0.0):
        return "no value", 0.0
    step = OFFSET * (max(abs(worst), LEAST) if asked.quantity in RELATIVE else 1.0) * (1.0 if asked.upper else -1.0)
    if any(QUANTITIES[asked.quantity].check_limit(asked.asked(worst + s).limits[0]) for s in (step, -step)):
        return "no value", 0.0
    began = time.process_time()
    beyond, short = (asked.certificate(worst + s) for s in (step, -step))
    taken = time.process_time() - began
    if rechecked:
        for natural, certificate in ((worst + step, beyond), (worst - step, short)):
            document = json.loads(json.dumps(to_document(certificate), allow_nan=False))
            assert recheck(document).problems == (), (seed, natural)
    assert short.requirements[0].verdict is not Verdict.PROVED, (seed, "proved short of the worst case", worst)
    if beyond.requirements[0].verdict is Verdict.REFUTED:
        # the dense evaluation looks at few members: the certificate may have found a worse one
        (side,) = beyond.requirements[0].sides
        reached = asked.value_at(side.worst.point)
        is_worse = math.isnan(reached) or (reached > worst + step if asked.upper else reached < worst + step)
        assert is_worse, (seed, "refuted beyond the worst case", worst, reached)
        return "worse found", taken
    if Verdict.UNDECIDED in (beyond.requirements[0].verdict, short.requirements[0].verdict, beyond.stability.verdict):
        return "undecided", taken
    return "told apart", taken


def outcomes(
    seeds: Iterable[int], draw: Draw, salt: int, what: Asked = ASKED
) -> tuple[Counter[str], list[int], list[float]]:
    """How many answers of each sort, the undecided seeds, and the times of all pairs."""
    counted: Counter[str] = Counter()
    undecided, times = [], []
    for seed in seeds:
        said, taken = answer(seed, draw, salt, rechecked=seed % 4 == 0, what=what)
        counted[said] += 1
        undecided += [seed] if said == "undecided" else []
        times += [taken] if taken else []
    return counted, undecided, times

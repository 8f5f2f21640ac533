"""The proof:  time a requirement, mean-value forms against naive branching, proving against checking a certificate.

Run:  python benchmarks/certificate.py

Every requirement of the shipped specs, and the reference of a lag (peak |S| at gap 1e-6), is proved from a verification
that is already there.  The naive branching tests the same closed form on the same boxes, by its value over the box
alone.
"""

from __future__ import annotations

import json
import math
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from flint import ctx

from fopi_tune.core.controller import FoPi
from fopi_tune.core.peaks import Response
from fopi_tune.design import design
from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.balls.box import Box, ball_of, is_tail
from fopi_tune.proof.balls.loop import PRECISION, BallLoop
from fopi_tune.proof.claims.bound import Bound
from fopi_tune.proof.claims.branch_and_bound import search
from fopi_tune.proof.claims.claim import HOLDS, BoxVerdict, Claim
from fopi_tune.proof.claims.lag import LagBound, closed_form
from fopi_tune.proof.documents import to_document
from fopi_tune.report.text.formatting import requirement_phrase
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import DesignSpec

_SPECS = Path(__file__).parents[1] / "specs"
_REPEATS = 5
#: a lag with PM 75 deg at 0.3 rad/s; its peak |S| over the brake's family
_REFERENCE, _PEAK = FoPi(0.24027, 0.39344, 0.9), 1.1637074769


@dataclass(frozen=True)
class Naive(Claim):
    """|S| <= M for |S|^2 = (1 + x^2)/(A^2 + (x + b)^2), from its range over a box of omega and tau alone."""

    claim: LagBound

    @property
    def domain(self) -> Box:  # pyright: ignore[reportIncompatibleVariableOverride]
        """As the claim's."""
        return self.claim.general.domain

    @property
    def origin(self) -> float:  # pyright: ignore[reportIncompatibleVariableOverride]
        """As the claim's."""
        return self.claim.origin

    def examine(self, box: Box) -> BoxVerdict:
        """By the enclosures of A, b and x."""
        if is_tail(box[0]):
            return HOLDS if self.claim.general.examine(box).leaf else BoxVerdict(None, 0)
        loop, square = self.claim.general.loop, math.exp(2 * self.claim.general.level)
        u, tau = ball_of(box[0]), ball_of(box[1])
        c, x = loop.controller(u)[0], u.exp() * tau
        a, b = 1 + c.real, c.imag
        if square * (a * a + (x + b) * (x + b)) >= 1 + x * x:
            return HOLDS
        wide = (box[0][1] - box[0][0], (box[1][1] - box[1][0]) / box[1][1])
        return BoxVerdict(None, 0 if wide[0] >= wide[1] else 1)


def milliseconds(run: Callable[[], object]) -> float:
    """Median of a few runs."""
    times = []
    for _ in range(_REPEATS):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return 1e3 * statistics.median(times)


def each_requirement(name: str, gains: FoPi | None = None) -> None:
    """Time every requirement of a spec by itself."""
    spec = load_spec(_SPECS / f"{name}.yaml")
    gains = design(spec).gains if gains is None else gains
    assert gains is not None
    # stability's part of a certificate is what an empty list of requirements costs
    nothing = replace(spec, requirements=())
    stability = _certify_ms(nothing, gains)
    print(f"{name}: {len(spec.plant.uncertain_names)} uncertain numbers; stability alone {stability:.1f} ms")
    for requirement in spec.requirements:
        one = replace(spec, requirements=(requirement,))
        proof = certify(one, verify(one, gains), {}).requirements[0]
        took = _certify_ms(one, gains) - stability
        gap = "endless" if proof.gap is None else f"gap {proof.gap:.1e}"
        boxes = sum(side.boxes for side in proof.sides)
        print(
            f"  {requirement_phrase(requirement):<42}{proof.verdict.value:<9}{gap:<13}{boxes:>6} boxes{took:>9.1f} ms"
        )


def _certify_ms(spec: DesignSpec, gains: FoPi) -> float:
    found = verify(spec, gains)
    return milliseconds(lambda: certify(spec, found, {}))


def mean_value_against_naive() -> None:
    """The reference at shrinking gaps."""
    loop = BallLoop(_REFERENCE, load_spec(_SPECS / "brake.yaml").plant)
    domain = ((-math.inf, math.inf), *loop.family_box)
    print("peak |S| of the reference lag       closed form           generic             naive")
    with ctx.workprec(PRECISION):
        for gap in (1e-2, 1e-4, 1e-6):
            bound = Bound(loop, Response.SENSITIVITY, math.log(_PEAK) + gap, True, domain, math.log(0.3))
            form = closed_form(bound)
            assert isinstance(form, LagBound)
            columns = []
            for claim in (form, bound, Naive(form)):
                found = search(claim, 3_000_000)
                assert found.shown
                took = (
                    milliseconds(lambda claim=claim: search(claim, 3_000_000)) if found.boxes < 50_000 else _once(claim)
                )
                columns.append((found.boxes, took))
            cells = "".join(f"{boxes:>8} {took:>8.1f} ms" for boxes, took in columns)
            print(f"  gap {gap:.0e}           {cells}   naive / closed form: {columns[2][1] / columns[0][1]:.0f} x")


def _once(claim: Claim) -> float:
    start = time.perf_counter()
    search(claim, 3_000_000)
    return 1e3 * (time.perf_counter() - start)


def proving_against_checking(name: str) -> None:
    """From the gains to the certificate, and from the certificate's file to the answer."""
    spec = load_spec(_SPECS / f"{name}.yaml")
    gains = design(spec).gains
    assert gains is not None
    text = json.dumps(to_document(certify(spec, verify(spec, gains), {})))
    proving = milliseconds(lambda: certify(spec, verify(spec, gains), {}))
    checking = milliseconds(lambda: recheck(json.loads(text), spec))
    print(f"  {name:<22}proving {proving:8.1f} ms   checking {checking:7.1f} ms   {proving / checking:.1f} x")


def main() -> None:
    """Print the three tables."""
    each_requirement("brake", _REFERENCE)
    for name in ("brake", "brake_delay", "second_order", "lag_gain_and_delay"):
        each_requirement(name)
    mean_value_against_naive()
    print("a certificate")
    for path in sorted(_SPECS.glob("*.yaml")):
        proving_against_checking(path.stem)


if __name__ == "__main__":
    main()

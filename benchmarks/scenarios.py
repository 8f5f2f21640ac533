"""Designs for scenarios against differential evolution on simulations:  python benchmarks/scenarios.py [FIRST LAST]

Processor time of a design in a warm process, and whether its objective is the best.  The reference knows no derivative,
no convex step and no search of this package: SciPy's differential evolution and simplex on the compiled simulation of a
few plants, with the loop's requirements from `core/`.  The verification judges both.
"""

from __future__ import annotations

import itertools
import math
import statistics
import sys
import time
from pathlib import Path

import numpy as np
from scipy.optimize import differential_evolution, minimize

sys.path.insert(0, str(Path(__file__).parent / "specs"))

from generate_scenarios import spec_text  # pyright: ignore[reportMissingImports]

from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.core.loops import Plants
from fopi_tune.core.margins import phase_margins
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import unstable_poles_from
from fopi_tune.design.time_domain import design_for_scenarios
from fopi_tune.digital.implementation import designed_implementation, implementation_of
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import DomainError
from fopi_tune.proof import verify
from fopi_tune.results.status import Status
from fopi_tune.simulation.measures import horizon_of, measure_values, scenario_of
from fopi_tune.simulation.sampled.simulate import measure
from fopi_tune.simulation.scenario import Mode
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

DB = 20.0 / math.log(10.0)
#: relative: what counts as as good
SAME = 1e-3


class Reference:
    """The merit of gains, by simulation of vertices and a coarse grid of the box."""

    def __init__(self, spec: DesignSpec) -> None:
        self.spec, family = spec, spec.plant
        shares = itertools.product(np.linspace(0.0, 1.0, 9 if len(family.low) == 1 else 4), repeat=len(family.low))
        grid = family.low + np.array(list(shares)) * (family.high - family.low)
        self.plants = Plants.members(family, np.vstack([family.nominal_point[None, :], grid]))
        any_filter = implementation_of(spec, FoPi(1.0, 0.0, 1.0))
        self.runs = {each.name: (each, scenario_of(each, any_filter, 0)) for each in spec.scenarios}

    def merit(self, gains: FoPi) -> float:
        """The objective, and what is missed as a penalty."""
        spec = self.spec
        assert spec.digital is not None
        assert spec.objective is not None
        try:
            implementation = implementation_of(spec, gains)
            controller = Runtime.of(implementation.sections, Precision.FLOAT64, spec.digital.output_limits)
        except DomainError:
            return 1e12
        mode = [Mode(controller, self.plants)]
        found = {name: measure(mode, run, horizon_of(each, run), threads=1) for name, (each, run) in self.runs.items()}
        missed = 0.0
        for limit in spec.scenario_requirements:
            value = float(measure_values(found[limit.scenario or ""], limit.measure, "").max())
            missed = max(missed, (value - limit.limit) / (abs(limit.limit) or 1.0))
        aim = float(measure_values(found[spec.objective.scenario or ""], spec.objective.quantity, "").max())
        if not (math.isfinite(aim) and math.isfinite(missed)):
            return 1e12
        loops = SampledLoops.implemented(gains, implementation, self.plants)
        crossings = gain_crossovers(loops)
        if np.any(unstable_poles_from(loops, crossings) > 0.5):
            return 1e11
        for each in spec.requirements:
            if each.quantity == "sensitivity_db":
                peak = float(extremes(loops, Response.SENSITIVITY, 0.0, math.inf).value.max()) * DB
                missed = max(missed, (peak - each.upper) / 20.0)
            else:
                margin = math.degrees(float(phase_margins(loops, crossings).value.min()))
                missed = max(missed, (each.lower - margin) / 60.0)
        return aim if missed <= 1e-7 else aim * (1.02 + 1e4 * missed)

    def best(self, seed: int) -> FoPi:
        """The best gains found."""
        box = self.spec.controller
        low = np.log([box.kp.max * 1e-5, box.ki.max * 1e-6])
        bounds = [*zip(low, np.log([box.kp.max, box.ki.max]), strict=True), (box.alpha.min, box.alpha.max)]

        def gains(u: np.ndarray) -> FoPi:
            return FoPi(math.exp(u[0]), math.exp(u[1]), float(np.clip(u[2], box.alpha.min, box.alpha.max)))

        found = differential_evolution(
            lambda u: self.merit(gains(u)), bounds, rng=seed, popsize=12, maxiter=30, polish=False, init="sobol"
        )
        x = found.x
        for edge in (0.08, -0.05, 0.02):
            corners = np.vstack([x, *(x + edge * np.diag([1.0, 1.0, 0.5]))])
            x = minimize(
                lambda u: self.merit(gains(u)), x, method="Nelder-Mead",
                options={"maxfev": 200, "initial_simplex": corners},
            ).x  # fmt: skip
        return gains(x)


def judged(spec: DesignSpec, gains: FoPi) -> float | None:
    """The objective that the verification finds; None where something is missed."""
    found = verify(spec, gains, 1e-5, designed_implementation(spec, gains))
    return found.objective if found.all_met else None


def main() -> None:
    """Design each seed and compare."""
    first, last = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (0, 12)
    seconds, as_good, compared = [], 0, 0
    for seed in range(first, last):
        spec = parse_spec(spec_text(seed))
        design_for_scenarios(spec)
        begin = time.process_time()
        found = design_for_scenarios(spec)
        seconds.append(time.process_time() - begin)
        solved = found.gains if found.status is Status.SOLVED else None
        own = None if solved is None else judged(spec, solved)
        begin = time.process_time()
        other = judged(spec, Reference(spec).best(seed))
        took = time.process_time() - begin
        worse = None if own is None or other is None else (own - other) / abs(other)
        compared += other is not None
        as_good += worse is not None and worse <= SAME
        told = "-" if worse is None else f"{worse:+.1e}"
        print(
            f"{seed:>4} {found.status.value:<11}{own!s:>22} {other!s:>22} {told:>9} {seconds[-1]:6.2f} s {took:6.1f} s",
            flush=True,
        )
    print(f"{len(seconds)} specs, median {statistics.median(seconds):.2f} s; as good: {as_good} of {compared}")


if __name__ == "__main__":
    main()

"""Cold designs in a warm process, and whether they are the best there are:  the specs of `benchmarks/specs/`.

Run:  python benchmarks/design.py [FIRST LAST] [--no-reference]     seeds, 0 to 63 when left out

A design is cold when nothing of its spec was computed before; the process is warm when Numba and CasADi have compiled
what all specs share.  Gains count only when the verification finds every requirement met.  The reference
(`reference.py`) shares no table and no solver with the search; a loss is an objective that is worse by 0.01 %.
"""

from __future__ import annotations

import statistics
import sys
import time
import warnings
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT / "benchmarks" / "specs")]

from generate import COUNT, spec_text  # noqa: E402  # pyright: ignore[reportMissingImports]
from reference import reference  # noqa: E402

from fopi_tune.design import design  # noqa: E402
from fopi_tune.proof import verify  # noqa: E402
from fopi_tune.results.candidate import Candidate  # noqa: E402
from fopi_tune.results.status import Status  # noqa: E402
from fopi_tune.spec import load_spec, parse_spec  # noqa: E402
from fopi_tune.spec.model import DesignSpec  # noqa: E402

#: relative, and what it is relative to at least: an objective of 0 has no size
_LOSS, _LEAST = 1e-4, 1e-6


def measured(spec: DesignSpec) -> tuple[float, float, Candidate, float | None]:
    """Milliseconds of processor time without and with the bound of what is possible, the candidate of the latter, and
    its objective where the verification accepts it."""
    start = time.process_time()
    design(spec)
    middle = time.process_time()
    candidate = design(spec, bracket=True)
    end = time.process_time()
    judged = None if candidate.gains is None else verify(spec, candidate.gains)
    found = judged.objective if judged is not None and judged.all_met else None
    return 1e3 * (middle - start), 1e3 * (end - middle), candidate, found


def compared(spec: DesignSpec, found: float | None) -> str:
    """`equal`, `better`, or `LOSS` and by how much, of an objective against the reference."""
    _, best = reference(spec)
    if best is None or found is None:
        return "LOSS: the reference has gains" if best is not None else "nothing in the reference"
    sign = -1.0 if spec.objective is not None and spec.objective.sense.value == "maximize" else 1.0
    worse = sign * (found - best) / max(abs(best), _LEAST)
    return f"LOSS {worse:.1e}" if worse > _LOSS else f"better by {-worse:.1e}" if worse < -_LOSS else "equal"


def main() -> None:
    """Measure and print."""
    warnings.simplefilter("ignore")  # the reference divides by zero at the ends of its grid
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    first, last = numbers if len(numbers) == 2 else (0, COUNT - 1)
    shipped = [load_spec(path) for path in sorted((ROOT / "specs").glob("*.yaml"))]
    drawn = [parse_spec(spec_text(seed)) for seed in range(first, last + 1)]
    for spec in (*shipped, *drawn[:7]):
        design(spec)  # compiles what is shared
    words = []
    for title, specs in (("shipped", shipped), ("random", drawn)):
        times, bounded, gaps = [], [], []
        for spec in specs:
            spent, with_bound, candidate, objective = measured(spec)
            times.append(spent)
            bounded.append(with_bound)
            if candidate.status is Status.SOLVED:
                gaps.append(candidate.gap)
            word = "" if "--no-reference" in sys.argv or title == "shipped" else compared(spec, objective)
            words += [word] if word else []
            gap = "" if candidate.gap is None else f"gap {100 * candidate.gap:g} %"
            print(
                f"{spec.name:24}{candidate.status.value:12}{spent:8.0f} ms {with_bound:8.0f} ms  {gap:12}{word}",
                flush=True,
            )
        closed = sum(gap is not None and gap <= 1e-3 for gap in gaps)
        ninth = sorted(times)[int(0.9 * (len(times) - 1))]
        print(
            f"{title}: {len(specs)} specs, median {statistics.median(times):.0f} ms, 90 % {ninth:.0f} ms; "
            f"with the bound median {statistics.median(bounded):.0f} ms; "
            f"solved {len(gaps)}, of them {closed} within 0.1 % of what is possible"
        )
    if words:
        judged = [word for word in words if not word.startswith("nothing")]
        lost = sum(word.startswith("LOSS") for word in judged)
        print(f"against the reference: {len(judged) - lost} of {len(judged)} within 0.01 %")


if __name__ == "__main__":
    main()

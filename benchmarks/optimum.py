"""The bound of the best gains:  boxes and time to a proven gap, and of infeasible specs to the proof that they are.

Run:  python benchmarks/optimum.py [FIRST LAST]

With seeds the specs of `specs/generate.py` instead: how many are proved to 0.1 % within 20 s of processor time each.

Ball arithmetic included.  Seconds are of the processor (one thread); checking tests every leaf of the file again.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from pathlib import Path

from specs.generate import spec_text

from fopi_tune.optimum import Optimum, OptimumStatus, certify_optimum, recheck_optimum, to_document
from fopi_tune.optimum.pruning.conditions import kind_of
from fopi_tune.pipeline.tune import tune
from fopi_tune.spec import load_spec, parse_spec
from fopi_tune.spec.model import DesignSpec

_SPECS = Path(__file__).parents[1] / "specs"
_LIMIT_S, _SHORT_S = 600.0, 20.0
#: spec, place of the requirement whose limit is moved, and where to
_INFEASIBLE = (
    ("brake", 2, 84.0),
    ("pi_baseline", 2, 81.5),
    ("brake_delay", 0, 110.0),
    ("brake_delay", 2, 0.4),
    ("brake_delay", 3, -42.0),
)


def main() -> None:
    """Print a line a spec and gap."""
    print("spec                  gap   outcome         boxes  leaves  certifying    checking")
    for path in sorted(_SPECS.glob("*.yaml")):
        spec = load_spec(path)
        design = tune(spec, proof=False)
        fixed = sum(requirement.relation.value == "equals" for requirement in spec.requirements) == 2
        for gap in (1e-2, 1e-3, 1e-4) if fixed else (1e-2, 1e-3):
            start = time.process_time()
            found = certify_optimum(spec, design.gains, gap=gap, time_limit_s=_LIMIT_S)
            _line(spec, f"{gap:.0e}", found, time.process_time() - start)
    print("one limit moved until nothing is feasible")
    for name, place, limit in _INFEASIBLE:
        spec = load_spec(_SPECS / f"{name}.yaml")
        requirements = list(spec.requirements)
        requirements[place] = replace(requirements[place], limits=(limit,))
        spec = replace(spec, requirements=tuple(requirements))
        start = time.process_time()
        _line(spec, "", certify_optimum(spec, None, time_limit_s=_LIMIT_S), time.process_time() - start)


def generated(first: int, last: int) -> None:
    """Print a line a generated spec, and how many are proved."""
    time.monotonic = time.process_time  # the limit is one of this process, whatever else the machine does
    proved = {True: [0, 0], False: [0, 0]}
    for seed in range(first, last + 1):
        spec = parse_spec(spec_text(seed))
        design = tune(spec, proof=False)
        feasible = design.gains is not None and design.status.value == "solved"
        start = time.process_time()
        found = certify_optimum(spec, design.gains if feasible else None, time_limit_s=_SHORT_S)
        proved[feasible][0] += found.status in (OptimumStatus.CERTIFIED, OptimumStatus.INFEASIBLE)
        proved[feasible][1] += 1
        _line(spec, kind_of(spec).value[:6], found, time.process_time() - start)
    for feasible, (done, count) in proved.items():
        print(f"{'feasible' if feasible else 'infeasible'}: {done} of {count} proved")


def _line(spec: DesignSpec, gap: str, found: Optimum, seconds: float) -> None:
    document = json.loads(json.dumps(to_document(found, {})))
    start = time.process_time()
    sound = recheck_optimum(document, spec).is_sound
    checking = time.process_time() - start
    leaves = found.proof.leaves if found.proof else 0
    word = found.status.value if sound else "refused"
    print(
        f"{spec.name:<20}{gap:>6}   {word:<14}{found.boxes:>7}{leaves:>8}{seconds:>10.2f} s{checking:>10.2f} s",
        flush=True,
    )


if __name__ == "__main__":
    generated(*map(int, sys.argv[1:3])) if len(sys.argv) > 2 else main()

"""The bound of the best gains:  boxes and time to a proven gap, and of infeasible specs to the proof that they are.

Run:  python benchmarks/optimum.py

Ball arithmetic included.  Seconds are of the processor (one thread); checking tests every leaf of the file again.
"""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

from fopi_tune.optimum import Optimum, certify_optimum, recheck_optimum, to_document
from fopi_tune.pipeline.tune import tune
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import DesignSpec

_SPECS = Path(__file__).parents[1] / "specs"
_LIMIT_S = 600.0
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
    main()

"""Two sampled loops that take turns, proved to settle or to cycle:  SystemSpec, gains -> SystemCertificate.

`model` and `sample_map` are the loop in balls, `saturated_loop` one loop with its limits, `entries` and `settling` the
proof that nothing switches any more, `cycles` periodic orbits, `bounded` what holds under any switching; files that end
in `_search` find what these verify.
"""

from fopi_tune.proof.switched.certificate import SystemCertificate, SystemVerdict
from fopi_tune.proof.switched.prove import prove_system
from fopi_tune.proof.switched.recheck import SystemRecheck, recheck_system

__all__ = ["SystemCertificate", "SystemRecheck", "SystemVerdict", "prove_system", "recheck_system"]

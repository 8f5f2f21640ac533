"""Robust design of PI, PID and fractional-order controllers:  a spec in, proved gains out.

    import fopi_tune as ft
    design = ft.tune("specs/brake.yaml")

Importing this package imports no solver and no plotting library: names are loaded when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fopi_tune.core.controller import FoPi, FoPid, Pid
    from fopi_tune.core.families.plant_list import PlantList, PlantMember
    from fopi_tune.core.margins import Margins, margins
    from fopi_tune.core.plant import Plant, PlantFamily, Uncertain
    from fopi_tune.core.terms.measurement_filter import MeasurementFilter
    from fopi_tune.errors import CertificateError, DomainError, FopiError, SpecError
    from fopi_tune.identification import Identified, identify
    from fopi_tune.optimum import Optimum, OptimumRecheck, OptimumStatus
    from fopi_tune.pipeline.discretize import discretize, discretize_system
    from fopi_tune.pipeline.optimum import certify_optimum, recheck_optimum
    from fopi_tune.pipeline.price import price, tradeoff
    from fopi_tune.pipeline.prove import prove, recheck
    from fopi_tune.pipeline.prove_system import prove_system, recheck_system
    from fopi_tune.pipeline.run import run
    from fopi_tune.pipeline.simulate import simulate
    from fopi_tune.pipeline.systems import simulate_system, validate_system
    from fopi_tune.pipeline.tune import tune
    from fopi_tune.pipeline.tune_system import tune_system
    from fopi_tune.pipeline.validate import validate
    from fopi_tune.prices import Tradeoff
    from fopi_tune.proof import Certificate, Recheck, Verdict, Verification
    from fopi_tune.proof.switched import SystemCertificate, SystemRecheck, SystemVerdict
    from fopi_tune.results.candidate import Solver
    from fopi_tune.results.design import Check, Design, Discretized, Run, Validated
    from fopi_tune.results.proved_system import ProvedSystem
    from fopi_tune.results.simulation import Simulated
    from fopi_tune.results.status import Status
    from fopi_tune.results.system import DiscretizedSystem, SimulatedSystem, ValidatedSystem
    from fopi_tune.results.system_design import DesignedSystem
    from fopi_tune.spec import load_spec, load_system, parse_spec
    from fopi_tune.spec.model import DesignSpec, SystemSpec

__version__ = "0.1.0"

#: public name -> module
_PUBLIC = {
    "Certificate": "fopi_tune.proof",
    "CertificateError": "fopi_tune.errors",
    "Check": "fopi_tune.results.design",
    "Design": "fopi_tune.results.design",
    "DesignSpec": "fopi_tune.spec.model",
    "DesignedSystem": "fopi_tune.results.system_design",
    "Discretized": "fopi_tune.results.design",
    "DiscretizedSystem": "fopi_tune.results.system",
    "DomainError": "fopi_tune.errors",
    "FoPi": "fopi_tune.core.controller",
    "FoPid": "fopi_tune.core.controller",
    "FopiError": "fopi_tune.errors",
    "Identified": "fopi_tune.identification",
    "Margins": "fopi_tune.core.margins",
    "MeasurementFilter": "fopi_tune.core.terms.measurement_filter",
    "Optimum": "fopi_tune.optimum",
    "OptimumRecheck": "fopi_tune.optimum",
    "OptimumStatus": "fopi_tune.optimum",
    "Pid": "fopi_tune.core.controller",
    "Plant": "fopi_tune.core.plant",
    "PlantFamily": "fopi_tune.core.plant",
    "PlantList": "fopi_tune.core.families.plant_list",
    "PlantMember": "fopi_tune.core.families.plant_list",
    "ProvedSystem": "fopi_tune.results.proved_system",
    "Recheck": "fopi_tune.proof",
    "Run": "fopi_tune.results.design",
    "Simulated": "fopi_tune.results.simulation",
    "SimulatedSystem": "fopi_tune.results.system",
    "SpecError": "fopi_tune.errors",
    "Solver": "fopi_tune.results.candidate",
    "Status": "fopi_tune.results.status",
    "SystemCertificate": "fopi_tune.proof.switched",
    "SystemRecheck": "fopi_tune.proof.switched",
    "SystemSpec": "fopi_tune.spec.model",
    "SystemVerdict": "fopi_tune.proof.switched",
    "Tradeoff": "fopi_tune.prices.result",
    "Uncertain": "fopi_tune.core.plant",
    "Validated": "fopi_tune.results.design",
    "ValidatedSystem": "fopi_tune.results.system",
    "Verdict": "fopi_tune.proof",
    "Verification": "fopi_tune.proof",
    "certify_optimum": "fopi_tune.pipeline.optimum",
    "discretize": "fopi_tune.pipeline.discretize",
    "discretize_system": "fopi_tune.pipeline.discretize",
    "identify": "fopi_tune.identification",
    "load_spec": "fopi_tune.spec",
    "load_system": "fopi_tune.spec",
    "margins": "fopi_tune.core.margins",
    "parse_spec": "fopi_tune.spec",
    "price": "fopi_tune.pipeline.price",
    "prove": "fopi_tune.pipeline.prove",
    "prove_system": "fopi_tune.pipeline.prove_system",
    "recheck": "fopi_tune.pipeline.prove",
    "recheck_optimum": "fopi_tune.pipeline.optimum",
    "recheck_system": "fopi_tune.pipeline.prove_system",
    "run": "fopi_tune.pipeline.run",
    "simulate": "fopi_tune.pipeline.simulate",
    "simulate_system": "fopi_tune.pipeline.systems",
    "tradeoff": "fopi_tune.pipeline.price",
    "tune": "fopi_tune.pipeline.tune",
    "tune_system": "fopi_tune.pipeline.tune_system",
    "validate": "fopi_tune.pipeline.validate",
    "validate_system": "fopi_tune.pipeline.systems",
}

__all__ = [
    "Certificate",
    "CertificateError",
    "Check",
    "Design",
    "DesignSpec",
    "DesignedSystem",
    "Discretized",
    "DiscretizedSystem",
    "DomainError",
    "FoPi",
    "FoPid",
    "FopiError",
    "Identified",
    "Margins",
    "MeasurementFilter",
    "Optimum",
    "OptimumRecheck",
    "OptimumStatus",
    "Pid",
    "Plant",
    "PlantFamily",
    "PlantList",
    "PlantMember",
    "ProvedSystem",
    "Recheck",
    "Run",
    "Simulated",
    "SimulatedSystem",
    "Solver",
    "SpecError",
    "Status",
    "SystemCertificate",
    "SystemRecheck",
    "SystemSpec",
    "SystemVerdict",
    "Tradeoff",
    "Uncertain",
    "Validated",
    "ValidatedSystem",
    "Verdict",
    "Verification",
    "certify_optimum",
    "discretize",
    "discretize_system",
    "identify",
    "load_spec",
    "load_system",
    "margins",
    "parse_spec",
    "price",
    "prove",
    "prove_system",
    "recheck",
    "recheck_optimum",
    "recheck_system",
    "run",
    "simulate",
    "simulate_system",
    "tradeoff",
    "tune",
    "tune_system",
    "validate",
    "validate_system",
]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        return getattr(import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_PUBLIC])

"""Robust design of PI, PID and fractional-order controllers:  a spec in, proved gains out.

    import fopi_tune as ft
    design = ft.tune("specs/brake.yaml")

Importing this package imports no solver and no plotting library: names are loaded when they are first used.
`logging.basicConfig(level="INFO")` shows what stages do, and how far they are.
"""

import logging
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
    from fopi_tune.results.stored.load import Stored, StoredLoop, load
    from fopi_tune.results.system import DiscretizedSystem, SimulatedSystem, ValidatedSystem
    from fopi_tune.results.system_design import DesignedSystem
    from fopi_tune.spec import load_spec, load_system, parse_spec
    from fopi_tune.spec.load import spec
    from fopi_tune.spec.model import DesignSpec, SystemSpec
    from fopi_tune.spec.python.plants import Lag, TransferFunction
    from fopi_tune.spec.python.requirements import (
        acceleration_m_s2,
        complementary_sensitivity_db,
        control_sensitivity_db,
        crossover_rad_s,
        delay_margin_s,
        final_error,
        gain_margin_db,
        iae,
        ise,
        load_sensitivity_db,
        loop_gain_db,
        overshoot,
        peak_control,
        peak_jerk_per_s2,
        peak_rate_per_s,
        phase_margin_deg,
        phase_slope_deg_per_decade,
        rise_time_s,
        saturation_time_s,
        sensitivity_db,
        settling_time_s,
        switch_count,
        undershoot,
    )

__version__ = "0.1.0"

# what stages do is logged below this name; nothing is shown until a program asks for it
logging.getLogger(__name__).addHandler(logging.NullHandler())

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
    "Lag": "fopi_tune.spec.python.plants",
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
    "Solver": "fopi_tune.results.candidate",
    "SpecError": "fopi_tune.errors",
    "Status": "fopi_tune.results.status",
    "Stored": "fopi_tune.results.stored.load",
    "StoredLoop": "fopi_tune.results.stored.load",
    "SystemCertificate": "fopi_tune.proof.switched",
    "SystemRecheck": "fopi_tune.proof.switched",
    "SystemSpec": "fopi_tune.spec.model",
    "SystemVerdict": "fopi_tune.proof.switched",
    "Tradeoff": "fopi_tune.prices.result",
    "TransferFunction": "fopi_tune.spec.python.plants",
    "Uncertain": "fopi_tune.core.plant",
    "Validated": "fopi_tune.results.design",
    "ValidatedSystem": "fopi_tune.results.system",
    "Verdict": "fopi_tune.proof",
    "Verification": "fopi_tune.proof",
    "acceleration_m_s2": "fopi_tune.spec.python.requirements",
    "certify_optimum": "fopi_tune.pipeline.optimum",
    "complementary_sensitivity_db": "fopi_tune.spec.python.requirements",
    "control_sensitivity_db": "fopi_tune.spec.python.requirements",
    "crossover_rad_s": "fopi_tune.spec.python.requirements",
    "delay_margin_s": "fopi_tune.spec.python.requirements",
    "discretize": "fopi_tune.pipeline.discretize",
    "discretize_system": "fopi_tune.pipeline.discretize",
    "final_error": "fopi_tune.spec.python.requirements",
    "gain_margin_db": "fopi_tune.spec.python.requirements",
    "iae": "fopi_tune.spec.python.requirements",
    "identify": "fopi_tune.identification",
    "ise": "fopi_tune.spec.python.requirements",
    "load_sensitivity_db": "fopi_tune.spec.python.requirements",
    "load": "fopi_tune.results.stored.load",
    "load_spec": "fopi_tune.spec",
    "load_system": "fopi_tune.spec",
    "loop_gain_db": "fopi_tune.spec.python.requirements",
    "margins": "fopi_tune.core.margins",
    "overshoot": "fopi_tune.spec.python.requirements",
    "parse_spec": "fopi_tune.spec",
    "peak_control": "fopi_tune.spec.python.requirements",
    "peak_jerk_per_s2": "fopi_tune.spec.python.requirements",
    "peak_rate_per_s": "fopi_tune.spec.python.requirements",
    "phase_margin_deg": "fopi_tune.spec.python.requirements",
    "phase_slope_deg_per_decade": "fopi_tune.spec.python.requirements",
    "price": "fopi_tune.pipeline.price",
    "prove": "fopi_tune.pipeline.prove",
    "prove_system": "fopi_tune.pipeline.prove_system",
    "recheck": "fopi_tune.pipeline.prove",
    "recheck_optimum": "fopi_tune.pipeline.optimum",
    "recheck_system": "fopi_tune.pipeline.prove_system",
    "rise_time_s": "fopi_tune.spec.python.requirements",
    "run": "fopi_tune.pipeline.run",
    "saturation_time_s": "fopi_tune.spec.python.requirements",
    "sensitivity_db": "fopi_tune.spec.python.requirements",
    "settling_time_s": "fopi_tune.spec.python.requirements",
    "simulate": "fopi_tune.pipeline.simulate",
    "simulate_system": "fopi_tune.pipeline.systems",
    "spec": "fopi_tune.spec",
    "switch_count": "fopi_tune.spec.python.requirements",
    "tradeoff": "fopi_tune.pipeline.price",
    "tune": "fopi_tune.pipeline.tune",
    "tune_system": "fopi_tune.pipeline.tune_system",
    "undershoot": "fopi_tune.spec.python.requirements",
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
    "Lag",
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
    "Stored",
    "StoredLoop",
    "SystemCertificate",
    "SystemRecheck",
    "SystemSpec",
    "SystemVerdict",
    "Tradeoff",
    "TransferFunction",
    "Uncertain",
    "Validated",
    "ValidatedSystem",
    "Verdict",
    "Verification",
    "acceleration_m_s2",
    "certify_optimum",
    "complementary_sensitivity_db",
    "control_sensitivity_db",
    "crossover_rad_s",
    "delay_margin_s",
    "discretize",
    "discretize_system",
    "final_error",
    "gain_margin_db",
    "iae",
    "identify",
    "ise",
    "load",
    "load_sensitivity_db",
    "load_spec",
    "load_system",
    "loop_gain_db",
    "margins",
    "overshoot",
    "parse_spec",
    "peak_control",
    "peak_jerk_per_s2",
    "peak_rate_per_s",
    "phase_margin_deg",
    "phase_slope_deg_per_decade",
    "price",
    "prove",
    "prove_system",
    "recheck",
    "recheck_optimum",
    "recheck_system",
    "rise_time_s",
    "run",
    "saturation_time_s",
    "sensitivity_db",
    "settling_time_s",
    "simulate",
    "simulate_system",
    "spec",
    "switch_count",
    "tradeoff",
    "tune",
    "tune_system",
    "undershoot",
    "validate",
    "validate_system",
]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        return getattr(import_module(_PUBLIC[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_PUBLIC])

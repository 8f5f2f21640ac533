"""Results of the stages:  Design, Check, Discretized, Validated and Run, each with its JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from fopi_tune.core.controller import FoPi, numbers_of
from fopi_tune.core.margins import Margins
from fopi_tune.errors import DomainError
from fopi_tune.proof.certificate import Certificate
from fopi_tune.proof.documents import to_document
from fopi_tune.proof.verification.results import Stability, Verification
from fopi_tune.results.documents import (
    finite,
    loop_name,
    margins_dict,
    objective_name,
    proof_dict,
    relaxation_dict,
    stability_dict,
)
from fopi_tune.results.equalities import equality_notes
from fopi_tune.results.measured import NO_PROOF, digital_notes, measured_notes
from fopi_tune.results.measures import MeasureReport, measure_reports, measures_dict
from fopi_tune.results.requirement_reports import RequirementReport, requirement_reports
from fopi_tune.results.saved import names
from fopi_tune.results.saved.files import json_file, spec_file
from fopi_tune.results.stamp import Stamp, certificate_versions
from fopi_tune.results.status import Relaxation, Status
from fopi_tune.results.verified.documents import RESULT_SCHEMA, verification_dict, verification_status
from fopi_tune.results.views.curves import LoopCurves
from fopi_tune.results.views.shown import Shown
from fopi_tune.spec.model import DesignSpec

if TYPE_CHECKING:
    from fopi_tune.digital import DigitalController
    from fopi_tune.digital.implementation import StepCost
    from fopi_tune.montecarlo.montecarlo import Evidence
    from fopi_tune.optimum.results import Optimum
    from fopi_tune.results.to_control import ControlObjects, SampledObjects


@dataclass(frozen=True, repr=False)
class Design(Shown, LoopCurves):
    """The result of tuning: gains, and what was verified and proved of them.

    Args:
        spec: the spec.
        status: `solved` only after every requirement was proved (verified, when no proof was wanted).
        gains: kp, ki, alpha; None when there are none.  Of an infeasible spec, those with the least relaxation.
        objective: value of the spec's objective, in its public unit, as the verification found it.
        requirements: in the order of the spec.
        stability: of the whole family; None without gains.
        nominal: margins with the nominal plant; None without gains.
        certificate: the proof; None without gains that pass the verification, and when it was not wanted.
        proof_wanted: False after --no-proof: `solved` then means verified only.
        clash: of an infeasible spec, the smallest set of requirements that clash, and by how much the limit of each
            can be relaxed so that the spec was found to be met.
        message: why, in words; empty when solved.
        stamp: provenance.
        solves: runs of the solver.
        optimum: what is proved of the best gains; None when not asked for.
        steady_state_error: dimensionless, the largest that a constant reference leaves over the family; None without
            stable gains.
        gap: relative; nothing that meets the requirements is better by more than this part of the objective, checked in
            floating point (`Candidate.gap`); None where that was not shown.
        notes: what a user should know besides the table: a default objective, a term that vanished, a gain at an end
            of its range.
        measures: requirements on measures of scenarios, in the order of the spec.
    """

    spec: DesignSpec
    status: Status
    gains: FoPi | None
    objective: float | None
    requirements: tuple[RequirementReport, ...]
    stability: Stability | None
    nominal: Margins | None
    certificate: Certificate | None
    proof_wanted: bool
    clash: tuple[Relaxation, ...]
    message: str
    stamp: Stamp
    solves: int
    optimum: Optimum | None = None
    steady_state_error: float | None = None
    gap: float | None = None
    notes: tuple[str, ...] = ()
    measures: tuple[MeasureReport, ...] = ()

    @property
    def advice(self) -> str:
        """What to do, in a sentence; relaxing a limit is advised only where that was confirmed."""
        if self.status is Status.INFEASIBLE and all(relaxation.new_limit is None for relaxation in self.clash):
            return "No gains were found that meet all requirements."
        return self.status.advice

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON."""
        return {
            "schema": RESULT_SCHEMA,
            "status": self.status.value,
            "gains": numbers_of(self.gains) if self.gains else None,
            "objective": finite(self.objective),
            "requirements": [report.to_dict() for report in self.requirements],
            "stamp": asdict(self.stamp),
            "name": self.spec.name,
            "loop": loop_name(self.spec),
            "objective_quantity": objective_name(self.spec),
            "message": self.message,
            "advice": self.advice,
            "steady_state_error": finite(self.steady_state_error),
            "gap": finite(self.gap),
            "notes": list(self.notes),
            "stability": stability_dict(self.stability),
            "nominal": margins_dict(self.nominal),
            "clash": [relaxation_dict(relaxation, self.spec) for relaxation in self.clash],
            "proof": proof_dict(self.certificate, self.proof_wanted, self.spec.is_measured),
            **measures_dict(self.measures),
            **({} if self.optimum is None else _of_optimum(self.optimum)),
        }

    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """As `Shown.data_files`."""
        yield from spec_file(self.spec)
        yield from json_file(names.CERTIFICATE, self.certificate_document())
        yield from json_file(names.OPTIMUM, self.optimum_document())
        yield from json_file(names.DESIGN, self.to_dict())

    def optimum_document(self) -> dict[str, Any] | None:
        """The JSON of what is proved of the best gains, with its boxes; None when that was not asked for."""
        if self.optimum is None:
            return None
        from fopi_tune.optimum.documents import to_document as optimum_to_document

        return optimum_to_document(self.optimum, certificate_versions())

    def certificate_document(self) -> dict[str, Any] | None:
        """The certificate's JSON; None without one."""
        return to_document(self.certificate) if self.certificate else None

    def to_control(self) -> ControlObjects:
        """The nominal plant, the controller (approximated: its order is fractional) and the loop as `control` objects.

        Raises:
            DomainError: there are no gains.
        """
        from fopi_tune.results.to_control import to_control

        return to_control(self.gains, self.spec.plant)


@dataclass(frozen=True, repr=False)
class Check(Shown):
    """The verification and the certificate of given gains against a spec: the result of `fopi prove`.

    Args:
        spec: the spec.
        verification: of the gains, in floating point.
        proof: the certificate; None of measured responses, of which there is no proof.
        stamp: provenance.
    """

    spec: DesignSpec
    verification: Verification
    proof: Certificate | None
    stamp: Stamp

    @property
    def status(self) -> str:
        """`met` (proved; measured responses: checked), `violated`, or `undecided` where something is open."""
        return verification_status(self.verification, self.proof)

    @property
    def certificate(self) -> Certificate:
        """The proof or refutation.

        Raises:
            DomainError: the plant is known by measured responses, of which there is none.
        """
        if self.proof is None:
            raise DomainError(NO_PROOF)
        return self.proof

    def certificate_document(self) -> dict[str, Any]:
        """The certificate's JSON.

        Raises:
            DomainError: as `certificate`.
        """
        return to_document(self.certificate)

    @property
    def reports(self) -> tuple[RequirementReport, ...]:
        """The requirements, each with its result and its proof."""
        return requirement_reports(self.verification, self.proof, self.spec.is_measured)

    @property
    def measures(self) -> tuple[MeasureReport, ...]:
        """The requirements on measures of scenarios, each with its result."""
        return measure_reports(self.spec.scenario_requirements, self.verification.measures, certificate=self.proof)

    @property
    def notes(self) -> tuple[str, ...]:
        """By how much equalities are missed, and what measured responses leave open."""
        return (*equality_notes(self.verification.requirements), *measured_notes(self.spec, self.verification.gains))

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON, shaped as a design's."""
        return verification_dict(self.spec, self.verification, self.proof, self.stamp)

    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """As `Shown.data_files`."""
        yield from spec_file(self.spec)
        yield from json_file(names.CERTIFICATE, to_document(self.proof) if self.proof else None)
        yield from json_file(names.CHECK, self.to_dict())


@dataclass(frozen=True, repr=False)
class Discretized(Shown):
    """The digital controller of a spec, and the checks of the loop on samples: the result of `fopi discretize`.

    Args:
        spec: the spec.
        controller: the filter, with its measured errors.
        verification: of the loop with the filter, the hold and the delays.
        certificate: of the same loop; None when it was not wanted.
        stamp: provenance.
    """

    spec: DesignSpec
    controller: DigitalController
    verification: Verification
    certificate: Certificate | None
    stamp: Stamp

    @property
    def status(self) -> str:
        """`met`, `violated` or `undecided`, of the loop on samples; without a certificate by the verification alone."""
        return verification_status(self.verification, self.certificate)

    @property
    def reports(self) -> tuple[RequirementReport, ...]:
        """The requirements, each with its result and its proof."""
        return requirement_reports(self.verification, self.certificate, self.spec.is_measured)

    @property
    def cost(self) -> StepCost:
        """What a sample of the exported code costs."""
        from fopi_tune.digital.implementation import runtime_of, step_cost

        return step_cost(runtime_of(self.controller.sections, self.spec))

    @property
    def notes(self) -> tuple[str, ...]:
        """By how much equalities are missed, and what measured responses leave open."""
        return (*equality_notes(self.verification.requirements), *digital_notes(self.spec, self.verification.gains))

    def certificate_document(self) -> dict[str, Any] | None:
        """The certificate's JSON; None without one."""
        return to_document(self.certificate) if self.certificate else None

    @property
    def measures(self) -> tuple[MeasureReport, ...]:
        """The requirements on measures of scenarios, each with its result."""
        return measure_reports(
            self.spec.scenario_requirements, self.verification.measures, certificate=self.certificate
        )

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON."""
        from fopi_tune.digital import to_document as digital_document

        checked = verification_dict(self.spec, self.verification, self.certificate, self.stamp)
        weight = self.spec.controller.weight_of(self.controller.gains)
        weighted = {} if weight == 1.0 else {"setpoint_weight": weight}
        return {
            **checked,
            "loop": "sampled" if self.spec.has_loop_on_samples else "continuous",
            "notes": list(self.notes),
            **digital_document(self.controller),
            **weighted,
            "cost_of_step": asdict(self.cost),
        }

    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """As `Shown.data_files`, with the C code."""
        from fopi_tune.digital import Export, export_c

        code = export_c(Export.of(self.spec, self.controller))
        yield from ((f"{names.CODE_FOLDER}/{name}", text) for name, text in code.items())
        yield from json_file(names.DIGITAL_CERTIFICATE, to_document(self.certificate) if self.certificate else None)
        yield from json_file(names.DIGITAL, self.to_dict())

    def to_control(self) -> SampledObjects:
        """The digital controller, the nominal plant behind its hold and the loop as discrete `control` objects."""
        from fopi_tune.results.to_control import to_sampled

        crossover = self.verification.nominal.crossover_rad_s
        controller = self.controller
        used, delay = controller.gains.measurement_filter, controller.digital.delay_samples
        return to_sampled(controller.sections, self.spec.plant, delay, crossover, used)


@dataclass(frozen=True, repr=False)
class Validated(Shown):
    """Evidence from sampled plants: the result of `fopi validate`.

    Args:
        digital: the digital controller, its verification and its proof.
        evidence: how often everything held.
        contradictions: where a sampled plant violates what is proved; none unless the tool has a defect.
    """

    digital: Discretized
    evidence: Evidence
    contradictions: tuple[str, ...]

    @property
    def spec(self) -> DesignSpec:
        """What was asked."""
        return self.digital.spec

    @property
    def status(self) -> str:
        """`met`, `violated`, or `contradiction`."""
        if self.contradictions:
            return "contradiction"
        return "met" if self.evidence.all_met else "violated"

    def to_dict(self) -> dict[str, Any]:
        """The result's JSON."""
        from fopi_tune.montecarlo.documents import to_document as evidence_document

        return {
            "schema": RESULT_SCHEMA,
            "status": self.status,
            "gains": numbers_of(self.digital.controller.gains),
            "name": self.spec.name,
            "contradictions": list(self.contradictions),
            **evidence_document(self.evidence),
            "stamp": {
                **asdict(self.digital.stamp),
                "seed": self.evidence.validation.seed,
                "samples_file_sha256": self.evidence.validation.samples_file_sha256,
            },
        }

    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """As `Shown.data_files`."""
        yield from json_file(names.EVIDENCE, self.to_dict())


@dataclass(frozen=True, repr=False)
class Run(Shown):
    """Every stage of one spec: the result of `fopi run`.

    Args:
        design: the gains.
        digital: their digital controller; None where there is none.
        problem: why it cannot be made; empty otherwise.
    """

    design: Design
    digital: Discretized | None
    problem: str = ""

    @property
    def spec(self) -> DesignSpec:
        """What was asked."""
        return self.design.spec

    @property
    def status(self) -> str:
        """The design's, unless it is solved and the loop on samples does not meet the spec."""
        solved = self.design.status is Status.SOLVED
        return self.design.status.value if not solved or self.digital is None else self.digital.status

    def to_dict(self) -> dict[str, Any]:
        """The design's JSON, and the digital controller's in it."""
        digital = self.digital.to_dict() if self.digital else None
        return {**self.design.to_dict(), "digital": digital, "digital_problem": self.problem}

    def data_files(self) -> Iterator[tuple[str, str | bytes]]:
        """As `Shown.data_files`."""
        design = dict(self.design.data_files())
        if names.SPEC in design:
            yield names.SPEC, design.pop(names.SPEC)
        if self.digital is not None:
            yield from self.digital.data_files()
        yield from design.items()


def _of_optimum(optimum: Optimum) -> dict[str, Any]:
    from fopi_tune.optimum.documents import to_dict  # loaded by none else

    return {"optimum": to_dict(optimum)}

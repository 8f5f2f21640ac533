"""The bound and its proof as JSON, and strict reading of them."""

from __future__ import annotations

import math
from typing import Any

from fopi_tune.core.controller import FoPi, numbers_of
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.optimum.pruning.exclusion import Reason
from fopi_tune.optimum.results import Optimum, OptimumProof, OptimumStatus
from fopi_tune.optimum.tree import Cover
from fopi_tune.proof.strict_json import JsonObject

#: version of the file; it may only grow.  In 1 margins were read from the unwrapped phase, in 2 a box had one reason
OPTIMUM_SCHEMA = 3
KIND = "fopi_tune optimum"


def to_dict(optimum: Optimum) -> dict[str, Any]:
    """The summary in a design's results, without the proof."""
    return {
        "status": optimum.status.value,
        "statement": optimum.statement,
        "advice": optimum.status.advice,
        "gap": optimum.gap,
        "wanted_gap": optimum.wanted_gap,
        "bound": optimum.bound,
        "objective": optimum.objective,
        "gains": gains_dict(optimum.gains),
        "better_gains": gains_dict(optimum.better),
        "better_objective": optimum.better_objective,
        "boxes": optimum.boxes,
        "discarded_boxes": optimum.proof.leaves if optimum.proof else 0,
        "seconds": optimum.seconds,
        "left_out": list(optimum.left_out),
        "reason": optimum.reason,
    }


def gains_dict(gains: FoPi | None) -> dict[str, float] | None:
    """Gains by name."""
    return None if gains is None else numbers_of(gains)


def to_document(optimum: Optimum, versions: dict[str, str]) -> dict[str, Any]:
    """The whole document, with the proof.

    Args:
        optimum: to be written.
        versions: installed distribution -> version.
    """
    found = to_dict(optimum)
    del found["seconds"]  # equal inputs give equal files, unless the time limit was reached
    return {
        "kind": KIND,
        "schema": OPTIMUM_SCHEMA,
        "name": optimum.name,
        "spec_sha256": optimum.spec_sha256,
        "versions": versions,
        **found,
        "proof": None if optimum.proof is None else _proof_dict(optimum.proof),
    }


def _proof_dict(proof: OptimumProof) -> dict[str, Any]:
    return {
        "beat": proof.beat,
        "reference_rad_s": proof.reference_rad_s,
        "reasons": [
            {
                "condition": reason.condition,
                "point": list(reason.point),
                "omega_rad_s": list(reason.omega),
                "above": reason.above,
            }
            for reason in proof.reasons
        ],
        "covers": [
            {"root": [list(side) for side in cover.root], "tokens": " ".join(cover.tokens)} for cover in proof.covers
        ],
    }


class OptimumDocument:
    """The entries of a document, with their types checked.

    Raises:
        CertificateError: not such a document, or an entry is missing or has the wrong type.
    """

    def __init__(self, document: object) -> None:
        top = JsonObject(document, "")
        if top.get("kind") != KIND:
            raise CertificateError("this is no bound of an optimum: its kind is another")
        if top.number("schema") == 1:
            raise CertificateError(
                "schema 1 is about another phase margin and delay margin, read from the unwrapped phase; they are now "
                "the distances of a stable loop from -1: certify the optimum again"
            )
        if top.number("schema") == 2:
            raise CertificateError("schema 2 proves each box by one condition only: certify the optimum again")
        if top.number("schema") != OPTIMUM_SCHEMA:
            raise CertificateError(f"schema {top.number('schema'):g} is not known; this version reads {OPTIMUM_SCHEMA}")
        self.name, self.spec_sha256 = top.text("name"), top.text("spec_sha256")
        self.status = top.word("status", OptimumStatus)
        self.bound, self.objective = top.number_or_none("bound"), top.number_or_none("objective")
        self.gap, self.wanted_gap = top.number_or_none("gap"), top.number("wanted_gap")
        self.gains = None if top.get("gains") is None else _read_gains(top.child("gains"))
        self.proof = None if top.get("proof") is None else _read_proof(top.child("proof"))
        self.reason = top.text("reason")
        self.better = None if top.get("better_gains") is None else _read_gains(top.child("better_gains"))
        self.better_objective = top.number_or_none("better_objective")
        boxes = top.count_or_none("boxes")
        if boxes is None or boxes < 0 or not self.wanted_gap > 0.0:
            raise CertificateError("boxes must be a number that is counted, and wanted_gap greater than 0")
        self.boxes = boxes
        self.left_out, self.versions = top.text_list("left_out"), top.texts("versions")

    def to_optimum(self) -> Optimum:
        """The numbers as an Optimum, from which everything else can be derived again."""
        return Optimum(
            name=self.name,
            spec_sha256=self.spec_sha256,
            status=self.status,
            gains=self.gains,
            objective=self.objective,
            bound=self.bound,
            gap=self.gap,
            wanted_gap=self.wanted_gap,
            better=self.better,
            better_objective=self.better_objective,
            boxes=self.boxes,
            seconds=0.0,
            proof=self.proof,
            left_out=self.left_out,
            reason=self.reason,
        )


def _read_gains(entry: JsonObject) -> FoPi:
    try:
        return entry.controller()
    except DomainError as error:
        raise CertificateError(str(error)) from None


def _read_proof(entry: JsonObject) -> OptimumProof:
    covers = tuple(_read_cover(child) for child in entry.children("covers"))
    reasons = tuple(_read_reason(child) for child in entry.children("reasons"))
    reference = entry.number_or_none("reference_rad_s")
    if reference is not None and not 0.0 < reference < math.inf:
        raise CertificateError(f"{entry.place}.reference_rad_s is no frequency")
    return OptimumProof(entry.number_or_none("beat"), reference, covers, reasons)


def _read_cover(entry: JsonObject) -> Cover:
    sides = entry.get("root")
    if not isinstance(sides, list) or not all(isinstance(side, list) and len(side) == 2 for side in sides):
        raise CertificateError(f"{entry.place}.root is no box")
    ends = [JsonObject({"side": side}, f"{entry.place}.root[{k}]").numbers("side") for k, side in enumerate(sides)]
    return Cover(tuple((low, high) for low, high in ends), tuple(entry.text("tokens").split()))


def _read_reason(entry: JsonObject) -> Reason:
    condition = entry.count_or_none("condition")
    if condition is None or condition < 0:
        raise CertificateError(f"{entry.place}.condition is no place in a list")
    return Reason(condition, entry.numbers("point"), entry.numbers("omega_rad_s"), entry.flag("above"))

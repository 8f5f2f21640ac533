"""Gains from the command line's options, from an earlier design, or tuned now."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fopi_tune.cli.batch import OutputOptions
from fopi_tune.cli.output import bad_input
from fopi_tune.core.controller import FoPi
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    from fopi_tune.results.design import Design
    from fopi_tune.spec.model import DesignSpec


def gains_from_options(kp: float | None, ki: float | None, alpha: float | None) -> FoPi | None:
    """The gains of --kp, --ki and --alpha; None if none of them is given."""
    if kp is None and ki is None and alpha is None:
        return None
    if kp is None or ki is None or alpha is None:
        raise bad_input("give --kp, --ki and --alpha all three, or none of them")
    try:
        return FoPi(kp, ki, alpha)
    except DomainError as error:
        raise bad_input(str(error)) from None


def gains_of_earlier_design(spec: DesignSpec, options: OutputOptions) -> FoPi | None:
    """The gains that the spec fixes, or those of a solved design of the same problem in the folder of results."""
    from fopi_tune.spec.digests import is_of_spec
    from fopi_tune.spec.files import read_json

    box = spec.controller
    if all(gain.is_fixed for gain in (box.kp, box.ki, box.alpha)):
        return FoPi(box.kp.min, box.ki.min, box.alpha.min)
    path = options.folder(spec) / "design.json"
    try:
        document = read_json(path)
        solved = document["status"] == "solved" and is_of_spec(document["stamp"], spec)
        gains = document["gains"] if solved else None
        found = FoPi(float(gains["kp"]), float(gains["ki"]), float(gains["alpha"])) if gains else None
    except (OSError, DomainError, KeyError, TypeError):
        return None  # no usable design: the caller prints a note and tunes
    if found is not None:
        options.note(f"{spec.name}: gains from {path}")
    return found


def earlier_or_tuned_gains(spec: DesignSpec, options: OutputOptions) -> FoPi | Design:
    """Gains of an earlier design or of a new one; the new design itself if it is not solved."""
    from fopi_tune.pipeline.tune import tune

    gains = gains_of_earlier_design(spec, options)
    if gains is not None:
        return gains
    options.note(f"{spec.name}: no gains given, and no design of this spec there; tuning first ...")
    design = tune(spec, proof=False)
    return design if design.gains is None or design.status.value != "solved" else design.gains

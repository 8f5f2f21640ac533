"""Gains from the command line's options, from an earlier design, or tuned now."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

from fopi_tune.cli.batch import OutputOptions
from fopi_tune.core.controller import FoPi
from fopi_tune.errors import CertificateError, DomainError

if TYPE_CHECKING:
    from fopi_tune.results.design import Design
    from fopi_tune.spec.model import DesignSpec

_NAMES = ("kp", "ki", "alpha", "kd", "mu")


def number_option(*names: str, help: str, metavar: str = "FLOAT") -> Any:
    """An option whose number is written as in specs."""
    return typer.Option(*names, parser=_number, help=help, metavar=metavar)


def _number(text: str | float) -> float:
    """An option's number, written as in specs; a default is one already.

    Raises:
        BadParameter: it is none, or cannot be computed with.
    """
    from fopi_tune.spec.yaml.scalars import NotANumberError, parse_number  # --version reads no specs

    try:
        return parse_number(text.strip()) if isinstance(text, str) else text
    except NotANumberError as error:
        raise typer.BadParameter(str(error)) from None


@dataclass(frozen=True)
class GivenGains:
    """The gains of --kp, --ki, --alpha, --kd and --mu; None where an option is left out."""

    kp: float | None
    ki: float | None
    alpha: float | None
    kd: float | None = None
    mu: float | None = None

    def for_spec(self, spec: DesignSpec) -> FoPi | None:
        """The controller, with what the spec fixes where an option is left out; None if none of them is given.

        Raises:
            DomainError: some are given, and another is neither given nor fixed; or there is no such controller.
        """
        if not self:
            return None
        given: dict[str, float] = {}
        spec.controller.refuse_filter_times("giving gains on the command line")
        if spec.controller.setpoint_weight_range is not None:
            raise DomainError("giving gains on the command line needs a spec whose setpoint_weight is one number")
        self._refuse_foreign(spec)
        for name in _NAMES:
            value, box = getattr(self, name), getattr(spec.controller, name)
            if box is None:
                continue
            if value is None and not box.is_fixed:
                *others, last = (f"--{each}" for each in spec.controller.ranges)
                every = {2: "three", 4: "five"}[len(others)]
                raise DomainError(
                    f"give {', '.join(others)} and {last} all {every}, or none of them: --{name} is left out, and the "
                    f"spec gives {name} a range"
                )
            given[name] = box.min if value is None else value
        if spec.controller.structure == "pid" and given["alpha"] != 1.0:
            raise DomainError("--alpha: the integral of structure pid has the order 1; leave --alpha out")
        if given["kd"] != 0.0 and not spec.controller.has_derivative:
            raise DomainError("--kd: the spec's controller has no derivative; write structure: pid in it")
        return spec.controller.controller(**given)

    def _refuse_foreign(self, spec: DesignSpec) -> None:
        """Refuse an order of a derivative that the spec's structure does not have; 1 is that of a pid."""
        own = (None, 1.0) if spec.controller.structure == "pid" else (None,)
        if not spec.controller.has_derivative_order and self.mu not in own:
            raise DomainError("--mu: the spec's controller has no order mu; write structure: fopid in it")

    def __bool__(self) -> bool:
        return any(getattr(self, name) is not None for name in _NAMES)


def gains_of_document(entry: object) -> FoPi:
    """The gains of a result's JSON, whose types are checked.

    Args:
        entry: the object with `kp`, `ki` and `alpha`.

    Raises:
        CertificateError: an entry is missing, or is no finite number.
        DomainError: there is no such controller.
    """
    from fopi_tune.proof.strict_json import JsonObject

    return JsonObject(entry, "gains").controller()


def gains_of_earlier_design(spec: DesignSpec, options: OutputOptions) -> FoPi | None:
    """The gains that the spec fixes, or those of a solved design of the same problem in the folder of results."""
    from fopi_tune.spec.digests import is_of_spec
    from fopi_tune.spec.files import read_json

    box = spec.controller
    if box.fixed is not None:
        return box.fixed
    path = options.folder(spec) / "design.json"
    try:
        document = read_json(path)
        solved = document["status"] == "solved" and is_of_spec(document["stamp"], spec)
        found = gains_of_document(document["gains"]) if solved else None
    except (OSError, DomainError, CertificateError, KeyError, TypeError):
        return None  # no usable design: the caller prints a note and tunes
    if found is not None:
        options.note(f"{spec.name}: gains from {path}")
    return found


def given_or_tuned_gains(spec: DesignSpec, given: GivenGains, options: OutputOptions) -> FoPi | Design:
    """Gains that are given, of an earlier design or of a new one; the new design itself if it is not solved.

    Raises:
        DomainError: only some of the gains are given.
    """
    from fopi_tune.pipeline.tune import tune

    gains = given.for_spec(spec) or gains_of_earlier_design(spec, options)
    if gains is not None:
        return gains
    options.note(f"{spec.name}: no gains given, and no design of this spec there; tuning first ...")
    design = tune(spec, proof=False)
    return design if design.gains is None or design.status.value != "solved" else design.gains

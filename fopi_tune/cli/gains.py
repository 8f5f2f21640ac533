"""Gains and numbers of the command line, and where gains come from that are not named there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import typer

from fopi_tune.cli.batch import Handling
from fopi_tune.cli.output import Exit, say
from fopi_tune.cli.recheck import gains_of_earlier_design
from fopi_tune.core.controller import FoPi
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    from fopi_tune.results.design import Design
    from fopi_tune.spec.model import DesignSpec


def given_gains(kp: float | None, ki: float | None, alpha: float | None) -> FoPi | None:
    """The gains of the command line; None without any."""
    if kp is None and ki is None and alpha is None:
        return None
    if kp is None or ki is None or alpha is None:
        raise refusal("give --kp, --ki and --alpha all three, or none of them")
    try:
        return FoPi(kp, ki, alpha)
    except DomainError as error:
        raise refusal(str(error)) from None


def named_numbers(pairs: Sequence[str]) -> dict[str, float]:
    """NAME=VALUE as a mapping."""
    numbers: dict[str, float] = {}
    for pair in pairs:
        name, _, value = pair.partition("=")
        try:
            numbers[name] = float(value)
        except ValueError:
            raise refusal(f"--plant {pair} is not NAME=VALUE, as in --plant time_constant_s=3.1") from None
    return numbers


def found_or_tuned(spec: DesignSpec, handling: Handling) -> FoPi | Design:
    """Gains of an earlier design or of one made now; the design itself when it is no solution."""
    from fopi_tune.pipeline.tune import tune

    gains = gains_of_earlier_design(spec, handling)
    if gains is not None:
        return gains
    handling.note(f"{spec.name}: no gains given, and no design of this spec there; tuning first ...")
    design = tune(spec, proof=False)
    return design if design.gains is None or design.status.value != "solved" else design.gains


def refusal(words: str) -> typer.Exit:
    """Says what is wrong with the command line, and ends with the code of bad input when raised."""
    say(words)
    return typer.Exit(Exit.BAD_INPUT)

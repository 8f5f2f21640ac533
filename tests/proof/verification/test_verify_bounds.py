"""What a verification refuses:  a loop that turns too often to search; and the memory that it takes below that."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import pytest
from cases.commands import fopi
from cases.project import CONTINUOUS, ROOT
from typer.testing import Result

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.errors import DomainError, UnstableLoopError
from fopi_tune.proof import verify
from fopi_tune.proof.verification.stability import MOST_TURNS
from fopi_tune.spec import load_spec, parse_spec
from fopi_tune.spec.model import DesignSpec

DEAD_TIME_S = 0.4
#: peak memory of a process that discretises and proves, bytes
MOST_MEMORY = 300e6


def lag_spec() -> DesignSpec:
    """One plant e^{-0.4 s}/(s + 1), and a requirement."""
    plant = f"{{model: lag, static_gain: 1.0, time_constant_s: 1.0, dead_time_s: {DEAD_TIME_S}}}"
    controller = "{kp: {min: 0, max: 10}, ki: {min: 0, max: 10}, alpha: {min: 0.3, max: 1.5}}"
    requirements = "[{sensitivity_db: {at_most: 6}}]"
    return parse_spec(f"schema: 1\nname: t\nplant: {plant}\ncontroller: {controller}\nrequirements: {requirements}\n")


@pytest.mark.parametrize(("share", "refused"), [(0.98, False), (1.02, True)])
def test_a_loop_is_refused_from_a_stated_number_of_turns_on(share: float, refused: bool) -> None:
    """kp/|1 + j omega| = 1 at omega = sqrt(kp^2 - 1), where arg L = -atan omega - omega L."""
    omega = (share * MOST_TURNS * 2.0 * math.pi - 0.5 * math.pi) / DEAD_TIME_S
    gains = FoPi(math.hypot(omega, 1.0), 0.0, 1.0)
    if not refused:
        # about two unstable poles a turn
        poles = verify(lag_spec(), gains).stability.unstable_poles
        assert poles is not None
        assert poles == pytest.approx(2.0 * share * MOST_TURNS, abs=3)
        return
    with pytest.raises(UnstableLoopError, match=r"turns 1,020 times .* at most 1,000 turns.* smaller gains") as raised:
        verify(lag_spec(), gains)
    poles = re.search(r"leaves ([0-9,]+) closed-loop poles in the right half-plane", str(raised.value))
    assert poles is not None
    assert int(poles[1].replace(",", "")) == pytest.approx(2.0 * share * MOST_TURNS, abs=3)


def direct_spec(kp: float) -> DesignSpec:
    """A fractional plant with a direct path of 0.99 around a dead time."""
    plant = (
        "{model: fractional, numerator: [{coefficient: 0.99, order: 1.7}, {coefficient: 2, order: 0}], "
        "denominator: [{coefficient: 1.0, order: 1.7}, {coefficient: 1, order: 0}], dead_time_s: 0.5}"
    )
    head = f"schema: 1\nname: t\nplant: {plant}\ncontroller: {{kp: {kp}, ki: 0.4, alpha: 0.3}}\n"
    return parse_spec(f"{head}requirements: [{{sensitivity_db: {{at_most: 6}}}}]\n")


def proved_by_command(spec: DesignSpec, folder: Path) -> Result:
    path = folder / "t.yaml"
    path.write_bytes(spec.source)
    return fopi("prove", str(path), "--out", str(folder / "out"), "-q")


def test_a_smaller_gain_around_the_same_direct_path_is_proved(tmp_path: Path) -> None:
    spec = direct_spec(0.01)
    assert ft.tune(spec).status.value == "solved"
    assert proved_by_command(spec, tmp_path).exit_code == 0


@pytest.mark.parametrize(
    ("kp", "why"), [(1.0, "closed-loop poles in the right half-plane"), (1.5, "infinitely many unstable poles")]
)
def test_a_direct_path_around_a_dead_time_is_unstable_and_no_mistake_of_the_spec(
    tmp_path: Path, kp: float, why: str
) -> None:
    spec = direct_spec(kp)
    design, done = ft.tune(spec), proved_by_command(spec, tmp_path)
    assert design.status.value == "infeasible"
    assert "these gains leave an unstable loop" in design.message
    assert why in design.message
    assert done.exit_code == 1
    assert why in " ".join((done.stderr + done.stdout).split())


def test_huge_gains_on_a_family_are_refused_with_the_plant_that_turns_most() -> None:
    """kp = 1e6 took a minute of searching ripples that no requirement could meet."""
    with pytest.raises(DomainError, match=r"static_gain = 1\.25, time_constant_s = 1\.6, dead_time_s = 0\.4"):
        verify(load_spec(CONTINUOUS / "lag_gain_and_delay.yaml"), FoPi(1e6, 1.0, 1.0))


@pytest.mark.long
def test_a_loop_with_a_crossover_far_below_its_corners_is_discretised_in_bounded_memory() -> None:
    """alpha = 0.01 spreads |L| over 70 decades; the search of its peaks took 1.2 GB."""
    script = (
        "import resource, fopi_tune as ft; "
        f"ft.discretize({str(CONTINUOUS / 'lag_gain_and_delay.yaml')!r}, ft.FoPi(0.0, -0.2, 0.01)); "
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT)
    assert int(ran.stdout) * 1024 < MOST_MEMORY

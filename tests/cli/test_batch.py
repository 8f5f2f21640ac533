"""Exit codes of results."""

from __future__ import annotations

import pytest
from cases.project import ROOT

from fopi_tune import report
from fopi_tune.cli.batch import exit_code_of
from fopi_tune.cli.output import Exit
from fopi_tune.results.stamp import stamp
from fopi_tune.results.status import Status
from fopi_tune.results.system_design import DesignedSystem
from fopi_tune.spec.load import load_system


def test_nothing_of_a_systems_design_is_proved() -> None:
    system = load_system(ROOT / "systems" / "car_comfort.yaml")

    def design(status: Status) -> DesignedSystem:
        return DesignedSystem(system, status, None, None, (), {}, (), "", (), 0, stamp(system.sha256, "simplex"))

    assert exit_code_of(design(Status.SOLVED), require_proof=False) is Exit.MET
    assert exit_code_of(design(Status.SOLVED), require_proof=True) is Exit.TOOL_FAILED
    assert exit_code_of(design(Status.INFEASIBLE), require_proof=True) is Exit.NOT_MET


def test_every_text_and_figure_is_found_by_its_name() -> None:
    assert all(getattr(report, name).__name__ == name for name in report.__all__)
    with pytest.raises(AttributeError, match="no attribute 'letter'"):
        _ = report.letter

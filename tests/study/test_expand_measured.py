"""Studies over measured plants: their files go to every cell, and a path leads to them."""

from __future__ import annotations

from pathlib import Path

from cases.measured import LAG, TWO, csv, text_of

from fopi_tune.study.load import load_study
from fopi_tune.study.worker import run_cell

STUDY = "schema: 1\nname: benches\nspecs: [s.yaml]\ngrid: {plant.file: [a.csv, b.csv]}\nstages: [tune, prove]\n"
PI = "{structure: pi, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}}"


def test_a_study_goes_over_files_and_its_cells_have_their_data(tmp_path: Path) -> None:
    for name, plant in (("a.csv", LAG), ("b.csv", TWO)):
        (tmp_path / name).write_bytes(csv(plant, 0.01, 100.0, 61))
    told = "{model: frequency_response, file: a.csv, unstable_poles: 0}"
    (tmp_path / "s.yaml").write_text(text_of(told, "[{phase_margin_deg: {at_least: 50}}]", "{maximize: ki}", PI))
    (tmp_path / "study.yaml").write_text(STUDY)
    cells = load_study(tmp_path / "study.yaml").cells
    assert [[name for name, _ in cell.files] for cell in cells] == [["a.csv"], ["b.csv"]]
    # a base with other data is no start
    (tmp_path / "from_base.yaml").write_text(STUDY + "starts: base\n")
    assert [run_cell("", cell).reason for cell in load_study(tmp_path / "from_base.yaml").cells] == ["", ""]
    keys = [cell.key({}) for cell in cells]
    assert run_cell(keys[0], cells[0]).reason == ""
    (tmp_path / "a.csv").write_bytes(csv(LAG, 0.01, 100.0, 62))
    changed = [cell.key({}) for cell in load_study(tmp_path / "study.yaml").cells]
    assert [key != other for key, other in zip(keys, changed, strict=True)] == [True, False]

"""The section of a measured plant, its files and its digest."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from cases.measured import LAG, TWO, csv, text_of

from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.errors import SpecError
from fopi_tune.spec.digests import digests_of
from fopi_tune.spec.load import load_spec, parse_spec
from fopi_tune.spec.model import DesignSpec

ASKED, MORE_KI = "[{phase_margin_deg: {at_least: 50}}]", "{maximize: ki}"


def _spec(plant: str, files: dict[str, bytes]) -> DesignSpec:
    return parse_spec(text_of(plant, ASKED, MORE_KI), files=files)


def _family(plant: str, files: dict[str, bytes]) -> MeasuredFamily:
    family = _spec(plant, files).plant
    assert isinstance(family, MeasuredFamily)
    return family


def _problems(plant: str, files: dict[str, bytes] | None = None) -> list[str]:
    with pytest.raises(SpecError) as refused:
        _spec(plant, files or {"f.csv": csv(LAG)})
    return [str(problem) for problem in refused.value.problems]


def test_one_file_is_one_plant_without_a_name() -> None:
    family = _family("{model: frequency_response, file: f.csv, unstable_poles: 1}", {"f.csv": csv(LAG, 0.1, 10.0, 31)})
    assert [member.name for member in family.members] == [""]
    assert family.unstable_poles == 1
    assert family.band_rad_s == pytest.approx((0.1, 10.0))


def test_each_file_is_a_member_and_a_deviation_makes_nine() -> None:
    files = {"x/a.csv": csv(LAG), "b.csv": csv(TWO, deviation=0.01)}
    family = _family("{model: frequency_response, files: [x/a.csv, b.csv], dead_time_s: 0.1}", files)
    assert [member.name for member in family.members[:2]] == ["a.csv", "b.csv"]
    assert len(family.members) == 10
    assert family.unstable_poles is None
    assert family.dead_time.nominal == 0.1


def test_files_of_one_name_keep_their_folders() -> None:
    files = {"x/a.csv": csv(LAG), "y/a.csv": csv(TWO)}
    family = _family("{model: frequency_response, files: [x/a.csv, y/a.csv]}", files)
    assert [member.name for member in family.members] == ["x/a.csv", "y/a.csv"]


def test_the_digest_changes_with_the_data_and_not_with_how_they_are_written() -> None:
    plant = "{model: frequency_response, file: f.csv}"
    base = _spec(plant, {"f.csv": csv(LAG)})
    commented = _spec(plant, {"f.csv": b"# of Monday\n" + csv(LAG)})
    other = _spec(plant, {"f.csv": csv(LAG).replace(b"0.001,", b"0.00101,", 1)})
    assert digests_of(base) == digests_of(commented)
    assert digests_of(base)["plant"] != digests_of(other)["plant"]
    assert digests_of(base)["controller"] == digests_of(other)["controller"]
    stated = _spec("{model: frequency_response, file: f.csv, unstable_poles: 0}", {"f.csv": csv(LAG)})
    assert digests_of(base)["plant"] != digests_of(stated)["plant"]


def test_a_path_is_relative_to_the_spec(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "f.csv").write_bytes(csv(LAG))
    (tmp_path / "s.yaml").write_text(text_of("{model: frequency_response, file: data/f.csv}", ASKED, MORE_KI))
    assert load_spec(tmp_path / "s.yaml").is_measured
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "t.yaml").write_text(text_of("{model: frequency_response, file: pipe}", ASKED, MORE_KI))
    with pytest.raises(SpecError, match="only regular files are read"):
        load_spec(tmp_path / "t.yaml")
    (tmp_path / "u.yaml").write_text(text_of("{model: frequency_response, file: none.csv}", ASKED, MORE_KI))
    with pytest.raises(SpecError, match="there is no file"):
        load_spec(tmp_path / "u.yaml")


@pytest.mark.parametrize(
    ("plant", "told"),
    [
        ("{model: frequency_response}", "3:8: plant: a file is missing; write file: frf.csv"),
        ("{model: frequency_response, file: f.csv, files: [f.csv]}", "plant.files: file and files are both written"),
        ("{model: frequency_response, files: [f.csv, f.csv]}", "plant.files[1]: the file is listed twice"),
        ("{model: frequency_response, file: g.csv}", "3:42: plant.file: 'g.csv' is not there"),
        ("{model: frequency_response, file: f.csv, unstable_poles: -1}", "plant.unstable_poles: -1 is out of range"),
        ("{model: frequency_response, file: f.csv, unstable_poles: 0.5}", "plant.unstable_poles"),
        ("{model: frequency_response, file: f.csv, dead_time_s: -0.1}", "plant.dead_time_s: -0.1 is out of range"),
        ("{model: frequency_response, file: f.csv, gain: 1}", "3:49: plant.gain: the key is not known here"),
        ("{model: frequency_response, file: 7}", "plant.file: '7' is not text"),
        ("{model: frequency_respons, file: f.csv}", "plant.model: 'frequency_respons' is not known here"),
    ],
)
def test_mistakes_are_told_with_their_place(plant: str, told: str) -> None:
    assert any(told in problem for problem in _problems(plant)), _problems(plant)


def test_mistakes_of_every_file_are_told_at_once() -> None:
    files = {"a.csv": b"", "b.csv": csv(LAG).replace(b"omega_rad_s", b"other")}
    found = _problems("{model: frequency_response, files: [a.csv, b.csv]}", files)
    assert "plant.files[0]: 'a.csv': has no lines of numbers" in found[0]
    assert "plant.files[1]: 'b.csv': has no column of frequencies" in found[1]


def test_responses_without_a_common_band_are_refused() -> None:
    files = {"a.csv": csv(LAG, 0.1, 1.0, 20), "b.csv": csv(LAG, 2.0, 10.0, 20)}
    found = _problems("{model: frequency_response, files: [a.csv, b.csv]}", files)
    assert "plant.files: the responses have no band of frequencies in common" in found[0]


def test_a_measured_plant_stands_alone() -> None:
    text = text_of("x", ASKED, MORE_KI).replace("plant: x", "plants: [{model: frequency_response, file: f.csv}]")
    with pytest.raises(SpecError, match="measured responses stand alone in this version"):
        parse_spec(text, files={"f.csv": csv(LAG)})

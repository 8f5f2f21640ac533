"""The exported C on an emulated Cortex-M4: the vectors bit for bit, and what a step costs there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from cases.cortex_m4.emulated import Cost, compiled, compiler_version, cost_of, emulated, missing
from cases.project import ROOT
from cases.targets import exported, runtime_of, structures

from fopi_tune.digital import Memory, Switching, export_c, export_system_c
from fopi_tune.digital.implementation import step_cost
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.vectors import Op, Operation, standard_operations
from tests.digital.test_export_system_c import exported as system

pytestmark = pytest.mark.skipif(bool(missing()), reason=missing())
#: of a controller in words, as the page has them
CONTROLLERS = {
    "weighted": "PI, setpoint weight, limits of value and rate",
    "fopi": "fractional PI, 7 poles, limits",
    "all": "PID with all parts",
    "fopid": "fractional PID, 7 poles, measurement filter",
}
TYPES = {Precision.FLOAT32: ("float", "f32"), Precision.FLOAT64: ("double", "f64")}


def written(structure: str, folder: Path) -> list[str]:
    """The names of the C files."""
    return put(export_c(exported(structure)), folder)


def put(files: dict[str, str], folder: Path) -> list[str]:
    for name, text in files.items():
        (folder / name).write_text(text, encoding="ascii")
    return [name for name in files if name.endswith(".c")]


def measured(structure: str, precision: Precision, folder: Path) -> Cost:
    """Over ordinary steps of the vectors (a step, noise, both limits), and samples at rest, which flush states."""
    written(structure, folder)
    type_, suffix = TYPES[precision]
    ordinary = standard_operations(runtime_of(exported(structure)))[:900:5]
    operations = [*ordinary, *[Operation(Op.STEP)] * 20]
    return cost_of(folder, f"fopi_brake_1_2_{suffix}", type_, operations)


@structures("all", "fopi")
def test_the_vectors_are_met_bit_for_bit(structure: str, tmp_path: Path) -> None:
    done = emulated(compiled(tmp_path, written(structure, tmp_path)), "test_vectors.csv")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "rows are equal bit for bit, in double and in float" in done.stdout


def test_a_system_meets_its_vectors_bit_for_bit(tmp_path: Path) -> None:
    files = export_system_c(system(Switching(0.5, Memory.TRACKING, 3)))
    done = emulated(compiled(tmp_path, put(files, tmp_path)), "test_vectors.csv")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "rows are equal bit for bit, in double and in float" in done.stdout


def test_a_multiplication_and_addition_in_one_are_seen(tmp_path: Path) -> None:
    program = compiled(tmp_path, written("fopi", tmp_path), "-std=gnu99", "-ffp-contract=fast")
    done = emulated(program, "test_vectors.csv")
    assert done.returncode == 1
    assert re.match(r"line \d+, step: double (\S+) instead of \1, float -?\d\S* instead of -?\d", done.stdout)


def test_instructions_are_counted_and_no_fewer_than_operations(tmp_path: Path) -> None:
    cost, counted = step_cost(runtime_of(exported("fopi"))), measured("fopi", Precision.FLOAT32, tmp_path)
    operations = cost.multiplications + cost.additions
    # each state is read, compared and written: five instructions beside each operation would be a mistake
    assert operations < counted.median < 6 * operations
    # a sample at rest compares each state twice more, two instructions of comparing and a jump each time
    assert counted.median < counted.most < counted.median + 12 * len(exported("fopi").controller.sections.poles)
    assert counted.code_bytes > 4 * cost.coefficients


@pytest.mark.long
def test_the_page_has_what_is_measured(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "howto" / "c_on_target.md").read_text(encoding="utf-8")
    told = re.search(r"gcc (\d+\.\d+\.\d+) for ARM", page)
    assert told is not None
    if told.group(1) != compiler_version():
        pytest.skip(f"the page is of gcc {told.group(1)}, here is {compiler_version()}")
    for structure, words in CONTROLLERS.items():
        for precision, (type_, _) in TYPES.items():
            (folder := tmp_path / f"{structure}_{type_}").mkdir()
            cost = measured(structure, precision, folder)
            assert f"| {words} | {type_} | {cost.median} | {cost.most} | {cost.code_bytes} |" in page

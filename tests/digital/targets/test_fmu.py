"""The FMU: valid, compiled against FMI's own headers and without, and replayed bit for bit by an importer."""

from __future__ import annotations

import io
import math
import shutil
import struct
import subprocess
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from cases.targets import TS, exported, rows_of, structures

from fopi_tune.digital.targets import Target, export_target
from fopi_tune.digital.targets.fmu import fmu_files, model_identifier, packed
from fopi_tune.digital.vectors import Op

fmpy = pytest.importorskip("fmpy", reason="no FMPy: FMUs are not validated and replayed")
COMPILER = next((name for name in ("gcc", "clang", "cc") if shutil.which(name)), "")
needs_compiler = pytest.mark.skipif(not COMPILER, reason="no C compiler")
FLAGS = [*("-std=c99", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror")]
#: functions have the parameters that FMI gives them
FLAGS += ["-Wno-unused-parameter", "-ffp-contract=off", "-fPIC", "-shared"]
SETPOINT, MEASUREMENT, APPLIED, TRACK, RESET, OUTPUT = range(1, 7)


def compiled(structure: str, folder: Path, *flags: str) -> Path:
    """The unpacked FMU with a binary for this machine."""
    export = exported(structure)
    for name, content in fmu_files(export).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    binary = folder / "binaries" / fmpy.platform_tuple / f"{model_identifier(export)}{fmpy.sharedLibraryExtension}"
    binary.parent.mkdir(parents=True)
    sources = sorted(map(str, (folder / "sources").glob("*.c")))
    command = [COMPILER, *FLAGS, *flags, "-o", str(binary), *sources]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@contextmanager
def running(folder: Path, log: Callable[..., None] | None = None, start: float = 0.0) -> Iterator[Any]:
    """An instance after its initialization."""
    description = fmpy.read_model_description(str(folder))
    fmu = pytest.importorskip("fmpy.fmi3").FMU3Slave(
        guid=description.guid,
        unzipDirectory=str(folder),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="controller",
    )
    fmu.instantiate(logMessage=log)
    fmu.enterInitializationMode(startTime=start)
    fmu.exitInitializationMode()
    try:
        yield fmu
    finally:
        fmu.freeInstance()


def bits(number: float) -> bytes:
    return struct.pack("<d", number)


@structures("all", "fopi", "proportional")
def test_the_description_is_valid_and_the_bytes_are_the_same_each_time(structure: str) -> None:
    validate_fmu = pytest.importorskip("fmpy.validation").validate_fmu
    export = exported(structure)
    ((name, content),) = export_target(export, Target.FMU).items()
    assert name == "Brake-1.2.fmu"
    assert isinstance(content, bytes)
    assert validate_fmu(io.BytesIO(content)) == []
    assert export_target(export, Target.FMU) == {name: content}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert {entry.date_time[0] for entry in archive.infolist()} == {1980}
        assert packed({entry: archive.read(entry) for entry in archive.namelist()}) == content


def test_the_description_says_units_constants_and_texts_as_they_are() -> None:
    content = packed(fmu_files(exported("all")))
    description = fmpy.read_model_description(io.BytesIO(content))
    assert description.description == 'A "car"s <brake> & more'
    variables = {variable.name: variable for variable in description.modelVariables}
    assert variables["measurement"].description == "km/h"
    assert variables["output"].description == "<part>"
    assert float(variables["setpoint_weight"].start) == 0.5
    assert [float(variables[name].start) for name in ("output_min", "output_max", "output_rate_per_s")] == [-1, 0.8, 2]
    assert float(description.coSimulation.fixedInternalStepSize) == TS


@needs_compiler
@structures("all", "fopi", "negative_pid")
def test_the_vectors_are_met_bit_for_bit(structure: str, tmp_path: Path) -> None:
    rows, last = rows_of(structure), 0
    with running(compiled(structure, tmp_path)) as fmu:
        for k, row in enumerate(rows):
            one = row.operation
            fmu.setFloat64([SETPOINT, MEASUREMENT, APPLIED], [one.setpoint, one.measurement, one.output])
            fmu.setBoolean([TRACK, RESET], [one.op is Op.TRACK, one.op is Op.RESET])
            fmu.doStep(k * TS, TS)
            assert bits(fmu.getFloat64([OUTPUT])[0]) == bits(row.output), (k, one)
            last = k
    assert last == len(rows) - 1 > 2000


@needs_compiler
def test_a_step_of_several_samples_holds_the_inputs_and_a_stored_state_is_taken_up_again(tmp_path: Path) -> None:
    folder = compiled("all", tmp_path)
    with running(folder, start=5.0) as one, running(folder) as several:
        one.setFloat64([SETPOINT], [0.05])
        several.setFloat64([SETPOINT], [0.05])
        begun = several.getFMUState()
        outputs = []
        for k in range(6):
            one.doStep(5.0 + k * TS, TS)
            outputs += one.getFloat64([OUTPUT])
        assert len(set(outputs)) == 6
        assert several.doStep(0.0, 6 * TS)[3] == pytest.approx(6 * TS, rel=1e-15)
        assert several.getFloat64([OUTPUT]) == outputs[-1:]
        several.setFMUState(begun)
        several.doStep(0.0, 2 * TS)
        assert several.getFloat64([OUTPUT]) == outputs[1:2]
        several.freeFMUState(begun)


@needs_compiler
def test_what_an_importer_gets_wrong_is_an_error_with_a_reason(tmp_path: Path) -> None:
    said: list[str] = []
    folder = compiled("fopi", tmp_path)

    def log(environment: Any, status: int, category: bytes, message: bytes) -> None:
        said.append(message.decode())

    with running(folder, log) as fmu:
        before = fmu.getFloat64([OUTPUT])
        for begin, size in ((0.0, 1.5 * TS), (0.0, 0.0), (0.0, -TS), (0.0, math.nan), (TS, TS), (0.0, 1e12)):
            with pytest.raises(Exception, match=r"fmi3DoStep failed|returned|status"):
                fmu.doStep(begin, size)
        assert fmu.getFloat64([OUTPUT]) == before == [0.1]
        with pytest.raises(Exception, match="fmi3SetFloat64"):
            fmu.setFloat64([OUTPUT], [1.0])
        with pytest.raises(Exception, match="fmi3GetFloat64"):
            fmu.getFloat64([99])
        fmu.terminate()
        with pytest.raises(Exception, match="fmi3DoStep"):
            fmu.doStep(0.0, TS)
    assert said[:4] == ["the step is no multiple of the sample time, 0.1 s"] * 4
    assert said[4] == "the step does not begin where the last one ended"
    assert said[-1] == "a step before the initialization ended, or after the end"


@needs_compiler
def test_the_sources_compile_against_the_headers_of_fmi(tmp_path: Path) -> None:
    headers = Path(fmpy.__file__).parent / "c-code"
    assert (headers / "fmi3Functions.h").is_file()
    compiled("all", tmp_path, f"-I{headers}", "-Werror=missing-prototypes", "-Wmissing-prototypes")


@needs_compiler
def test_an_importer_simulates_the_archive(tmp_path: Path) -> None:
    folder = compiled("all", tmp_path / "unpacked")
    path = tmp_path / "brake.fmu"
    path.write_bytes(
        packed({p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()})
    )
    found = fmpy.simulate_fmu(
        str(path), stop_time=10 * TS, output_interval=TS, start_values={"setpoint": 0.05}, output=["output"]
    )
    assert found["output"][0] == 0.0
    assert len(set(found["output"])) == 11

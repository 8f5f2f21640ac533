"""Structured text: parsed by blark, typed strictly, and run from its parse tree against the vectors, bit for bit."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases.targets import STRUCTURES, Row, exported, rows_of, structures

from fopi_tune.digital.export_c import Export
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.targets import Target, export_target
from fopi_tune.digital.vectors import Op

pytest.importorskip("blark", reason="no blark: structured text is not parsed and run")

from oracles.structured_text import FunctionBlock

PRECISIONS = {Precision.FLOAT64: ("LREAL", "f64"), Precision.FLOAT32: ("REAL", "f32")}


def text_of(export: Export, precision: Precision) -> str:
    text = export_target(export, Target.STRUCTURED_TEXT)[f"fopi_brake_1_2_{PRECISIONS[precision][1]}.st"]
    assert isinstance(text, str)
    return text


@cache
def parsed(structure: str, precision: Precision) -> FunctionBlock:
    """An export's block: to parse it takes a second."""
    return FunctionBlock.of(text_of(exported(structure), precision))


def block_of(structure: str, precision: Precision) -> FunctionBlock:
    """A new instance of it."""
    block = parsed(structure, precision)
    block.start()
    return block


def first_difference(block: FunctionBlock, rows: tuple[Row, ...], precision: Precision) -> Row | None:
    """The first row whose output is not met to the last bit."""
    dtype = precision.dtype
    with np.errstate(all="ignore"):
        for row in rows:
            one = row.operation
            output = block(
                setpoint=one.setpoint,
                measurement=one.measurement,
                applied=one.output,
                track=one.op is Op.TRACK,
                reset=one.op is Op.RESET,
            )
            assert type(output) is dtype
            if output.tobytes() != dtype(row.output).tobytes():
                return row
    return None


def test_texts_of_others_cannot_end_the_comment() -> None:
    hostile = "*) x := 1; (* **) ((*)) {attribute 'hide'} // (* \\ $N"
    export = replace(exported("proportional"), description=hostile, tool=hostile)
    text = text_of(export, Precision.FLOAT64)
    assert text.count("(*") == text.count("*)") == 1
    assert FunctionBlock.of(text)(setpoint=1.0) == 1.5


@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_first_vectors_of_a_controller_with_every_part_are_met_bit_for_bit(precision: Precision) -> None:
    rows = rows_of("all", precision)[:1000]
    assert {row.operation.op for row in rows} == {Op.STEP, Op.TRACK, Op.RESET}
    assert not all(np.isfinite(row.operation.measurement) for row in rows)
    assert first_difference(block_of("all", precision), rows, precision) is None


@pytest.mark.parametrize("precision", PRECISIONS)
@structures("fopi")
def test_the_vectors_are_met_bit_for_bit(structure: str, precision: Precision) -> None:
    rows = rows_of(structure, precision)
    assert len(rows) > 2000
    assert first_difference(block_of(structure, precision), rows, precision) is None


def test_a_coefficient_that_is_off_in_its_last_place_is_seen() -> None:
    text, precision = text_of(exported("fopi"), Precision.FLOAT64), Precision.FLOAT64
    found = re.search(r"tracking_gain : LREAL := LREAL#(\S+);", text)
    assert found is not None
    spoiled = text.replace(found.group(1), repr(float(np.nextafter(float(found.group(1)), 2.0))))
    assert first_difference(FunctionBlock.of(spoiled), rows_of("fopi"), precision) is not None


@pytest.mark.thinned(slow=["fopid", "weighted-float32", "lagged_proportional-float64", "derivative-float32"])
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("structure", STRUCTURES)
def test_every_structure_parses_and_is_typed(structure: str, precision: Precision) -> None:
    block, (type_, suffix) = block_of(structure, precision), PRECISIONS[precision]
    assert block.name == f"FOPI_BRAKE_1_2_{suffix.upper()}"
    inputs = [name for name, one in block.variables.items() if one.section == "input"]
    assert inputs == ["setpoint", "measurement", "applied", "track", "reset"]
    assert {one.type for one in block.variables.values()} <= {type_, "BOOL", "INT"}
    # nothing is declared in vain
    text = text_of(exported(structure), precision)
    assert [name for name in block.variables if len(re.findall(rf"\b{name}\b", text)) < 2] == []


def test_a_new_instance_is_at_rest_at_the_limit_next_to_0() -> None:
    block = block_of("fopi", Precision.FLOAT64)
    assert block.memory["output"] == 0.1
    before = list(block.memory["x"])
    block(setpoint=1.0)
    assert block.memory["x"] != before
    block(reset=True)
    assert (block.memory["output"], block.memory["x"]) == (0.1, before)


def test_equal_controllers_give_equal_bytes_of_ascii() -> None:
    files = export_target(exported("all"), Target.STRUCTURED_TEXT)
    assert files == export_target(exported("all"), Target.STRUCTURED_TEXT)
    for content in files.values():
        assert isinstance(content, str)
        assert content.isascii()
        assert max(map(len, content.splitlines())) <= 120

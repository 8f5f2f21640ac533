"""The bytes of a file of a frequency response -> its curve, and its standard deviations.

What a message says of a file is a line, a column and what to do; nothing of a file is quoted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.measured.curve import FEWEST_POINTS, Curve
from fopi_tune.core.text_tables.table import Table, Wanted, counted, number, read_table
from fopi_tune.errors import DomainError
from fopi_tune.spec.frequency_response.columns import HEADER, Column, Role, columns_of

#: bytes and lines of a file
MAX_BYTES, MAX_LINES = 4 * 2**20, 20_000
#: relative; frequencies that are closer are the same
_SAME = 1e-9
#: the largest standard deviation of ln P: with twice as much the response is known to half of its size
_LARGEST_DEVIATION = 0.25
#: |P| beyond these is no measurement
_LARGEST_LOG = math.log(1e15)
#: a phase this large, in rad, is in another unit
_LARGEST_PHASE = 1e4
_WANTED = Wanted(
    HEADER, "a frequency", "a frequency response needs a frequency, and a magnitude and a phase", quotes=False
)


@dataclass(frozen=True)
class Response:
    """What a file says.

    Args:
        curve: the measured response.
        gain_deviation: standard deviation of ln|P| at each point; None without one in the file.
        phase_deviation: of arg P, rad; that of ln|P| where the file has none of its own.
    """

    curve: Curve
    gain_deviation: Array | None
    phase_deviation: Array | None


#: rad/s; a frequency below cannot be computed with
_SMALLEST = 1e-100


def read_response(data: bytes, dead_time_s: float) -> Response:
    """The response in a file's bytes.

    Args:
        data: CSV in UTF-8.
        dead_time_s: further dead time, not in the data.

    Raises:
        DomainError: not such a file; says the line and what to do.
    """
    if len(data) > MAX_BYTES:
        raise DomainError(f"is larger than {MAX_BYTES // 2**20} MiB; keep fewer frequencies or digits")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise DomainError(f"line {line} has a byte that is not UTF-8; save the file as CSV in UTF-8") from None
    table = read_table(text, _WANTED)
    if table.cut is not None:
        raise DomainError(f"line {table.cut[0]}, the last, is cut short; complete it or remove it")
    if len(table.lines) > MAX_LINES:
        raise DomainError(f"has {len(table.lines)} frequencies; keep at most {MAX_LINES}")
    columns = columns_of(table)
    lines = [line for line, _ in table.lines]
    values = {role: _numbers(table, column, lines) for role, column in columns.items()}
    omega = values[Role.FREQUENCY] * columns[Role.FREQUENCY].factor
    order = _order(omega, lines)
    log_gain, phase = _log_response(values, columns, lines)
    gain_deviation, phase_deviation = _deviations(values, columns, lines, log_gain)
    if len(order) < FEWEST_POINTS:
        found = counted(len(order), "frequency").replace("frequencys", "frequencies")
        raise DomainError(f"has {found}; measure at {FEWEST_POINTS} or more")
    curve = Curve(omega[order], log_gain[order], phase[order], dead_time_s)
    if gain_deviation is None or phase_deviation is None:
        return Response(curve, None, None)
    return Response(curve, gain_deviation[order], phase_deviation[order])


def _numbers(table: Table, column: Column, lines: list[int]) -> Array:
    values = np.empty(len(lines))
    for row, text in enumerate(table.fields([column.index])[0]):
        value = None if ":" in text else number(text, table.separator)
        if value is None:
            raise DomainError(
                f"line {lines[row]}, {column.title}: not a finite number; write it, or remove the line where nothing "
                "was measured"
            )
        values[row] = value
    return values


def _order(omega: Array, lines: list[int]) -> NDArray[np.intp]:
    """The rows by ascending frequency; files may have them ascending or descending."""
    wrong = np.flatnonzero(omega <= 0.0)
    if wrong.size:
        raise DomainError(
            f"line {lines[wrong[0]]}: its frequency is not greater than 0; remove the line, a response is measured at "
            "frequencies above 0"
        )
    _refuse_rows(omega < _SMALLEST, lines, "its frequency cannot be computed with; is its unit right?")
    ascending = np.argsort(omega, kind="stable")
    sorted_omega = omega[ascending]
    twice = np.flatnonzero(sorted_omega[1:] <= sorted_omega[:-1] * (1.0 + _SAME))
    if twice.size:
        first, second = sorted((lines[ascending[twice[0]]], lines[ascending[twice[0] + 1]]))
        raise DomainError(f"line {second} has the frequency of line {first}; keep one of them, or their mean")
    steps = np.diff(omega)
    if len(steps) and (steps > 0.0).any() and (steps < 0.0).any():
        rises = int((steps > 0.0).sum()) * 2 >= len(steps)
        row = int(np.flatnonzero(steps < 0.0 if rises else steps > 0.0)[0]) + 1
        word = "below" if rises else "above"
        raise DomainError(
            f"line {lines[row]}: its frequency is {word} that of line {lines[row - 1]}; sort the lines by frequency"
        )
    return ascending


def _log_response(values: dict[Role, Array], columns: dict[Role, Column], lines: list[int]) -> tuple[Array, Array]:
    """ln|P| and arg P of each line."""
    if Role.REAL in values:
        response = values[Role.REAL] + 1j * values[Role.IMAGINARY]
        size, phase = np.abs(response), np.angle(response)
        _refuse_rows(size <= 0.0, lines, "the response is 0; remove the line, nothing was measured there")
        log_gain = np.log(size)
    else:
        magnitude, column = values[Role.MAGNITUDE], columns[Role.MAGNITUDE]
        if column.is_db:
            log_gain = magnitude * column.factor
        else:
            _refuse_rows(
                magnitude <= 0.0, lines, "the magnitude is not greater than 0; if it is in dB, call its column "
                "magnitude_db, else remove the line",
            )  # fmt: skip
            log_gain = np.log(magnitude)
        phase = values[Role.PHASE] * columns[Role.PHASE].factor
    what = "the magnitude is beyond 300 dB; give absolute values, or dB under magnitude_db"
    _refuse_rows(np.abs(log_gain) > _LARGEST_LOG, lines, what)
    _refuse_rows(np.abs(phase) > _LARGEST_PHASE, lines, "the phase is beyond 1500 turns; is its unit right?")
    return log_gain, phase


def _deviations(
    values: dict[Role, Array], columns: dict[Role, Column], lines: list[int], log_gain: Array
) -> tuple[Array | None, Array | None]:
    """Standard deviations of ln|P| and of arg P, rad."""
    if Role.DEVIATION not in values:
        return None, None
    column, own = columns[Role.DEVIATION], values[Role.DEVIATION]
    _refuse_rows(own < 0.0, lines, "the standard deviation is negative; write it as a positive number")
    gain = own * column.factor if column.is_db else own * np.exp(-log_gain)
    phase = gain
    if Role.PHASE_DEVIATION in values:
        phase = values[Role.PHASE_DEVIATION] * columns[Role.PHASE_DEVIATION].factor
        _refuse_rows(phase < 0.0, lines, "the standard deviation of the phase is negative; write it as positive")
    too_large = (gain > _LARGEST_DEVIATION) | (phase > _LARGEST_DEVIATION)
    _refuse_rows(
        too_large, lines, "the standard deviation exceeds a quarter of the response, or 14 deg; remove the line, "
        "so little was measured there",
    )  # fmt: skip
    return gain, phase


def _refuse_rows(wrong: NDArray[np.bool_], lines: list[int], why: str) -> None:
    rows = np.flatnonzero(wrong)
    if rows.size:
        raise DomainError(f"line {lines[rows[0]]}: {why}")

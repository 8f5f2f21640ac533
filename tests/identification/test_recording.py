"""Files of recordings as people have them: separators, headers or none, units, comments, damage, what is refused."""

from __future__ import annotations

import random

import numpy as np
import pytest
from cases.field_recordings import FIELD_FILES
from cases.fuzz import damaged

from fopi_tune.errors import DomainError
from fopi_tune.identification import ReadOptions, Recording, TimeUnit, parse_recording, recording_from_arrays

HEADER = "time_s,input,output"


def rows(count: int = 20, step_at: int = 5) -> list[str]:
    return [f"{k},{0 if k < step_at else 1},{max(0, k - step_at)}" for k in range(count)]


def file(*lines: str) -> str:
    return "\n".join(lines)


def changed(line: int, text: str) -> str:
    """A usable file with another text on one of its lines, counted from 1."""
    lines = [HEADER, *rows()]
    lines[line - 1] = text
    return file(*lines)


def assert_usual(found: Recording, unit_s: float = 1.0) -> None:
    """What `rows()` says."""
    assert found.time_s.tolist() == pytest.approx([k * unit_s for k in range(20)], rel=1e-15)
    assert found.input.tolist() == [0.0] * 5 + [1.0] * 15
    assert found.output.tolist() == [max(0, k - 5) for k in range(20)]


# -- separators and headers --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("separator", [";", "\t", " ", "   "])
@pytest.mark.parametrize("point", [".", ","])
def test_semicolons_tabs_and_blanks_separate_too_and_leave_the_comma_to_decimals(separator: str, point: str) -> None:
    lines = ["time_s,input,output", *(f"{k}.5,{k // 8}.25,{k}e-1" for k in range(16))]
    text = "\n".join(line.replace(",", separator).replace(".", point) for line in lines)
    found = parse_recording(text, "a.csv")
    assert found.time_s.tolist() == [k + 0.5 for k in range(16)]
    assert found.input.tolist() == [k // 8 + 0.25 for k in range(16)]
    assert found.output.tolist() == [float(f"{k}e-1") for k in range(16)]


def test_commas_and_blanks_together_separate_once() -> None:
    assert_usual(parse_recording(file(HEADER, *(row.replace(",", ",  ") for row in rows())), "a.csv"))


@pytest.mark.parametrize(
    "head",
    [
        (HEADER,),
        ('"Time_s", INPUT,Output',),
        ("time_s;input;output",),  # other separators than the lines of numbers have
        ("Time,Input,Output", "s,V,rpm"),
        ("Logger 7", "exported today", "Zeit,Eingang,Ausgang"),
        ("# time input output", "# one more remark, of the logger"),
        ("% remark", "// remark"),
        (),
    ],
)
def test_there_may_be_any_header_or_none(head: tuple[str, ...]) -> None:
    assert_usual(parse_recording(file(*head, *rows()), "a.csv"))


def test_columns_may_stand_in_any_order_and_a_file_may_end_in_empty_lines() -> None:
    lines = [f"{y}, {t} ,{u}" for t, u, y in (row.split(",") for row in rows())]
    assert_usual(parse_recording("\ufeffoutput, time_s,input\r\n" + "\r\n".join(lines) + "\r\n\r\n", "a.csv"))


def test_blank_lines_and_comments_between_lines_are_left_out_and_lines_keep_their_numbers() -> None:
    lines = [HEADER, *rows()]
    found = parse_recording(file(*lines[:3], "", "# pump on", *lines[3:]), "a.csv")
    assert_usual(found)
    assert found.lines.tolist() == [2, 3, *range(6, 24)]


def test_separators_at_the_end_of_every_line_make_no_column() -> None:
    assert_usual(
        parse_recording(file(HEADER.replace(",", ";") + ";", *(r.replace(",", ";") + ";" for r in rows())), "a")
    )


# -- columns and times -------------------------------------------------------------------------------------------------


def wide() -> str:
    """Five columns, one of words; input and output are the second and the fourth."""
    parts = [row.split(",") for row in rows()]
    head = '"Time (sec)",Heater 1 (%),"Heater 2 (%)",Temperature 1 (degC),State'
    return file(head, *(f"{t},{u},0,{y},OK" for t, u, y in parts))


@pytest.mark.parametrize(
    ("input", "output"),
    [("2", "4"), ("Heater 1 (%)", "Temperature 1 (degC)"), ("heater 1", "temp"), ("2", "Temperature 1 (degC)")],
)
def test_columns_are_named_by_name_part_of_a_name_or_number(input: str, output: str) -> None:
    assert_usual(parse_recording(wide(), "a.csv", ReadOptions(input=input, output=output)))


def test_a_file_that_does_not_tell_its_columns_is_refused_with_what_it_has() -> None:
    with pytest.raises(
        DomainError, match=r"a\.csv: line 1 has 5 columns, 1 'Time \(sec\)', 2 'Heater 1 \(%\)'.*--input"
    ):
        parse_recording(wide(), "a.csv")
    with pytest.raises(DomainError, match=r"'heater' is in 2 names.*2 'Heater 1"):
        parse_recording(wide(), "a.csv", ReadOptions(input="heater", output="4"))
    with pytest.raises(DomainError, match="no column '6', which --output names; line 1 has 5 columns"):
        parse_recording(wide(), "a.csv", ReadOptions(input="2", output="6"))
    with pytest.raises(DomainError, match="one column is named for two"):
        parse_recording(wide(), "a.csv", ReadOptions(input="2", output="2"))


def test_columns_of_names_that_say_nothing_are_taken_in_their_order_and_that_is_said() -> None:
    text = file("tiempo;voltaje;velocidad", *(row.replace(",", ";") for row in rows()))
    found = parse_recording(text, "a.csv")
    assert_usual(found)
    assert found.notes == ("time is column 1 'tiempo', input is column 2 'voltaje', output is column 3 'velocidad'",)
    assert parse_recording(file(HEADER, *rows()), "a.csv").notes == ()


def test_the_process_variable_of_a_controller_is_the_output() -> None:
    parts = [row.split(",") for row in rows()]
    found = parse_recording(file("Time,PV,OP", *(f"{t},{y},{u}" for t, u, y in parts)), "a.csv")
    assert_usual(found)
    assert found.guess == "time is column 1 'Time', input is column 3 'OP', output is column 2 'PV'"


@pytest.mark.parametrize(("off", "on"), [("OFF", "ON"), ("False", "True")])
def test_the_input_may_be_that_of_a_switch(off: str, on: str) -> None:
    parts = [row.split(",") for row in rows()]
    assert_usual(parse_recording(file(HEADER, *(f"{t},{on if u == '1' else off},{y}" for t, u, y in parts)), "a.csv"))


def test_a_minus_may_be_the_printed_one() -> None:
    parts = [row.split(",") for row in rows()]
    found = parse_recording(file(HEADER, *(f"{t},{u},\u2212{y}" for t, u, y in parts)), "a.csv")
    assert found.output.tolist() == [-max(0, k - 5) for k in range(20)]


def test_one_column_is_refused_as_that() -> None:
    with pytest.raises(DomainError, match=r"a\.csv: its lines have one number each; .* its input and its output"):
        parse_recording(file("level", *(f"{k}" for k in range(20))), "a.csv")


@pytest.mark.parametrize(("sample_time", "unit"), [(0.008, None), (8.0, TimeUnit.MILLISECONDS)])
def test_a_file_without_times_has_a_given_sample_time(sample_time: float, unit: TimeUnit | None) -> None:
    text = file(*(row.partition(",")[2] for row in rows()))
    assert_usual(parse_recording(text, "a.csv", ReadOptions(sample_time=sample_time, time_unit=unit)), 0.008)
    with pytest.raises(
        DomainError, match="line 1 has 2 columns without names, '0,0', and no times: give --sample-time"
    ):
        parse_recording(text, "a.csv")


@pytest.mark.parametrize(
    ("name", "given", "unit_s"),
    [
        ("t_ms", None, 1e-3),
        ("Time [ms]", None, 1e-3),
        ("time (min)", None, 60.0),
        ("time", TimeUnit.MICROSECONDS, 1e-6),
        ("t_ms", TimeUnit.SECONDS, 1.0),
        ("seconds", None, 1.0),
        ("Time (sec)", None, 1.0),
        ("hours", TimeUnit.HOURS, 3600.0),
    ],
)
def test_the_unit_of_times_is_given_or_in_their_name(name: str, given: TimeUnit | None, unit_s: float) -> None:
    text = file(f"{name},input,output", *rows())
    assert_usual(parse_recording(text, "a.csv", ReadOptions(time_unit=given)), unit_s)


def test_times_of_the_day_and_dates_are_times() -> None:
    clock = file("clock,u,y", *(f"09:59:{50 + k:02d}.5,{k // 3},{k}" for k in range(10)), "10:00:01,3,10")
    assert np.diff(parse_recording(clock, "a").time_s).tolist() == pytest.approx([1.0] * 9 + [1.5])
    dates = file("date;u;y", *(f"2024-03-01 00:{k:02d}:00;{k // 3};{k}" for k in range(12)))
    assert np.diff(parse_recording(dates, "a").time_s).tolist() == pytest.approx([60.0] * 11)
    # over the end of a February, fractions with a decimal comma
    days = ("29.02.2024 23:59:59,5", *(f"1.3.2024 0:00:{k:02d},5" for k in range(11)))
    dotted = file("Datum;u;y", *(f"{day};{k // 3},0;{k},25" for k, day in enumerate(days)))
    assert np.diff(parse_recording(dotted, "a").time_s).tolist() == pytest.approx([1.0] * 11)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("when", "'03/01/2024 08:00:00' of column 1 is no time: write times as 2024-03-01 08:00:00, .* or give --time"),
        ("time", "line 2, column 'time': '03/01/2024 08:00:00' is not a finite number; write times as 2024-03-01"),
    ],
)
def test_a_date_whose_month_is_not_known_is_refused_with_what_to_write(name: str, words: str) -> None:
    text = file(f"{name},u,y", *(f"03/01/2024 08:{k:02d}:00,{k // 3},{k}" for k in range(12)))
    with pytest.raises(DomainError, match=words):
        parse_recording(text, "a.csv")


def test_a_window_keeps_its_outputs_and_the_input_from_before() -> None:
    found = parse_recording(file("t_ms,input,output", *rows()), "a.csv", ReadOptions(start=4.0, end=15.0))
    assert np.flatnonzero(found.used).tolist() == list(range(4, 16))
    assert len(found.time_s) == 16
    with pytest.raises(DomainError, match=r"has 5 samples in the window; the record is from 0 s to 0\.019 s"):
        parse_recording(file("t_ms,input,output", *rows()), "a.csv", ReadOptions(start=15.0))


# -- damage ------------------------------------------------------------------------------------------------------------


def test_a_last_line_that_is_cut_short_is_left_out_and_that_is_said() -> None:
    found = parse_recording(file(HEADER, *rows(), "20,1"), "a.csv")
    assert_usual(found)
    assert found.notes == ("line 22, the last, is cut short ('20,1'): left out",)


def test_lines_of_equal_times_are_merged_and_named() -> None:
    found = parse_recording(file(HEADER, "0,0,-1", "0,0,1", *rows()[1:]), "a.csv")
    assert_usual(found)
    assert found.notes == ("line 3: the time of the line before, merged with it",)
    twice = file(HEADER, *(row for row in rows() for _ in range(2)))
    assert (
        "times are too coarse for their lines, 0.487 s apart: give --sample-time"
        in parse_recording(twice, "a").notes[0]
    )


def test_lines_without_an_output_are_left_out_and_named() -> None:
    for missing in ("2,0,nan", "2,0,"):
        found = parse_recording(changed(4, missing), "a.csv")
        assert not found.used[2]
        assert found.used.sum() == 19
        assert found.notes == ("line 4: no output, left out",)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "has no lines of numbers; write the header time_s,input,output"),
        (HEADER, "has no lines of numbers"),
        (file(HEADER, *rows(1)), "has 1 sample; a fit with intervals needs at least 10"),
        (file(HEADER, *rows(9)), "has 9 samples"),
        (
            file("some words", "of a letter", "to a friend", "1,2,3", "1,2,4"),
            "most of its lines are no lines of numbers",
        ),
        (changed(4, "2;0;0"), "line 4 has 1 field, '2;0;0'; the others have 3"),
        (changed(4, "2,0"), "line 4 has 2 fields, '2,0'; the others have 3"),
        (changed(4, "2,0,1,5"), "line 4 has 4 fields, '2,0,1,5'; the others have 3"),
        (changed(4, "2,0,1.000,5").replace(",", ";"), "line 4 has 4 fields"),
        (
            changed(4, "2,0,1.000|5").replace(",", ";").replace("|", ","),
            "line 4, column 'output': '1.000,5' is not a finite",
        ),
        (changed(4, "2,0,fast"), "line 4, column 'output': 'fast' is not a finite number"),
        (changed(4, "2,0,inf"), "line 4, column 'output': 'inf' is not a finite number"),
        (changed(4, "2,,0"), "line 4, column 'input': '' is not a finite number; write the value that it had then"),
        (changed(4, "x,0,0"), "line 4, column 'time_s' (time): 'x' is not a finite number"),
        (changed(9, HEADER), "line 9, column 'input': 'input' is not a finite number"),
        (changed(4, "0.5,0,0"), "line 4: time 0.5 s is before 1 s of line 3; sort by time, or keep one run of several"),
        (file(HEADER, *rows(), *rows()), "line 22: time 0 s is before 19 s of line 21"),
        (file(HEADER, *("3" + row[row.index(",") :] for row in rows())), "every line has the time 3 s"),
        (file("output,input", *(row.partition(",")[2] for row in rows())), "and no times: give --sample-time"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_with_its_line(text: str, said: str) -> None:
    with pytest.raises(DomainError) as caught:
        parse_recording(text, "a.csv")
    assert str(caught.value).startswith("a.csv: ")
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (ReadOptions(sample_time=0.0), "not greater than 0"),
        (ReadOptions(sample_time=1.0, time="1"), "leave one of them out"),
        (ReadOptions(time="clock"), "no column 'clock', which --time names"),
    ],
)
def test_options_that_cannot_be_followed_are_refused(options: ReadOptions, said: str) -> None:
    with pytest.raises(DomainError, match=said):
        parse_recording(file(HEADER, *rows()), "a.csv", options)


def test_damaged_files_are_taken_or_refused() -> None:
    rng = random.Random(4)
    texts = [file(HEADER, *rows()), FIELD_FILES["staircase_in_milliseconds"](1).text, wide()]
    taken = 0
    for _ in range(300):
        text = damaged(rng.choice(texts).encode(), rng).decode("utf-8", errors="replace")
        try:
            found = parse_recording(text, "a.csv")
        except DomainError:
            continue
        taken += 1
        assert np.all(np.diff(found.time_s) > 0)
        assert np.isfinite(found.output[found.used]).all()
        assert found.used.sum() >= 10
    assert 20 < taken < 280


# -- arrays ------------------------------------------------------------------------------------------------------------


def test_arrays_and_lists_are_taken_as_files_are() -> None:
    lists = [[float(part) for part in column] for column in zip(*(row.split(",") for row in rows()), strict=True)]
    assert_usual(recording_from_arrays(lists[0], lists[1], lists[2]))
    lists[2][3] = float("nan")
    lists[0][8] = lists[0][7]
    found = recording_from_arrays(*(np.array(column) for column in lists), start_s=2.0)
    assert found.notes == ("sample 8: the time of the sample before, merged with it",)
    assert np.flatnonzero(~found.used).tolist() == [0, 1, 3]


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ((range(12), range(12), range(11)), r"data: times, input and output must be one-dimensional and of one length"),
        ((["a"] * 12, range(12), range(12)), "must be numbers"),
        ((range(12), [float("inf")] * 12, range(12)), "sample 0, input: inf is not a finite number"),
        ((range(12, 0, -1), range(12), range(12)), "data: sample 1: time 11 s is before 12 s of sample 0, and 10 more"),
        ((range(5), range(5), range(5)), "data: has 5 samples"),
        (([], [], []), "data: has 0 samples"),
    ],
)
def test_arrays_that_are_no_recording_are_refused(arrays: tuple[object, object, object], said: str) -> None:
    with pytest.raises(DomainError, match=said):
        recording_from_arrays(*arrays)

"""The page of a system's certificate:  well formed, complete, without network, the same bytes twice."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from cases import switched
from cases.pages import HOSTILE, Page

from fopi_tune.report.system_page import SYSTEM_REPORT, system_report_files
from fopi_tune.report.words import in_words


def page_of(memory: str) -> str:
    return str(system_report_files(switched.certificate(memory))[SYSTEM_REPORT])


@pytest.mark.parametrize("memory", ["reset", "held"])
def test_a_page_is_well_formed_small_and_needs_no_network(memory: str) -> None:
    text = page_of(memory)
    page = Page(text)
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert len(text) < 2_000_000
    assert page.tags["script"] == page.figures_scripts
    assert page.asked == []
    assert "default-src 'none'" in text


def test_the_page_has_every_statement_orbit_and_bound() -> None:
    held, reset = switched.certificate("held"), switched.certificate("reset")
    of_held, of_reset = (" ".join("".join(Page(page_of(each)).text).split()) for each in ("held", "reset"))
    assert "cycles. A periodic orbit is named" in of_held
    assert "settles. The output settles on every setpoint of the range" in of_reset
    for said in reset.statements:
        assert in_words(said) in of_reset
    for each in held.cycles:
        assert f"setpoint {each.setpoint:g}, brake time constant = {each.plants[1]['time_constant_s']:g}" in of_held
        assert f"{each.lowest:+.4g}" in of_held
    assert "Bounds of the memories" in of_reset
    assert "brake plant lag: " in of_reset.replace("brakeplant", "brake plant")


def test_the_output_has_its_unit_where_it_is_known() -> None:
    held = switched.certificate("held")
    known, unknown = (str(system_report_files(held, unit)[SYSTEM_REPORT]) for unit in ("km/h", ""))
    for words in ("output, km/h", "setpoint, km/h", "Deviations are from the setpoint, in km/h.", "0.5 km/h on both"):
        assert words in known
    assert "km/h" not in unknown
    assert "in the output&#39;s unit." in unknown


def test_an_undecided_system_says_what_is_still_proved() -> None:
    reset = switched.certificate("reset")
    undecided = replace(reset, settling=None, reason="the level set is not reached")
    text = "".join(Page(str(system_report_files(undecided)[SYSTEM_REPORT])).text)
    assert "What is still proved, and how far the proof came, is below." in text
    assert "Under every switching" in text
    assert "Not proved: the level set is not reached." in text
    assert "there is nothing to draw" in text


def test_the_same_certificate_gives_the_same_bytes() -> None:
    assert system_report_files(switched.certificate("held")) == system_report_files(switched.certificate("held"))


def test_hostile_names_are_shown_and_not_obeyed() -> None:
    reset = replace(switched.certificate("reset"), name=HOSTILE)
    text = str(system_report_files(reset)[SYSTEM_REPORT])
    assert Page(text).tags["script"] == Page(text).figures_scripts
    assert HOSTILE in "".join(Page(re.sub(r"<svg.*?</svg>", "", text, flags=re.DOTALL)).text)

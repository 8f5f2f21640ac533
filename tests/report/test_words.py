"""Words and signs of pages against the identifiers they stand for."""

from __future__ import annotations

import pytest

from fopi_tune.quantities import QUANTITIES
from fopi_tune.report.text.formatting import TIE
from fopi_tune.report.words import in_words, name_and_unit
from fopi_tune.spec.measures import MEASURES


@pytest.mark.parametrize(
    ("written", "shown"),
    [
        ("phase_margin_deg >= 80", "phase margin ≥ 80°"),
        ("sensitivity_db <= -20", f"|S| ≤ −20{TIE}dB"),
        ("settling_time_s <= 3", f"settling time ≤ 3{TIE}s"),
        ("overshoot <= 0.1", "overshoot ≤ 0.1"),
        (f"with time_constant_s{TIE}={TIE}3.1", f"with time constant{TIE}={TIE}3.1{TIE}s"),
        ("peak_rate_per_s <= 2", f"peak rate ≤ 2{TIE}per s"),
        ("at brake.time_constant_s = 1.6", f"at brake time constant = 1.6{TIE}s"),
        ("omega, rad/s", "ω, rad/s"),
        ("crossover_rad_s at_least 2.5 (family)", f"crossover ≥ 2.5{TIE}rad/s (family)"),
        ("minimize phase_margin_spread_deg", "minimize phase margin spread"),
    ],
)
def test_a_known_identifier_becomes_words_and_its_value_takes_the_unit(written: str, shown: str) -> None:
    assert in_words(written) == shown


@pytest.mark.parametrize("written", ["mass_kg = 3", "numerator[0] = 2", "my_own_name = 1e-3", "plant x_s_y"])
def test_names_of_a_family_stay_as_they_were_written(written: str) -> None:
    assert in_words(written) == written


def test_every_quantity_and_measure_with_a_unit_in_its_name_has_it_apart() -> None:
    for name in (*QUANTITIES, *MEASURES):
        words, unit = name_and_unit(name)
        assert "_" not in words + unit
        ends = ("_s", "_deg", "_db", "_s2", "_per_decade")
        assert bool(unit) is name.endswith(ends), name

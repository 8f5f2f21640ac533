"""Names of columns: what they say of role and unit."""

from __future__ import annotations

import math

import pytest

from fopi_tune.core.text_tables.table import Table
from fopi_tune.errors import DomainError
from fopi_tune.spec.frequency_response.columns import Role, columns_of


def _columns(*names: str, units: tuple[str, ...] = ()) -> dict[Role, tuple[int, float]]:
    table = Table(names, units, (), ",", len(names), None, None)
    return {role: (column.index, column.factor) for role, column in columns_of(table).items()}


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("omega_rad_s", 1.0), ("omega", 1.0), ("w", 1.0), ("ω [rad/s]", 1.0), ("Angular frequency (rad/s)", 1.0),
        ("frequency_hz", 2 * math.pi), ("freqHz", 2 * math.pi), ("f (kHz)", 2e3 * math.pi), ("Hz", 2 * math.pi),
    ],
)  # fmt: skip
def test_a_frequency_has_its_unit_in_its_name(name: str, factor: float) -> None:
    assert _columns(name, "magnitude", "phase_rad")[Role.FREQUENCY] == (0, pytest.approx(factor))


def test_a_line_of_units_counts_to_the_names() -> None:
    found = _columns("Frequency", "Mag", "Phase", units=("Hz", "dB", "°"))
    assert found[Role.PHASE] == (2, pytest.approx(math.radians(1.0)))
    assert found[Role.MAGNITUDE] == (1, pytest.approx(math.log(10.0) / 20.0))


def test_other_columns_are_left_out() -> None:
    assert set(_columns("omega", "re", "im", "coherence", "time", "n")) == {Role.FREQUENCY, Role.REAL, Role.IMAGINARY}


def test_a_deviation_has_the_unit_of_its_magnitude() -> None:
    found = _columns("omega", "magnitude_db", "phase_deg", "magnitude_std")
    assert found[Role.DEVIATION][1] == pytest.approx(math.log(10.0) / 20.0)
    assert _columns("omega", "magnitude", "phase_deg", "std")[Role.DEVIATION][1] == 1.0


@pytest.mark.parametrize(
    "name",
    [
        "frequency",
        "f_ghz",
        "rpm",
        "omega_rpm",
        "omega_krad_s",
        "omega_mrad_s",
        "omega_deg_s",
        "omega_rad_min",
        "omega_rad_s (Hz)",
    ],
)
def test_a_frequency_without_a_known_unit_is_refused(name: str) -> None:
    with pytest.raises(DomainError, match="omega_rad_s or frequency_hz"):
        _columns(name, "magnitude", "phase_rad")


@pytest.mark.parametrize("name", ["attenuation_db", "magnitude_squared", "magnitude_percent", "log10_magnitude"])
def test_a_magnitude_in_another_unit_is_refused(name: str) -> None:
    with pytest.raises(DomainError, match="column 2 is a magnitude that is neither an absolute value nor in dB"):
        _columns("omega", name, "phase_rad")


def test_a_lag_is_no_phase_and_what_is_of_other_signals_is_left_out() -> None:
    with pytest.raises(DomainError, match="column 3 is a lag or a delay; write the phase"):
        _columns("omega", "magnitude", "phase_lag_deg")
    found = _columns("omega", "input_magnitude_db", "magnitude", "phase_rad", "magnitude_variance")
    assert found[Role.MAGNITUDE] == (2, 1.0)

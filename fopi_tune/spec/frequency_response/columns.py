"""Columns of a file of a frequency response:  a header's names -> roles and units.

A name is cut into words, and its words say what the column is and its unit, as in `omega_rad_s`, `Frequency (Hz)`,
`mag [dB]`, `phase_deg`, `Re(P)`.  A line of units below the names counts to them.  Columns with other names, such as a
coherence, are left out.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import StrEnum

from fopi_tune.core.text_tables.table import Table
from fopi_tune.errors import DomainError

#: the header that needs no explanation
HEADER = "omega_rad_s,magnitude_db,phase_deg"


class Role(StrEnum):
    """What a column is; the value is its name in messages."""

    FREQUENCY = "frequency"
    MAGNITUDE = "magnitude"
    PHASE = "phase"
    REAL = "real part"
    IMAGINARY = "imaginary part"
    DEVIATION = "standard deviation of the magnitude"
    PHASE_DEVIATION = "standard deviation of the phase"


@dataclass(frozen=True)
class Column:
    """A column that is used.

    Args:
        index: from 0.
        role: what it is.
        factor: from its unit to rad/s, an absolute value or rad; of dB to neper.
        is_db: whether a magnitude, or its standard deviation, is in dB.
    """

    index: int
    role: Role
    factor: float = 1.0
    is_db: bool = False

    @property
    def title(self) -> str:
        """For messages, which quote nothing of a file."""
        return f"column {self.index + 1} ({self.role.value})"


_ANGULAR = frozenset(("omega", "w", "ω", "kreisfrequenz", "angular", "omegas"))
_FREQUENCY = _ANGULAR | {"frequency", "frequencies", "freq", "f", "frequenz", "frecuencia", "frequence", "fréquence"}
_MAGNITUDE = frozenset(
    ("magnitude", "mag", "gain", "amplitude", "amp", "abs", "absolute", "modulus", "betrag", "ratio", "amplification")
)
_PHASE = frozenset(("phase", "phi", "φ", "arg", "argument", "angle", "winkel", "phases"))
_REAL = frozenset(("real", "re", "realteil"))
_IMAGINARY = frozenset(("imag", "im", "imaginary", "imaginärteil", "img"))
_DEVIATION = frozenset(("std", "stdev", "stddev", "sigma", "σ", "sd", "deviation"))
_DEGREES = frozenset(("deg", "degree", "degrees", "°"))
_RADIANS = frozenset(("rad", "radian", "radians"))
_DB = frozenset(("db", "decibel"))
#: of columns that are something else
_OTHERS = frozenset(("coherence", "variance", "input", "reference", "weight"))
#: units and ways of writing that are not known, by what they are of
_FOREIGN_FREQUENCY = frozenset(
    ("rpm", "krad", "mrad", "urad", "min", "minute", "rev", "turns", "cycles", "normalized", "normalised", "log")
)
_FOREIGN_MAGNITUDE = frozenset(("attenuation", "loss", "squared", "square", "percent", "log", "power", "psd"))
_FOREIGN_PHASE = frozenset(("lag", "delay", "turns"))
_HERTZ = {"hz": 1.0, "hertz": 1.0, "mhz": math.nan, "khz": 1e3, "ghz": math.nan}
_NEPER_PER_DB = math.log(10.0) / 20.0


def columns_of(table: Table) -> dict[Role, Column]:
    """The columns that are used, by their roles.

    Raises:
        DomainError: there is no header, a unit is missing, two columns have one role, or one that is needed is missing.
    """
    if not table.names:
        raise DomainError(f"no line names its columns; write the header {HEADER} above the numbers")
    units = table.units if len(table.units) == len(table.names) else ("",) * len(table.names)
    found: dict[Role, Column] = {}
    for index, (name, unit) in enumerate(zip(table.names, units, strict=True)):
        column = _column(index, _words(f"{name} {unit}"))
        if column is None:
            continue
        if column.role in found:
            both = f"columns {found[column.role].index + 1} and {index + 1}"
            raise DomainError(
                f"{both} are both a {column.role.value}; keep one of them, or give the other another name"
            )
        found[column.role] = column
    _check(found)
    magnitude, deviation = found.get(Role.MAGNITUDE), found.get(Role.DEVIATION)
    if magnitude is not None and deviation is not None and magnitude.is_db and not deviation.is_db:
        # the unit of what it is the deviation of
        found[Role.DEVIATION] = Column(deviation.index, Role.DEVIATION, _NEPER_PER_DB, True)
    return found


def _words(text: str) -> frozenset[str]:
    # omegaRadS and magdB are cut as omega_rad_s and mag_db
    spaced = re.sub(r"([kMG]?)Hz", r" \1hz ", text.replace("dB", " db "))
    cut = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", spaced)
    return frozenset(re.findall(r"[^\W\d_]+|°", cut.lower()))


def _column(index: int, words: frozenset[str]) -> Column | None:
    if words & _OTHERS:
        return None
    is_db = bool(words & _DB)
    if words & _DEVIATION:
        if words & _PHASE:
            return Column(index, Role.PHASE_DEVIATION, _angle(index, words))
        return Column(index, Role.DEVIATION, _NEPER_PER_DB if is_db else 1.0, is_db)
    if words & _PHASE:
        if words & _FOREIGN_PHASE:
            raise DomainError(
                f"column {index + 1} is a lag or a delay; write the phase, negative where the response is late, and "
                "call it phase_deg or phase_rad"
            )
        return Column(index, Role.PHASE, _angle(index, words))
    if words & _FREQUENCY or words & set(_HERTZ):
        return Column(index, Role.FREQUENCY, _frequency(index, words))
    if words & _REAL:
        return Column(index, Role.REAL)
    if words & _IMAGINARY:
        return Column(index, Role.IMAGINARY)
    if words & _MAGNITUDE or is_db:
        if words & _FOREIGN_MAGNITUDE:
            raise DomainError(
                f"column {index + 1} is a magnitude that is neither an absolute value nor in dB, or an attenuation; "
                "write one of the two, and call it magnitude or magnitude_db"
            )
        return Column(index, Role.MAGNITUDE, _NEPER_PER_DB if is_db else 1.0, is_db)
    return None


def _angle(index: int, words: frozenset[str]) -> float:
    if words & _DEGREES:
        return math.radians(1.0)
    if words & _RADIANS:
        return 1.0
    raise DomainError(f"column {index + 1} is a phase whose unit is not named; call it phase_deg or phase_rad")


def _frequency(index: int, words: frozenset[str]) -> float:
    hertz = next((unit for unit in _HERTZ if unit in words), None)
    is_foreign = bool(words & (_FOREIGN_FREQUENCY | _DEGREES)) or (hertz is not None and bool(words & _RADIANS))
    if not is_foreign and hertz is not None and math.isfinite(_HERTZ[hertz]):
        return 2.0 * math.pi * _HERTZ[hertz]
    if not is_foreign and hertz is None and (words & _RADIANS or words & _ANGULAR):
        return 1.0
    raise DomainError(
        f"column {index + 1} is a frequency whose unit is not rad/s, Hz or kHz, or not named; call it omega_rad_s or "
        "frequency_hz"
    )


def _check(found: dict[Role, Column]) -> None:
    if Role.FREQUENCY not in found:
        raise DomainError(f"has no column of frequencies; call it omega_rad_s or frequency_hz, as in {HEADER}")
    polar = [role for role in (Role.MAGNITUDE, Role.PHASE) if role in found]
    parts = [role for role in (Role.REAL, Role.IMAGINARY) if role in found]
    if len(polar) == 2 and parts:
        raise DomainError("has magnitude and phase, and real or imaginary part besides; keep one way of writing it")
    if len(polar) < 2 and len(parts) < 2:
        raise DomainError(
            "needs a magnitude and a phase, or a real and an imaginary part, beside the frequency; call the columns "
            f"{HEADER}, or omega_rad_s,real,imag"
        )
    if polar and len(parts) == 2:
        raise DomainError(f"has real and imaginary part, and a {polar[0].value} besides; keep one way of writing it")
    if Role.PHASE_DEVIATION in found and Role.DEVIATION not in found:
        raise DomainError(
            "has a standard deviation of the phase and none of the magnitude; add magnitude_std, or leave it out"
        )

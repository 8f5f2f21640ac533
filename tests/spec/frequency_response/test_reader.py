"""Files of frequency responses, as drives and test benches write them; and what is wrong with others."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from cases.fuzz import damaged
from cases.measured import LAG, csv, response

from fopi_tune.errors import DomainError
from fopi_tune.spec.frequency_response.reader import MAX_BYTES, read_response

OMEGA = np.geomspace(0.1, 10.0, 9)
P = response(LAG, OMEGA)
DB, DEG = 20.0 * np.log10(np.abs(P)), np.degrees(np.angle(P))


def _table(header: str, *columns: np.ndarray, separator: str = ",", comma: bool = False) -> bytes:
    lines = [header]
    for row in zip(*columns, strict=True):
        text = separator.join(f"{value:.12g}" for value in row)
        lines.append(text.replace(".", ",") if comma else text)
    return "\n".join(lines).encode() + b"\n"


@pytest.mark.parametrize(
    "data",
    [
        _table("omega_rad_s,magnitude_db,phase_deg", OMEGA, DB, DEG),
        _table("omega_rad_s,magnitude,phase_rad", OMEGA, np.abs(P), np.angle(P)),
        _table("frequency_hz,real,imag", OMEGA / (2 * np.pi), P.real, P.imag),
        _table("Frequency (Hz);Gain (dB);Phase (deg)", OMEGA / (2 * np.pi), DB, DEG, separator=";", comma=True),
        _table("f [kHz]\tmag [dB]\tphase [°]", OMEGA / (2e3 * np.pi), DB, DEG, separator="\t"),
        _table("w,Re(P),Im(P)", OMEGA, P.real, P.imag),
        _table("omega,|P| abs,arg (rad),coherence", OMEGA, np.abs(P), np.angle(P), np.ones(9)),
        _table("Frequency,Magnitude,Phase\nHz,dB,deg", OMEGA / (2 * np.pi), DB, DEG),
        _table("# drive 7\n% sweep\n\nfreqHz,magdB,phaseDeg", OMEGA / (2 * np.pi), DB, DEG),
        _table("phase_deg,magnitude_db,omega_rad_s", DEG, DB, OMEGA),
        _table("omega_rad_s,magnitude_db,phase_deg", OMEGA[::-1], DB[::-1], DEG[::-1]),
        _table("omega_rad_s,magnitude_db,phase_deg", OMEGA, DB, np.mod(DEG, 360.0)),
        b"\xef\xbb\xbf" + _table("omega_rad_s,magnitude_db,phase_deg", OMEGA, DB, DEG).replace(b"\n", b"\r\n"),
        _table("# omega_rad_s,magnitude_db,phase_deg", OMEGA, DB, DEG),
    ],
)
def test_what_benches_write_is_read(data: bytes) -> None:
    found = read_response(data, 0.0)
    np.testing.assert_allclose(found.curve.omega_rad_s, OMEGA, rtol=1e-9)
    np.testing.assert_allclose(np.exp(found.curve.log_gain + 1j * found.curve.phase_rad), P, rtol=1e-8)
    assert found.gain_deviation is None


@pytest.mark.parametrize(
    ("header", "gain", "deviation", "phase"),
    [
        ("omega_rad_s,magnitude,phase_deg,magnitude_std", np.abs(P), 0.02 * np.abs(P), None),
        ("omega_rad_s,magnitude_db,phase_deg,std", DB, np.full(9, 0.02 * 20.0 / math.log(10.0)), None),
        ("omega_rad_s,magnitude_db,phase_deg,sigma_db,phase_std_deg", DB, np.full(9, 0.02 * 20.0 / math.log(10.0)),
         np.full(9, math.degrees(0.05))),
    ],
)  # fmt: skip
def test_standard_deviations_become_those_of_ln_p(
    header: str, gain: np.ndarray, deviation: np.ndarray, phase: np.ndarray | None
) -> None:
    found = read_response(_table(header, OMEGA, gain, DEG, deviation, *([] if phase is None else [phase])), 0.0)
    assert found.gain_deviation is not None
    assert found.phase_deviation is not None
    np.testing.assert_allclose(found.gain_deviation, 0.02, rtol=1e-9)
    np.testing.assert_allclose(found.phase_deviation, 0.02 if phase is None else 0.05, rtol=1e-9)


def _lines(changed: dict[int, str], header: str = "omega_rad_s,magnitude_db,phase_deg") -> bytes:
    """A file whose line 2 is the first of numbers, with some lines replaced."""
    lines = [header, *(f"{w:.6g},{a:.6g},{b:.6g}" for w, a, b in zip(OMEGA, DB, DEG, strict=True))]
    for number, text in changed.items():
        lines[number - 1] = text
    return "\n".join(lines).encode()


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"", "has no lines of numbers; write the header omega_rad_s,magnitude_db,phase_deg"),
        (_lines({4: "0.3,NaN,-20"}), r"line 4, column 2 \(magnitude\): not a finite number; .*remove the line"),
        (_lines({4: "0.3,,-20"}), r"line 4, column 2 \(magnitude\): not a finite number"),
        (_lines({4: "0.3,-1,12:30"}), r"line 4, column 3 \(phase\): not a finite number"),
        (_lines({3: "0.1,-1,-20"}), "line 3 has the frequency of line 2; keep one of them"),
        (_lines({6: "0.2,-1,-20"}), "line 6: its frequency is below that of line 5; sort the lines by frequency"),
        (_lines({2: "0,0,0"}), "line 2: its frequency is not greater than 0"),
        (_lines({2: "-1,0,0"}), "line 2: its frequency is not greater than 0"),
        (_lines({2: "1e-320,0,0"}), "line 2: its frequency cannot be computed with"),
        (_lines({3: "1" * 200_000 + ",0,0"}), r"line 3, column 1 \(frequency\): not a finite number"),
        (_lines({5: "0.5,1,2,3"}), "line 5 has 4 fields; the others have 3"),
        (_lines({10: "10,-20"}), "line 10, the last, is cut short"),
        (_lines({}, "a,b,c"), "has no column of frequencies; call it omega_rad_s or frequency_hz"),
        (_lines({}, "frequency,magnitude_db,phase_deg"), "column 1 is a frequency whose unit is not"),
        (_lines({}, "frequency_mhz,magnitude_db,phase_deg"), "column 1 is a frequency whose unit is not"),
        (_lines({}, "omega,magnitude_db,phase"), "column 3 is a phase whose unit is not named"),
        (_lines({}, "omega,magnitude_db,other"), "needs a magnitude and a phase, or a real and an imaginary part"),
        (_lines({}, "omega,magnitude_db,real"), "needs a magnitude and a phase"),
        (_lines({}, "omega,gain_db,mag_db"), "columns 2 and 3 are both a magnitude"),
        (_lines({}, "omega,magnitude,phase_deg"), "line 2: the magnitude is not greater than 0; if it is in dB"),
        (_lines({}).split(b"\n", 1)[1], "no line names its columns; write the header"),
        (b"\n".join(_lines({}).split(b"\n")[:5]), "has 4 frequencies; measure at 5 or more"),
        (_lines({3: "0.2,1e9,-20"}), "line 3: the magnitude is beyond 300 dB"),
        (_lines({3: "0.2,-1,1e9"}), "line 3: the phase is beyond 1500 turns"),
        (_lines({3: "0.2,\xe4,1".encode("latin-1").decode("latin-1")}, "omega,gain_db,phase_deg").replace(
            "\xe4".encode(), b"\xe4"), "line 3 has a byte that is not UTF-8"),
        (b"x" * (MAX_BYTES + 1), "is larger than 4 MiB"),
        (_table("omega,magnitude,phase_deg,std", OMEGA, np.abs(P), DEG, 0.3 * np.abs(P)), "exceeds a quarter"),
        (_table("omega,magnitude,phase_deg,std", OMEGA, np.abs(P), DEG, -np.abs(P)), "deviation is negative"),
        (_table("omega,magnitude,phase_deg,phase_std_deg", OMEGA, np.abs(P), DEG, DEG), "none of the magnitude"),
        (_table("omega,real,imag", OMEGA, 0.0 * DB, 0.0 * DB), "line 2: the response is 0"),
        (_table("omega,real,imag,gain_db", OMEGA, DB, DB, DB), "a magnitude besides"),
        (_table("omega,real,gain_db,phase_deg", OMEGA, DB, DB, DB), "real or imaginary part besides"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_line(data: bytes, told: str) -> None:
    with pytest.raises(DomainError, match=told):
        read_response(data, 0.0)


def test_nothing_of_a_file_is_quoted() -> None:
    secret = "hunter2"
    for data in (
        f"user,password\nroot,{secret}\n" * 20,
        f"omega_rad_s,magnitude_db,phase_deg\n1,2,3\n2,{secret},4\n3,1,1\n4,1,1\n5,1,1\n",
        f"{secret},b,c\n1,2,3\n2,3,4\n3,4,5\n4,5,6\n5,6,7\n",
        f"omega_rad_s,magnitude_db,phase_deg\n1,2,3\n2,3,4\n3,{secret},{secret},1\n4,5,6\n5,6,7\n",
    ):
        with pytest.raises(DomainError) as refused:
            read_response(data.encode(), 0.0)
        assert secret not in str(refused.value)


@pytest.mark.thinned(4)
@pytest.mark.parametrize("seed", range(8))
def test_damaged_files_are_read_or_refused(seed: int) -> None:
    chance = random.Random(seed)
    good = [
        csv(LAG, points=20), csv(LAG, points=20, deviation=0.05),
        _table("Frequency (Hz);Gain (dB);Phase (deg)", OMEGA, DB, DEG, separator=";", comma=True),
    ]  # fmt: skip
    refused = 0
    for _ in range(100):
        try:
            found = read_response(damaged(chance.choice(good), chance), 0.0)
        except DomainError:
            refused += 1
            continue
        assert np.isfinite(found.curve.log_at(found.curve.u)).all()
    assert refused

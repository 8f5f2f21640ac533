"""What a sample costs, against the exported code itself with numbers that count their operations."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.digital import Export, discretize, export_c
from fopi_tune.digital.implementation import step_cost
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.spec.model import DigitalSpec

#: a number whose additions and multiplications are counted
_COUNTED = """
#include <cstdio>
struct Counted {
    double value;
    static int additions, multiplications;
    Counted() = default;
    constexpr Counted(double number) : value(number) {}
};
int Counted::additions, Counted::multiplications;
static Counted operator+(Counted a, Counted b) { ++Counted::additions; return a.value + b.value; }
static Counted operator-(Counted a, Counted b) { ++Counted::additions; return a.value - b.value; }
static Counted operator*(Counted a, Counted b) { ++Counted::multiplications; return a.value * b.value; }
static Counted operator-(Counted a) { return -a.value; }
static Counted &operator+=(Counted &a, Counted b) { return a = a + b; }
static Counted &operator-=(Counted &a, Counted b) { return a = a - b; }
static bool operator<(Counted a, Counted b) { return a.value < b.value; }
static bool operator>(Counted a, Counted b) { return a.value > b.value; }
static bool operator<=(Counted a, Counted b) { return a.value <= b.value; }
static bool operator>=(Counted a, Counted b) { return a.value >= b.value; }
"""
_MAIN = """
int main() {
    PREFIX_state state;
    PREFIX_init(&state);
    PREFIX_step(&state, 0.1, 0.0);
    Counted::additions = Counted::multiplications = 0;
    PREFIX_step(&state, 50.0, 0.1);
    std::printf("%d %d %zu", Counted::multiplications, Counted::additions, sizeof state);
}
"""
_CASES = [
    (FoPi(0.4, 0.4, 0.8), 1.0, None, None),
    (FoPi(0.4, 0.4, 1.0), 0.7, (-1.0, 1.0), None),
    (FoPi(1.5, 0.0, 1.0), 1.0, (-1.0, 1.0), 0.5),
    (Pid(2.0, 1.0, 0.8, 0.15), 0.7, (-100.0, 100.0), 0.5),
    (Pid(2.0, 0.0, 0.8, 0.15, measurement_filter=MeasurementFilter(1, 0.3)), 1.0, None, None),
    (FoPid(2.0, 1.0, 1.2, 0.8, 0.6, 0.15, measurement_filter=MeasurementFilter(2, 0.3)), 0.7, (-100.0, 100.0), 0.5),
]


@pytest.mark.thinned(3)
@pytest.mark.skipif(not shutil.which("g++"), reason="g++ is not found")
@pytest.mark.parametrize(("gains", "weight", "limits", "rate"), _CASES)
def test_the_operations_of_a_sample_are_those_of_the_code(
    tmp_path: Path, gains: FoPi, weight: float, limits: tuple[float, float] | None, rate: float | None
) -> None:
    controller = discretize(gains, DigitalSpec(0.1))
    export = Export(
        "x", "", "0" * 64, "fopi-tune 0", controller, limits=limits, rate_per_s=rate, setpoint_weight=weight
    )
    files = export_c(export)
    runtime = Runtime.of(controller.sections, Precision.FLOAT64, limits, rate, weight, gains.measurement_filter)
    (header,) = (name for name in files if name.endswith("f64.h"))
    prefix = header.removesuffix(".h")
    texts = (re.sub(r"\bdouble\b", "Counted", files[f"{prefix}.{end}"]) for end in ("h", "c"))
    for end, text in zip(("h", "c"), texts, strict=True):
        (tmp_path / f"{prefix}.{end}").write_text(text, encoding="ascii")
    program = _COUNTED + f'#include "{prefix}.c"\n' + _MAIN.replace("PREFIX", prefix)
    (tmp_path / "main.cpp").write_text(program, encoding="ascii")
    subprocess.run(["g++", "-std=c++17", "-w", "-o", "count", "main.cpp"], cwd=tmp_path, check=True)
    counted = subprocess.run([tmp_path / "count"], capture_output=True, text=True, check=True).stdout.split()
    cost = step_cost(runtime)
    assert [int(number) for number in counted] == [cost.multiplications, cost.additions, cost.state_bytes_float64]
    numbers = re.findall(r"-?0x[\da-f.]+p[+-]?\d+", files[f"{prefix}.c"])
    assert len(numbers) == cost.coefficients
    told = f"{cost.multiplications} multiplications and {cost.additions} additions, beside comparisons; "
    told += f"{cost.state_bytes_float64} bytes of state and {8 * len(numbers)} of coefficients"
    assert told in " ".join(files[header].replace("\n *", " ").split())


def test_a_float_takes_half_the_room() -> None:
    controller = discretize(FoPi(0.4, 0.4, 0.8), DigitalSpec(0.1))
    cost = step_cost(Runtime.of(controller.sections, Precision.FLOAT32))
    assert cost.state_bytes_float64 == 2 * cost.state_bytes_float32
    assert cost.state_bytes_float32 == 4 * (len(controller.sections.poles) + 1)


def test_the_header_counts_one_of_a_thing_as_one() -> None:
    files = export_c(Export("x", "", "0" * 64, "t", discretize(FoPi(1.5, 0.0, 1.0), DigitalSpec(0.1, poles=1))))
    (header,) = (" ".join(text.replace("\n *", " ").split()) for name, text in files.items() if name.endswith("f64.h"))
    assert "at most 1 multiplication and 1 addition, beside" in header
    assert "tustin, 1 pole for" in header

"""Exported C on a Cortex-M4 with its FPU:  compiled by gcc for ARM, run by QEMU, its instructions counted one by one.

QEMU runs the processor's instructions and not its pipeline: what is counted are instructions, and not cycles.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fopi_tune.digital.export_c import literal
from fopi_tune.digital.vectors import Op, Operation

HERE = Path(__file__).parent
GCC, SIZE, QEMU, NM = "arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm", "arm-none-eabi-nm"
MACHINE = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
FLAGS = [*MACHINE, "-O2", "-std=c99", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion"]
#: a line of QEMU's log: the address of an instruction that is executed
EXECUTED = re.compile(r"^Trace \d+: \w+ \[\w+/(\w+)/", re.MULTILINE)
_LONGEST_S = 60.0
_MEASURED = """#include "{prefix}.h"

static const {type} inputs[][2] = {{
{rows}
}};

int main(void)
{{
    static {prefix}_state state;
    volatile {type} output;
    unsigned k;

    {prefix}_init(&state);
    for (k = 0; k < sizeof inputs / sizeof inputs[0]; ++k) {{
        output = {prefix}_step(&state, inputs[k][0], inputs[k][1]);
    }}
    (void)output;
    return 0;
}}
"""


@dataclass(frozen=True)
class Cost:
    """What a step costs on the processor.

    Args:
        most: instructions of the longest step.
        median: of the step in the middle.
        code_bytes: of the object file: instructions, constants and coefficients; without the compiler's library.
    """

    most: int
    median: int
    code_bytes: int


def missing() -> str:
    """Why nothing can be run; empty where it can."""
    absent = [tool for tool in (GCC, SIZE, NM, QEMU) if not shutil.which(tool)]
    if not absent and not _said([GCC, *MACHINE, "--print-file-name=rdimon-crt0.o"]).strip().startswith("/"):
        absent = ["newlib's library for semihosting"]
    return f"no {', no '.join(absent)}: C is not run on a Cortex-M4" if absent else ""


def compiler_version() -> str:
    """The version of gcc for ARM, as 12.2.1."""
    return _said([GCC, "-dumpfullversion"]).strip()


def compiled(folder: Path, sources: Sequence[str], *flags: str) -> Path:
    """The program of C files in a folder."""
    _said([GCC, *FLAGS, *flags, "-Werror", "-c", *sources], folder)
    _said([GCC, *MACHINE, "-O2", "-c", str(HERE / "startup.c")], folder)
    start = _said([GCC, *MACHINE, "--print-file-name=rdimon-crt0.o"]).strip()
    objects = ["startup.o", *(f"{source.removesuffix('.c')}.o" for source in sources), start]
    linked = ["--specs=rdimon.specs", "-nostartfiles", "-T", str(HERE / "mps2.ld"), "-o", "program.elf"]
    _said([GCC, *MACHINE, *objects, *linked], folder)
    return folder / "program.elf"


def emulated(program: Path, *arguments: str, options: Sequence[str] = ()) -> subprocess.CompletedProcess[str]:
    """The program after its run; it reads the files of its folder."""
    given = "".join(f",arg={word}" for word in (program.name, *arguments))
    machine = ["-M", "mps2-an386", "-nographic", "-monitor", "none", "-serial", "none"]
    command = [QEMU, *machine, "-semihosting-config", f"enable=on,target=native{given}", "-kernel", program.name]
    return subprocess.run(
        [*command, *options], cwd=program.parent, capture_output=True, text=True, check=False, timeout=_LONGEST_S
    )


def cost_of(folder: Path, prefix: str, type_: str, operations: Sequence[Operation]) -> Cost:
    """What the steps among operations cost.

    Args:
        folder: with the header and the source.
        prefix: of its functions and files.
        type_: `double` or `float`.
        operations: of which the steps are made, one after the other.
    """
    suffix = "f" if type_ == "float" else ""
    steps = [one for one in operations if one.op is Op.STEP]
    rows = [f"    {{{literal(one.setpoint, suffix)}, {literal(one.measurement, suffix)}}}," for one in steps]
    (folder / "measure.c").write_text(_MEASURED.format(prefix=prefix, type=type_, rows="\n".join(rows)))
    program = compiled(folder, ["measure.c", f"{prefix}.c"])
    symbols = {name: int(at, 16) for at, _, name in map(str.split, _said([NM, program.name], folder).splitlines())}
    first, end, step = (symbols[name] for name in ("controller_begin", "controller_end", f"{prefix}_step"))
    one_by_one = ["-singlestep"] if "-singlestep" in _said([QEMU, "--help"]) else ["-accel", "tcg,one-insn-per-tb=on"]
    log = ["-d", "exec,nochain", "-D", "log.txt", "-dfilter", f"{first:#x}..{end - 1:#x}"]
    done = emulated(program, options=[*one_by_one, *log])
    assert (done.returncode, done.stderr) == (0, "")
    addresses = [int(address, 16) for address in EXECUTED.findall((folder / "log.txt").read_text())]
    begins = [k for k, address in enumerate(addresses) if address == step]
    assert len(begins) == len(steps)
    counts = sorted(end - begin for begin, end in zip(begins, [*begins[1:], len(addresses)], strict=True))
    text, data, bss = map(int, _said([SIZE, f"{prefix}.o"], folder).splitlines()[1].split()[:3])
    assert data == bss == 0
    return Cost(counts[-1], counts[len(counts) // 2], text)


def _said(command: Sequence[str], folder: Path | None = None) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout

"""JSON of every kind of results, as the command line writes it:  commands that together end in every outcome."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from cases.measured import TWO, csv, text_of
from cases.plant_lists import MISMATCH
from cases.project import ROOT
from cases.scenario_designs import brake
from typer.testing import CliRunner

from fopi_tune.cli import app
from fopi_tune.results.schema.kinds import RESULT_KINDS

SPECS, SYSTEMS, STUDIES = (ROOT / name for name in ("specs", "systems", "studies"))
BRAKE = (SPECS / "brake.yaml").read_text(encoding="utf-8")
FIXED = ("--kp", "0.44651", "--ki", "0.37033", "--alpha", "0.83197")
PUBLISHED = ("--kp", "0.07", "--ki", "0.11", "--alpha", "0.45")
_PID = """schema: 1
name: pid
plant: {parameters: {k: {min: 1, max: 2}}, model: transfer_function, numerator: [k], denominator: [1, 2, 1],
  dead_time_s: 0.2}
controller: {structure: pid, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, kd: {min: 0, max: 20},
  derivative_filter_time_constant_s: 0.1, measurement_filter: {order: 2, time_constant_s: 0.1}, setpoint_weight: 0.7}
requirements: [{sensitivity_db: {at_most: 4.5}}, {control_sensitivity_db: {at_most: 30}},
  {sensitivity_db: {at_most: {by_frequency: [[0.01, -10], [0.1, -5]]}}}]
objective: {minimize: iae_disturbance}
digital: {sample_time_s: 0.05, design: sampled, output_limits: [-10, 10], output_rate_per_s: 50}
"""
#: files that commands name: name to text
TEXTS: dict[str, str] = {
    "infeasible.yaml": BRAKE.replace("at_least: 80", "at_least: 89").replace("at_most: -20", "at_most: -40"),
    "unbounded.yaml": "schema: 1\nname: endless\nplant: {model: lag, static_gain: 1, time_constant_s: 2}\n"
    "requirements: [{phase_margin_deg: {at_least: 45}}]\n",
    "limited.yaml": BRAKE.replace("delay_samples: 0}", "delay_samples: 0.5, output_limits: [-1, 1]}").replace(
        "equals: 90", "at_least: 80"
    ),
    "list.yaml": MISMATCH + "digital: {sample_time_s: 0.1, design: sampled}\nvalidation: {samples: 128}\n"
    "scenarios: [{name: step, duration_s: 20, reference: [{at_s: 1, value: 1}]}]\n"
    "limits: [{overshoot: {at_most: 0.6}}]\n",
    "heat.yaml": "schema: 1\nname: heat\n"
    "plant: {model: fractional, numerator: [{coefficient: {min: 60, max: 72}, order: 0}],"
    " denominator: [{coefficient: 12.72, order: 0.5}, {coefficient: 1, order: 0}], dead_time_s: 1.93}\n"
    "controller: {structure: pi}\nrequirements: [{phase_margin_deg: {at_least: 60}}, {sensitivity_db: {at_most: 4}}]\n"
    "objective: {maximize: ki}\n",
    "measured.yaml": text_of(
        "{model: frequency_response, file: frf.csv, unstable_poles: 0}",
        "[{phase_margin_deg: {at_least: 50}}, {sensitivity_db: {at_most: 5}}]",
        "{maximize: ki}",
        "{structure: pi, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}}",
        "digital: {sample_time_s: 0.05}\n",
    ),
    "stop.yaml": brake("stop", "step").replace(
        "objective:", "  - {rise_time_s: {at_most: 40}, scenario: step}\nobjective:"
    ),
    "pid.yaml": _PID,
    "small.yaml": f"schema: 1\nname: small\nspecs: [{(SPECS / 'brake.yaml').as_posix()}]\n"
    "grid: {digital.delay_samples: [0, 1]}\nstages: [tune]\ncollect: {kp: tune.gains.kp}\n"
    "best: {minimize: kp, where: [{column: kp, at_most: 9}]}\n",
    "none.yaml": f"schema: 1\nname: none\nspecs: [{(SPECS / 'brake.yaml').as_posix()}]\n"
    "grid: {digital.delay_samples: [0, 1]}\nstages: [tune]\ncollect: {kp: tune.gains.kp}\n"
    "best: {minimize: kp, where: [{column: kp, at_most: -9}]}\n",
}
_BRAKE, _SMOOTH = str(SPECS / "brake.yaml"), str(SPECS / "brake_continuous.yaml")
_CAR, _HELD, _HEATER = (str(SYSTEMS / name) for name in ("car.yaml", "car_held.yaml", "examples/heater_with_fan.yaml"))
#: by name: commands in order, each with the kind of what `--json` prints; later ones find what earlier ones wrote
COMMANDS: dict[str, list[tuple[str, tuple[str, ...]]]] = {
    "solved on samples": [("run", ("run", _BRAKE))],
    "solved in continuous time": [
        ("design", ("tune", _SMOOTH)),
        ("recheck", ("prove", "--recheck", "OUT/certificate.json")),
    ],
    "not proved": [("design", ("tune", _BRAKE, "--no-proof"))],
    "prices": [("design", ("tune", _SMOOTH, "--prices"))],
    "optimum": [
        ("design", ("tune", _SMOOTH, "--certify-optimum", "--gap", "0.05")),
        ("optimum_recheck", ("prove", "--recheck", "OUT/optimum.json", _SMOOTH)),
    ],
    "trade-off": [("tradeoff", ("tune", _SMOOTH, "--tradeoff", "5", "--points", "3"))],
    "violated": [("check", ("prove", _BRAKE, *PUBLISHED)), ("recheck", ("prove", "--recheck", "OUT/certificate.json"))],
    "unstable": [("check", ("prove", _BRAKE, "--kp", "-2", "--ki", "1", "--alpha", "0.9"))],
    "violated on samples": [("digital", ("discretize", _BRAKE, *PUBLISHED))],
    "evidence": [("evidence", ("validate", _BRAKE, *FIXED, "--samples", "100"))],
    "simulation": [("simulation", ("simulate", _BRAKE, *FIXED))],
    "simulation of a drawn plant": [("simulation", ("simulate", _BRAKE, *FIXED, "--replay", "3"))],
    "simulation in continuous time": [("simulation", ("simulate", _BRAKE, *FIXED, "--exact", "--accuracy", "1e-3"))],
    "infeasible": [("run", ("run", "infeasible.yaml"))],
    "unbounded": [("run", ("run", "unbounded.yaml"))],
    "limits of the control": [("run", ("run", "limited.yaml")), ("check", ("prove", "limited.yaml"))],
    "a list of plants": [
        ("run", ("run", "list.yaml")),
        ("evidence", ("validate", "list.yaml")),
        ("simulation", ("simulate", "list.yaml")),
        ("check", ("prove", "list.yaml", "--kp", "3", "--ki", "0.3")),
    ],
    "a fractional plant": [("run", ("run", "heat.yaml"))],
    "measured responses": [
        ("run", ("run", "measured.yaml")),
        ("check", ("prove", "measured.yaml", "--kp", "5", "--ki", "5")),
    ],
    "requirements on scenarios": [("run", ("run", "stop.yaml")), ("design", ("tune", "stop.yaml", "--prices"))],
    "derivative and filters": [("run", ("run", "pid.yaml"))],
    "undecided": [("design", ("tune", str(ROOT / "tests/cases/field/phase_lead_side.yaml")))],
    "a system that settles": [
        ("system_proof", ("prove", _CAR)),
        ("system_recheck", ("prove", "--recheck", "OUT/system_certificate.json")),
        ("system_simulation", ("simulate", _CAR)),
        ("system_evidence", ("validate", _CAR, "--samples", "30")),
        ("system_digital", ("discretize", _CAR)),
    ],
    "a system that cycles": [("system_proof", ("prove", _HELD)), ("system_simulation", ("simulate", _HELD, "--exact"))],
    "an undecided system": [
        ("system_proof", ("prove", _HEATER)),
        ("system_simulation", ("simulate", _HEATER, "--replay", "2")),
        ("system_digital", ("discretize", str(SYSTEMS / "examples/motor_with_chopper.yaml"))),
        ("system_proof", ("prove", str(SYSTEMS / "examples/train.yaml"))),
    ],
    "a designed system": [("system_design", ("tune", str(SYSTEMS / "car_comfort.yaml")))],
    "a study": [
        ("study_cells", ("study", "small.yaml", "--dry-run")),
        ("study", ("study", "small.yaml", "--workers", "0", "--progress", "jsonl")),
        ("study_status", ("study", "--status", "OUT")),
    ],
    "a study without a best cell": [("study", ("study", "none.yaml", "--workers", "0"))],
}
#: those that take at most two seconds
QUICK = (
    "not proved", "violated", "evidence", "simulation", "infeasible", "unbounded",
    "a system that settles", "a study",
)  # fmt: skip


def documents_of(name: str, folder: Path) -> list[tuple[str, str, dict[str, Any]]]:
    """What the commands of a name print and write: kind, where, and the JSON.

    Args:
        name: a key of `COMMANDS`.
        folder: empty, and the current one.
    """
    for file, text in TEXTS.items():
        (folder / file).write_text(text, encoding="utf-8")
    (folder / "frf.csv").write_bytes(csv(TWO, 0.01, 100.0, 81))
    found: list[tuple[str, str, dict[str, Any]]] = []
    for kind, arguments in COMMANDS[name]:
        words = [word.replace("OUT", "out") for word in arguments]
        reads = "--recheck" in words or "--status" in words
        result = CliRunner().invoke(app, [*words, "--json", *([] if reads else ["--out", "out"])])
        assert result.exit_code in (0, 1, 3), result.output
        found.append((kind, " ".join(arguments), json.loads(result.stdout)))
        events = [line for line in result.stderr.splitlines() if line.startswith("{")]
        found += (("study_progress", "stderr", json.loads(line)) for line in events)
    for path in sorted((folder / "out").rglob("*.json")):
        document = json.loads(path.read_text(encoding="utf-8"))
        found.append((kind_of(path.name, document), path.name, document))
    return found


def kind_of(file: str, document: dict[str, Any]) -> str:
    """The kind of a file: the only one of its name, or of several the system's where gains are those of modes."""
    kinds = [kind for kind, found in RESULT_KINDS.items() if file in found.files]
    if len(kinds) == 1:
        return kinds[0]
    of_modes = all(isinstance(each, dict) for each in document["gains"].values())
    (kind,) = (kind for kind in kinds if kind.startswith("system_") == of_modes)
    return kind

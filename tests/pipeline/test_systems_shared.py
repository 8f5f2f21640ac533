"""A system whose plants share a number: simulated, drawn, and proved with one value of it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases.shared_mass import LAGS, car, write

import fopi_tune as ft
from fopi_tune.design.systems.problem import SystemProblem
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.montecarlo.outcomes import PlantSampler
from fopi_tune.pipeline.prove_system import prove_system
from fopi_tune.pipeline.systems import simulate_system, validate_system
from fopi_tune.proof.documents import digest
from fopi_tune.proof.switched.documents import from_document, to_document
from fopi_tune.proof.switched.recheck import recheck_system
from fopi_tune.spec.model import Objective, Sense

SHARED_LAG = "  shared: [time_constant_s]"


def test_a_mass_moves_both_plants(tmp_path: Path) -> None:
    shared, apart = car(tmp_path), car(tmp_path, more="")
    one = simulate_system(shared, plant={"m": 1300.0})
    two = simulate_system(apart, plant={"throttle.m": 1300.0, "brake.m": 1300.0})
    assert one.plant == {"throttle.c": 50.0, "m": 1300.0}
    assert np.array_equal(one.driven[0].traces.output, two.driven[0].traces.output)
    other = simulate_system(apart, plant={"throttle.m": 1300.0})
    assert not np.array_equal(one.driven[0].traces.output, other.driven[0].traces.output)
    with pytest.raises(DomainError, match=r"throttle\.m"):
        simulate_system(shared, plant={"throttle.m": 1300.0})


def test_in_continuous_time_too(tmp_path: Path) -> None:
    shared, apart = car(tmp_path), car(tmp_path, more="")
    one = simulate_system(shared, plant={"m": 1300.0}, exact=True)
    two = simulate_system(apart, plant={"throttle.m": 1300.0, "brake.m": 1300.0}, exact=True)
    assert one.driven[0].measures == two.driven[0].measures


def test_pairs_are_drawn_with_one_mass(tmp_path: Path) -> None:
    shared = car(tmp_path)
    assert shared.validation is not None
    points = PlantSampler(shared.family, shared.validation).classified(0, 60).points
    assert points.shape == (60, 2)
    evidence = validate_system(shared).evidence
    (found,) = [each for each in evidence.scenarios[0].limits if each.limit is not None]
    largest = [
        simulate_system(car(tmp_path, more=""), plant={"throttle.c": c, "throttle.m": m, "brake.m": m})
        .driven[0]
        .measures["acceleration_m_s2"]
        for c, m in points.tolist()[:8]
    ]
    first = validate_system(shared, samples=8).evidence.scenarios[0].limits[0]
    assert first.worst[0].value == pytest.approx(max(largest), rel=1e-12)
    assert found.worst[0].value >= first.worst[0].value


def test_gains_are_judged_with_one_mass(tmp_path: Path) -> None:
    aim, judged = Objective(Sense.MINIMIZE, "iae", scenario="town"), []
    for more, point in (("  shared: [m]", [45.0, 950.0]), ("", [45.0, 950.0, 950.0])):
        system = replace(car(tmp_path, more=more), objective=aim)
        gains = {mode.name: mode.gains for mode in system.modes if mode.gains is not None}
        problem = SystemProblem(system, gains)
        assert problem.corners.shape == (2 ** len(point) + 1, len(point))
        found = problem.judge(gains, np.array([point]))
        assert found is not None
        judged.append(found.objective)
    assert judged[0] == judged[1]


def test_a_cycle_is_of_plants_that_share_their_number(tmp_path: Path) -> None:
    system = car(tmp_path, throttle=LAGS, brake=LAGS, more=SHARED_LAG, inactive="held")
    certificate = prove_system(system).certificate
    assert certificate.cycles
    assert all(one == other for one, other in (cycle.plants for cycle in certificate.cycles))
    document = json.loads(json.dumps(to_document(certificate)))
    assert document["shared"] == ["time_constant_s"]
    gains = {mode.name: mode.gains for mode in system.modes if mode.gains is not None}
    assert recheck_system(from_document(document), system, gains).accepted
    # without the sharing there are others, which are none of this system
    apart = prove_system(car(tmp_path, throttle=LAGS, brake=LAGS, more="", inactive="held")).certificate
    unlike = [cycle for cycle in apart.cycles if cycle.plants[0] != cycle.plants[1]]
    assert unlike
    assert not recheck_system(replace(certificate, cycles=(unlike[0],)), system, gains).accepted
    assert not recheck_system(apart, system, gains).accepted


@pytest.mark.parametrize("names", [["m"], [], ["time_constant_s", "time_constant_s"], "time_constant_s", [1]])
def test_a_certificate_says_what_both_plants_have(tmp_path: Path, names: object) -> None:
    system = car(tmp_path, throttle=LAGS, brake=LAGS, more=SHARED_LAG)
    document = json.loads(json.dumps(to_document(prove_system(system).certificate)))
    document = {key: value for key, value in (document | {"shared": names}).items() if key != "digest"}
    with pytest.raises(CertificateError, match="shared"):
        from_document({**document, "digest": digest(document)})


def test_the_command_takes_the_shared_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from typer.testing import CliRunner

    from fopi_tune.cli.commands import app

    monkeypatch.chdir(tmp_path)
    write(tmp_path)
    done = CliRunner().invoke(app, ["simulate", "car.yaml", "--plant", "m=1300", "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["plant"] == {"throttle.c": 50.0, "m": 1300.0}
    assert ft.load_system("car.yaml").shared == ("m",)

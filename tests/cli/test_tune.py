"""Options of `fopi tune` that do not go with a spec."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from fopi_tune.cli import app

_SPEC = """\
schema: 1
name: a
plant: {model: lag, static_gain: 1, time_constant_s: 2}
digital: {sample_time_s: 0.1}
scenarios: [{name: s, duration_s: 10, reference: [{at_s: 0, value: 1}]}]
objective: {minimize: iae}
"""


def test_there_is_no_bound_of_gains_for_scenarios(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text(_SPEC)
    for options, words in (
        (["--bracket"], "leave --bracket out"),
        (["--solver", "convex"], "leave --solver convex out"),
    ):
        ended = CliRunner().invoke(app, ["tune", str(file), "--out", str(tmp_path / "out"), *options])
        assert ended.exit_code == 2
        assert words in ended.stderr
        assert not (tmp_path / "out").exists()

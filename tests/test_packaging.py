"""The wheel and the source distribution: they hold what they should, and run in an environment of their own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from cases.project import ROOT
from ruamel.yaml import YAML

import fopi_tune
from fopi_tune.results.stamp import numeric_versions

FOLDERS = ("specs", "systems", "studies")


def built(folder: Path, kind: str) -> Path:
    """The wheel or the sdist of the project as it is."""
    pytest.importorskip("hatchling", reason="hatchling, of the extra `test`, builds distributions")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(folder)],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    (made,) = folder.iterdir()
    return made


def shipped() -> dict[str, bytes]:
    """The examples by their paths."""
    paths = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.yaml")]
    return {path.relative_to(ROOT).as_posix(): path.read_bytes() for path in paths}


def test_the_wheel_holds_the_package_the_examples_and_the_licence(tmp_path: Path) -> None:
    with zipfile.ZipFile(built(tmp_path, "wheel")) as wheel:
        names = wheel.namelist()
        for path, content in shipped().items():
            assert wheel.read(f"fopi_tune/examples/{path}") == content
        metadata = wheel.read(next(name for name in names if name.endswith("METADATA"))).decode()
    assert len(names) == len(set(names))
    assert "fopi_tune/py.typed" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert "Author: the fopi_tune developers" in metadata
    # beside the package only its metadata: no tests, and nothing that another project's folder could be
    assert {name.partition("/")[0] for name in names} == {"fopi_tune", f"fopi_tune-{fopi_tune.__version__}.dist-info"}


def test_the_source_distribution_holds_what_builds_and_tests_it(tmp_path: Path) -> None:
    with tarfile.open(built(tmp_path, "sdist")) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    wanted = {"pyproject.toml", "LICENSE", "README.md", "CITATION.cff", "fopi_tune/py.typed", "tests/conftest.py"}
    assert wanted | set(shipped()) <= names


def test_the_citation_is_of_this_version_and_of_the_authors_that_the_package_names() -> None:
    citation = YAML(typ="safe", pure=True).load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert citation["version"] == fopi_tune.__version__
    assert citation["authors"] == project["authors"] == [{"name": "the fopi_tune developers"}]
    assert citation["keywords"] == project["keywords"]
    assert citation["license"] == project["license"]
    required = {"cff-version", "message", "title", "authors"}
    assert required <= set(citation)
    assert re.search(r"https?:", (ROOT / "CITATION.cff").read_text(encoding="utf-8")) is None


@pytest.mark.long
@pytest.mark.parametrize("kind", ["wheel", "sdist"])
def test_an_installation_writes_and_runs_an_example(kind: str, tmp_path: Path) -> None:
    dist, environment, work = tmp_path / "dist", tmp_path / "venv", tmp_path / "work"
    for folder in (dist, work):
        folder.mkdir()
    made = built(dist, kind)
    # dependencies, and what builds the sdist, are those of this environment: nothing is fetched
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    (site,) = environment.glob("lib/python*/site-packages")
    below = [path for path in sys.path if path.endswith(("site-packages", "dist-packages"))]
    below.append(sysconfig.get_paths()["purelib"])
    (site / "dependencies.pth").write_text("\n".join(below) + "\n", encoding="utf-8")
    plain = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))}

    def run(*command: str) -> str:
        ended = subprocess.run(command, cwd=work, env=plain, capture_output=True, text=True, check=False)
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    pip = str(environment / "bin" / "pip")
    run(pip, "install", "-q", "--no-deps", "--no-index", "--no-build-isolation", "--ignore-installed", str(made))
    python, fopi = str(environment / "bin" / "python"), str(environment / "bin" / "fopi")
    where = run(python, "-c", "import fopi_tune; print(fopi_tune.__file__)").strip()
    assert Path(where).is_relative_to(site)

    run(fopi, "init", "--example", "brake")
    assert [path.relative_to(work).as_posix() for path in work.rglob("*.yaml")] == ["specs/brake.yaml"]
    assert "brake: solved" in run(fopi, "tune", "specs/brake.yaml")
    assert "sound" in run(fopi, "prove", "--recheck", "results/brake/certificate.json", "specs/brake.yaml")
    # systems and studies with the specs that they name
    run(fopi, "init", "--example", "heater_with_fan")
    assert "day" in run(fopi, "simulate", "systems/examples/heater_with_fan.yaml")
    run(fopi, "init", "--example", "hysteresis")
    assert run(fopi, "study", "studies/hysteresis.yaml", "--dry-run").count("\n") == 15
    # a cell computed in a clone need not be computed again in an installation of the same sources
    stamp = "from fopi_tune.results.stamp import numeric_versions as n; print(n()['sources'])"
    assert run(python, "-c", stamp).strip() == numeric_versions()["sources"]

"""What gets installed: one package, one command, all data, and nothing else."""

import importlib.metadata
import importlib.resources
import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from built_wheel import build_wheel

import hhsim

DATA_FOLDERS = {"objects": "hhsim/objects", "trajectories": "hhsim/trajectories"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> zipfile.ZipFile:
    """The wheel of these sources, built where it leaves nothing behind in the checkout."""
    return zipfile.ZipFile(build_wheel(repository, tmp_path_factory.mktemp("wheel")))


def test_the_version_is_the_same_everywhere(repository: Path) -> None:
    declared = tomllib.loads((repository / "pyproject.toml").read_text())["project"]["version"]
    assert declared == hhsim.__version__ == importlib.metadata.version("hhsim")


def test_the_wheel_holds_every_source_and_every_datum_and_nothing_else(
    repository: Path, wheel: zipfile.ZipFile
) -> None:
    expected = {
        *(
            path.relative_to(repository).as_posix()
            for kind in ("py", "html", "css", "js", "toml")
            for path in (repository / "hhsim").rglob(f"*.{kind}")
        ),
        "hhsim/py.typed",
        *(f"hhsim/{path.relative_to(repository).as_posix()}" for path in (repository / "cli").rglob("*.py")),
        *(
            f"{inside}/{path.relative_to(repository / folder)}"
            for folder, inside in DATA_FOLDERS.items()
            for path in (repository / folder).rglob("*")
            if path.is_file() and path.parent.name != "__pycache__"
        ),
    }
    held = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert held == expected
    assert any(name.endswith("/licenses/LICENSE") for name in wheel.namelist())


def test_the_wheel_works_where_the_sources_are_not(wheel: zipfile.ZipFile, tmp_path: Path) -> None:
    wheel.extractall(tmp_path)
    script = (
        "import sys; sys.path.insert(0, sys.argv.pop(1)); from hhsim.cli import main; print(main.__file__); main.main()"
    )
    run = subprocess.run(
        [sys.executable, "-I", "-c", script, str(tmp_path), "--version"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.splitlines() == [str(tmp_path / "hhsim" / "cli" / "main.py"), f"hhsim {hhsim.__version__}"]


def test_constraints_pin_every_dependency_and_name_no_place(repository: Path) -> None:
    lines = [line for line in (repository / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
    assert all(line.count("==") == 1 for line in lines)
    pinned = {line.split("==")[0].lower() for line in lines}
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    groups = [project["dependencies"], *project["optional-dependencies"].values()]
    declared = {name.split(">=")[0].lower() for group in groups for name in group if not name.startswith("hhsim[")}
    assert declared <= pinned

"""What gets installed: one package, one command, all data, and nothing else."""

import importlib.metadata
import importlib.resources
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
import yaml

import hhsim

DATA_FOLDERS = {name: f"hhsim/{name}" for name in ("objects", "trajectories", "examples")}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> zipfile.ZipFile:
    """The wheel of these sources, built where it leaves nothing behind in the checkout."""
    if int(importlib.metadata.version("setuptools").split(".")[0]) < 77:
        pytest.skip("building the wheel needs setuptools 77 or newer: pip install 'hhsim[test]'")
    folder = tmp_path_factory.mktemp("wheel")
    ignored = shutil.ignore_patterns(".git", ".venv", "build", "*.egg-info", "__pycache__", "results", ".*_cache")
    shutil.copytree(repository, folder / "source", ignore=ignored)
    build = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
    subprocess.run([sys.executable, "-c", build, folder], cwd=folder / "source", check=True, capture_output=True)
    (path,) = folder.glob("*.whl")
    return zipfile.ZipFile(path)


def test_the_version_is_the_same_everywhere(repository: Path) -> None:
    declared = tomllib.loads((repository / "pyproject.toml").read_text())["project"]["version"]
    assert declared == hhsim.__version__ == importlib.metadata.version("hhsim")
    citation = yaml.safe_load((repository / "CITATION.cff").read_text())
    recipe = yaml.safe_load((repository / "recipe" / "recipe.yaml").read_text())
    assert declared == citation["version"] == recipe["context"]["version"]


def test_the_recipe_of_conda_needs_what_the_package_needs(repository: Path) -> None:
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    recipe = yaml.safe_load((repository / "recipe" / "recipe.yaml").read_text())
    of_conda = {"matplotlib": "matplotlib-base"}
    expected = {}
    for name, versions in (re.fullmatch(r"([\w-]+)(.*)", line).groups() for line in project["dependencies"]):
        expected[of_conda.get(name.lower(), name.lower())] = versions
    python, *run = (line.split(" ", 1) for line in recipe["requirements"]["run"])
    assert dict(run) == expected
    least = recipe["context"]["python_min"]
    assert python[1].replace("${{ python_min }}", least) == project["requires-python"]
    assert recipe["build"]["python"]["entry_points"] == [f"hhsim = {project['scripts']['hhsim']}"]


def test_workflows_name_actions_by_their_commits(repository: Path) -> None:
    files = [*(repository / ".github" / "workflows").glob("*.yml"), *(repository / "examples").glob("*.yml")]
    used = [line.split("uses:")[1] for file in files for line in file.read_text().splitlines() if "uses:" in line]
    assert len(used) > 8
    assert [line for line in used if not re.fullmatch(r" [\w./-]+@[0-9a-f]{40} +# v[\d.]+", line)] == []


def test_a_release_states_where_its_repository_is(repository: Path, tmp_path: Path) -> None:
    (tmp_path / "recipe").mkdir()
    files = ("pyproject.toml", "CITATION.cff", "recipe/recipe.yaml")
    for name in files:
        shutil.copy(repository / name, tmp_path / name)
    script, address = repository / ".github" / "state_address.sh", "https://host.example/group/hhsim"
    subprocess.run(["sh", script, address], cwd=tmp_path, check=True)
    project, citation, recipe = ((tmp_path / name).read_text() for name in files)
    stated = tomllib.loads(project)["project"]
    assert stated.pop("urls")["Repository"] == yaml.safe_load(citation)["repository-code"] == address
    assert yaml.safe_load(recipe)["about"]["repository"] == address
    assert stated == tomllib.loads((repository / "pyproject.toml").read_text())["project"]


def test_the_page_of_the_api_names_what_the_package_gives(repository: Path) -> None:
    page = (repository / "docs" / "python-api.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE) == hhsim.__all__


PROGRAM = """
import hhsim
result = hhsim.load_result("grasp.h5")
reveal_type(result.rate)
reveal_type(hhsim.SolverOptions().method)
hhsim.draw(result, tick="last")
"""


@pytest.mark.soak
def test_a_program_of_a_user_is_checked_by_the_types_of_the_package(wheel: zipfile.ZipFile, tmp_path: Path) -> None:
    builder = venv.EnvBuilder(with_pip=False)
    builder.create(tmp_path / "env")
    (site,) = (tmp_path / "env" / "lib").glob("python*/site-packages")
    wheel.extractall(site)
    (site / "others.pth").write_text(sysconfig.get_path("purelib"))
    (tmp_path / "program.py").write_text(PROGRAM)
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", "--python-executable"]
    answer = subprocess.run(
        [*command, tmp_path / "env" / "bin" / "python", "program.py"], cwd=tmp_path, capture_output=True, text=True
    )
    said = [line.partition(": ")[2] for line in answer.stdout.splitlines()]
    assert said[:2] == ['note: Revealed type is "float"', 'note: Revealed type is "str"'], answer.stdout + answer.stderr
    assert 'Argument "tick" to "draw" has incompatible type "str"' in said[2]


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

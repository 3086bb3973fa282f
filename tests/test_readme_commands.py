"""Every command of the README and of docs/cli.md, pasted in a fresh clone, in order: what a newcomer does first."""

import os
import re
import shutil
import subprocess
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest
from markdown_pages import Page
from own_command import hhsim_command, paste

from tools.build_wheel import build

pytestmark = pytest.mark.slow

RECURSIVE = re.compile(r"^make test|-m pytest")
"""The tests do not run themselves."""
ENVIRONMENT = re.compile(r"^(make |python3 -m venv|\.venv/bin/|\. \.venv/|pip install)")
"""What sets the environment up; the tests stand in one already."""
SUFFIXES = (".stl", ".csv", ".h5", ".py", ".toml", ".rrd", ".html", ".npz")


def lines(repository: Path) -> list[str]:
    """The command lines, without those that run the tests."""
    pages = [Page.read(repository / name) for name in ("README.md", "docs/cli.md")]
    return [line for page in pages for line in page.command_lines() if not RECURSIVE.search(line)]


def test_every_file_is_there_or_made_by_a_line_before(repository: Path) -> None:
    made: set[str] = set()
    shipped = {f"examples/{name}" for name in ("mug.stl", "grab.csv")}
    named: set[str] = set()
    for line in lines(repository):
        words = line.split()
        if words[:2] == ["hhsim", "scene"]:
            made.add(f"{words[words.index('--out') + 1]}/example-submission.csv")
        for place, word in enumerate(words):
            if not word.endswith(SUFFIXES):
                continue
            if words[place - 1] in ("--out", "--rerun", "--video") or (words[:2] == ["hhsim", "export"] and place == 3):
                made.add(word)
            else:
                named.add(word)
                assert word in made or (repository / word).is_file(), f"{line}: there is no {word}"
    assert shipped <= named


@pytest.mark.soak
@pytest.mark.parametrize("own", [True, False], ids=["here", "from nothing"])
def test_every_line_can_be_pasted(repository: Path, tmp_path: Path, own: bool) -> None:
    clone, commands_of_own = tmp_path / "clone", tmp_path / "bin"
    subprocess.run(["git", "clone", "--quiet", str(repository), str(clone)], check=True)
    commands = [line for line in lines(repository) if not (own and ENVIRONMENT.match(line))]
    assert len(commands) > 20
    commands_of_own.mkdir()
    if own:
        hhsim_command(commands_of_own)
    paste(commands, clone, {"PATH": f"{commands_of_own}:{os.environ['PATH']}"})


COUNTER = """
import os
from numba.core import event

class Counter(event.Listener):
    def on_start(self, started):
        with open(os.environ["COMPILED"], "a") as file:
            print(started.data["dispatcher"], file=file)

    def on_end(self, ended):
        pass

event.register("numba:compile", Counter())
"""
"""Start of every Python of an environment: each compilation writes a line."""


@pytest.mark.soak
def test_a_wheel_with_its_kernels_compiles_nothing(repository: Path, tmp_path: Path) -> None:
    wheel, environment, temporary = build(tmp_path), tmp_path / "environment", tmp_path / "temporary"
    assert wheel.stat().st_size < 25e6
    venv.create(environment)
    site = next(environment.glob("lib/python*/site-packages"))
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(site)
    # What hhsim depends on is taken from here; hhsim itself, which comes first, from the wheel.
    # Its own path files count too: coal's tells where coal is.
    (site / "dependencies.pth").write_text(f"import site; site.addsitedir({sysconfig.get_path('purelib')!r})\n")
    (site / "sitecustomize.py").write_text(COUNTER)
    entry = environment / "bin" / "hhsim"
    # As pip writes it: a process that a sweep starts imports this script and does not run it.
    guarded = "from hhsim.cli.main import main\nif __name__ == '__main__':\n    main()\n"
    entry.write_text(f"#!{environment}/bin/python -P\n{guarded}")
    entry.chmod(0o755)
    shutil.copytree(repository / "examples", tmp_path / "work" / "examples")
    (tmp_path / "work" / "results").mkdir()
    temporary.mkdir()
    (tmp_path / "no-folder").write_text("")
    compiled = tmp_path / "compiled"
    setting = {
        "PATH": f"{environment}/bin:{os.environ['PATH']}",
        "COMPILED": str(compiled),
        "HHSIM_CACHE_DIR": str(tmp_path / "no-folder"),
        "XDG_CACHE_HOME": str(tmp_path / "no-folder"),
        "TMPDIR": str(temporary),
    }
    own = [line.replace(".venv/bin/hhsim", "hhsim") for line in lines(repository)]
    own = [line for line in own if not ENVIRONMENT.match(line)]
    where = "python -c 'import hhsim; print(hhsim.__file__); assert \"/site-packages/\" in hhsim.__file__'"
    counts = "python -c 'import numba; numba.njit(lambda: 0)()'"
    paste([where, counts, *own], tmp_path / "work", setting)
    assert [line for line in compiled.read_text().splitlines() if "<lambda>" not in line] == []
    assert "<lambda>" in compiled.read_text()
    assert not list(temporary.rglob("*.nb?"))

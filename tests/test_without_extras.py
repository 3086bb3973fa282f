"""hhsim as it is installed without any extra: every command does its work, or says in one line what it needs."""

import importlib
import os
import shlex
import subprocess
import venv
from pathlib import Path
from typing import NamedTuple

import pytest
from sweep_plans import write_plan

from hhsim.solver.method import declared_methods

COMMANDS: dict[str, str] = importlib.import_module("hhsim.cli.main").COMMANDS


class Line(NamedTuple):
    """A command line.

    Attributes:
        words: Without `hhsim`; the files that it reads are made by a line before it.
        extra: Of hhsim, that it needs; "" where it needs none.
        codes: That it may end with: the machine decides what `hhsim doctor` finds.
    """

    words: str
    extra: str = ""
    codes: tuple[int, ...] = (0,)


ENGINES = [name for name, entry in declared_methods().items() if entry.value.startswith("hhsim.engines.")]
LINES = (
    Line("info"),
    Line("objects"),
    Line("trajectories"),
    Line("methods"),
    Line("examples mine"),
    Line("replay sphere short.toml --out a.h5"),
    Line("replay sphere short.toml --method penalty --out b.h5"),
    Line("replay a.h5"),
    Line("compare a.h5 b.h5"),
    Line("export a.h5 a.csv"),
    Line("report a.h5 --out a.html"),
    Line("view a.h5 --rerun a.rrd --every 10"),
    Line("view a.h5 --video a.gif --slow 1 --pixels 160"),
    Line("verify a.h5"),
    Line("scene sphere short.toml --out scene"),
    Line("score scene/example-submission.csv --out scored.h5"),
    Line("import grab.csv --out grab.h5"),
    Line("repair grab.csv --object sphere --out repaired.csv", codes=(0, 1)),
    Line("sweep plan.toml"),
    Line("sweep plan.toml --scheduler local --out other", "sweep"),
    Line("gate a.h5"),
    Line("build-tree cube --level 2 --out tree.h5"),
    Line("live glove sphere --device sim --duration 2 --out live.h5"),
    Line("doctor --duration 0.5", codes=(0, 1)),
    Line("bench peers --quick --method coupled"),
    Line("bench speed-error --motion pinch --level 2 --repetitions 1"),
    *(Line(f"replay sphere short.toml --method {name}", name.partition("-")[0]) for name in ENGINES),
)


def test_every_command_and_every_engine_is_among_the_lines() -> None:
    assert {line.words.split()[0] for line in LINES} == COMMANDS.keys()
    assert len(ENGINES) > 2


@pytest.mark.soak
def test_every_command_works_or_says_what_it_needs(repository: Path, tmp_path: Path) -> None:
    hhsim = installed_alone(repository, tmp_path)
    work = tmp_path / "work"
    work.mkdir()
    write_plan(work)
    (work / "grab.csv").write_bytes((repository / "examples" / "grab.csv").read_bytes())
    wrong = [f"hhsim {line.words}: {told}" for line in LINES if (told := what_is_wrong(hhsim, line, work))]
    assert not wrong, "\n".join(wrong)


def installed_alone(repository: Path, folder: Path) -> Path:
    """The command of an environment that has what hhsim depends on, and nothing else."""
    venv.create(folder / "venv", with_pip=True)
    python, source = folder / "venv" / "bin" / "python", folder / "source"
    subprocess.run(["git", "clone", "--quiet", str(repository), str(source)], check=True)
    install = [str(python), "-m", "pip", "install", "--quiet", "-c", "constraints.txt", "."]
    subprocess.run(install, cwd=source, check=True)
    return python.with_name("hhsim")


def what_is_wrong(hhsim: Path, line: Line, folder: Path) -> str:
    """How a line ended, if not as it should."""
    command = [str(hhsim), *shlex.split(line.words)]
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "HHSIM_SHARED_DATA")}
    ended = subprocess.run(
        command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    if line.extra:
        lines = ended.stderr.splitlines()
        good = ended.returncode == 2 and len(lines) == 1 and f"pip install 'hhsim[{line.extra}]'" in lines[0]
    else:
        good = ended.returncode in line.codes and "Traceback" not in ended.stderr
    return "" if good else f"exit code {ended.returncode}\n{ended.stdout[-500:]}{ended.stderr[-1500:]}"

"""Every command of the README, pasted line by line in a fresh clone, in order: what a newcomer does first."""

import os
import re
import subprocess
from pathlib import Path

import pytest
from markdown_pages import Page
from own_command import hhsim_command

RECURSIVE = re.compile(r"^make test|-m pytest")
"""The tests do not run themselves."""
ENVIRONMENT = re.compile(r"^(make |python3 -m venv|\.venv/bin/|\. \.venv/|pip install)")
"""What sets the environment up; the tests stand in one already."""
SUFFIXES = (".stl", ".csv", ".h5", ".py", ".toml", ".rrd", ".html", ".npz")


def lines(repository: Path) -> list[str]:
    """The command lines, without those that run the tests."""
    return [line for line in Page.read(repository / "README.md").command_lines() if not RECURSIVE.search(line)]


def test_every_file_is_there_or_made_by_a_line_before(repository: Path) -> None:
    made: set[str] = set()
    shipped = {f"examples/{name}" for name in ("mug.stl", "grab.csv")}
    named: set[str] = set()
    for line in lines(repository):
        words = line.split()
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
    clone = tmp_path / "hhsim"
    subprocess.run(["git", "clone", "--quiet", str(repository), str(clone)], check=True)
    commands = [line for line in lines(repository) if not (own and ENVIRONMENT.match(line))]
    assert len(commands) > 20
    if own:
        hhsim_command(tmp_path)
    # One shell, so that an activated environment stays; it ends with the first line that fails.
    script = "set -e\n" + "".join(f"echo 'PASTED {number}'\n{line}\n" for number, line in enumerate(commands))
    answer = subprocess.run(
        ["bash", "-c", script],
        cwd=clone,
        env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}", "NO_COLOR": "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    reached = answer.stdout.count("PASTED ")
    assert answer.returncode == 0, f"{commands[reached - 1]}\n{answer.stdout[-2000:]}{answer.stderr[-2000:]}"
    assert reached == len(commands)

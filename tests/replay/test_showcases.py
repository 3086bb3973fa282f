"""Every scene that README, docs/cli.md and the catalogue put forward is within all limits: what a newcomer sees."""

import json
import shlex

import pytest
from conftest import REPOSITORY, Run
from markdown_pages import Page
from sampled import sampled

from hhsim.replay.verdict import NOT_JUDGED, OK, UNTOUCHED
from hhsim.scene.motion_catalogue import describe, trajectory_names

PASTED = [
    line
    for name in ("README.md", "docs/cli.md")
    for line in Page.read(REPOSITORY / name).command_lines()
    if line.startswith("hhsim replay ")
]
SHOWN = dict.fromkeys(
    " ".join(shlex.split(line, comments=True))
    for line in [*PASTED, *(describe(name).line for name in trajectory_names())]
)
"""Commands, each once."""
MADE = ("project_out:ProjectOut", "session.h5")
"""What lines before make by other commands than an import."""
QUICK = ("hhsim replay cup handle", describe("lift").line)
MISSED = {describe("hand-over").line: {"force_ripple_hold", "lag_ticks"}}
"""Figures over their limits, by the commands that docs/metrics.md names."""


@pytest.mark.parametrize(
    "line", sampled((line for line in SHOWN if not line.endswith(MADE)), lambda _, line: line in QUICK)
)
def test_what_is_put_forward_is_within_limits(line: str, run: Run) -> None:
    # A line imports it to a file of this name.
    words = line.replace("grab.h5", "examples/grab.csv").split()[1:]
    words = [str(REPOSITORY / word) if word.startswith("examples/") else word for word in words]
    if "--out" in words:
        del words[words.index("--out") : words.index("--out") + 2]
    answer = run(*words, "--json", "--out", "shown.h5")
    assert answer.code == 0, answer.err
    document = json.loads(answer.out)
    verdicts = [one["verdict"] for one in (document["hands"].values() if "hands" in document else [document])]
    missed = {name for verdict in verdicts for name in verdict["missed"]}
    assert missed == MISSED.get(line, set()), [verdict["line"] for verdict in verdicts]
    if not missed:
        word = UNTOUCHED if words[2] == "never" else NOT_JUDGED if "penalty" in words else OK
        assert {verdict["word"] for verdict in verdicts} == {word}

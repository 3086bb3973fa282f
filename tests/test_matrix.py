"""Each cell of hands × kinds of bodies × surfaces × commands, run short, does what docs/matrix.md says.

A cell works, or is refused in one line.
"""

import json
import re
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from body_tables import TABLE, body, body_file, joint
from command_server import CommandServer, Served
from conftest import sampled
from leap_document import keypoint_table, leap_hand

from hhsim.hand.configuration import HandConfiguration
from hhsim.replay.stored_scene import stored_hand
from hhsim.result.reader import Result, load_result

HANDS = ("one", "two")
SURFACES = ("spheres", "mesh")
KINDS = {
    "fixed": "cube grasp",
    "driven": "cube carry",
    "free": "cube grasp --free",
    "joint, driven": "lid.toml grasp",
    "joint, free": "slide.toml grasp",
    "several": "blocks.toml grasp",
}
"""Object, motion and options of each kind of bodies."""
LID = joint(
    "hinge",
    [0.0, 1.0, 0.0],
    on="base",
    origin=[-0.03, 0.0, 0.0151],
    limits=[-0.5, 0.0],
    motion=[[0.0, 0.0], [1.5, 0.0], [2.0, -0.1]],
)
SLIDE = joint("slider", [1.0, 0.0, 0.0], on="rail", limits=[-0.03, 0.03], friction=0.2)
OBJECTS = {
    "lid.toml": (
        body("base", [0.06, 0.06, 0.03], position=[0.0, 0.0, -0.0151], fixed=True),
        body("lid", [0.06, 0.06, 0.03], position=[0.0, 0.0, 0.0302], joint=LID),
    ),
    "slide.toml": (
        body("block", [0.06, 0.06, 0.06], position=[0.0, 0.0, 0.036], mass=0.2, joint=SLIDE),
        body("rail", [0.2, 0.04, 0.01], position=[0.0, 0.0, -0.036], fixed=True),
    ),
    "blocks.toml": (
        body("block", [0.06, 0.06, 0.06], mass=0.2),
        body("post", [0.03, 0.03, 0.06], position=[-0.08, -0.05, 0.0], fixed=True),
        TABLE,
    ),
}
"""Bodies of each file of several."""
SHORT = "--rate 25 --level 3"
WORKS = "works"


class Scene(NamedTuple):
    """Scene of the matrix."""

    hands: str
    kind: str
    surface: str

    @property
    def words(self) -> str:
        """Arguments of `hhsim replay`, but for the surface and the number of ticks."""
        return KINDS[self.kind] + (" --hands both" if self.hands == "two" else "")

    @property
    def file(self) -> str:
        return "-".join(self).replace(", ", "-") + ".h5"

    @property
    def names(self) -> dict[str, str]:
        """What the lines of `READERS` are filled in with."""
        object_, motion, *free = KINDS[self.kind].split()
        hand, devices = ("--hand left", "left=sim,right=sim") if self.hands == "two" else ("", "sim")
        return {
            "file": self.file,
            "folder": self.file.removesuffix(".h5"),
            "words": self.words,
            "surface": self.surface,
            "hand": hand,
            "glove": f"{object_} {' '.join(free)} --trajectory {motion} --device {devices}",
        }


SCENES = [Scene(hands, kind, surface) for kind in KINDS for hands in HANDS for surface in SURFACES]


class Refused(Exception):
    """A command ended with code 2 and one line."""


class Cells:
    """Runs cells in a folder; each scene is replayed once for all its readers."""

    def __init__(self, server: CommandServer) -> None:
        self.server, self.folder = server, server.folder
        for name, tables in OBJECTS.items():
            body_file(self.folder, *tables, name=name)
        self.replayed = cache(self._replayed)

    def run(self, line: str, codes: Sequence[int] = (0,)) -> Served:
        """Run a command; raise Refused where it is refused, AssertionError where it fails in another way."""
        answer = self.server.run(*line.split())
        if answer.code == 2:
            raise Refused(answer.err.strip().splitlines()[-1].removeprefix("hhsim: error: ").removeprefix("Error: "))
        assert answer.code in codes, (line, answer.code, answer.err[-2000:])
        return answer

    def _replayed(self, scene: Scene) -> str:
        # Code 1 is a verdict: at so few ticks a second a hand may be stuck.
        self.run(f"replay {scene.words} --surface {scene.surface} {SHORT} --out {scene.file} --quiet", (0, 1))
        return scene.file

    def outcome(self, scene: Scene, reader: str) -> str:
        """Return `WORKS`, or the line with which the cell is refused."""
        try:
            if reader != "live":
                self.replayed(scene)
            names = {**scene.names, "recorded": _recorded(self, scene) if reader == "repair" else ""}
            for command in READERS[reader]:
                answer = self.run(command.line.format(**names), command.codes)
                assert not command.holds or json.loads(answer.out)[command.holds], answer.out
        except Refused as refused:
            return str(refused)
        return WORKS

    def result(self, scene: Scene) -> Result:
        return load_result(self.folder / self.replayed(scene))


def _recorded(cells: Cells, scene: Scene) -> str:
    """Write the users' hands as a recording, and return what `hhsim repair` is told of it."""
    result, name = cells.result(scene), scene.names["folder"]
    frames = range(0, result.ticks, 12)
    (cells.folder / f"{name}.csv").write_text(keypoint_table(_leap(result, frames)))
    both = "--hands both" if scene.hands == "two" else ""
    return f"--object {KINDS[scene.kind].split()[0]} {both} {_poses(cells, result, frames, name)}"


def _leap(result: Result, frames: Sequence[int]) -> dict[str, Any]:
    """The users' hands as a Leap Motion would have written them."""
    found = []
    for number, i in enumerate(frames):
        hands, pointables = [], []
        for identity, one in enumerate(result.hands.values()):
            pose = HandConfiguration(*(one[f"haptic/{name}"][i] for name in HandConfiguration._fields))
            shown, joints = leap_hand(stored_hand(one), pose)
            hands.append({"id": identity, "type": one.name, **shown, "confidence": 0.9})
            pointables += [{"handId": identity, "type": f, **joints[f]} for f in range(5)]
        found.append({"id": number, "timestamp": 40_000 * i, "hands": hands, "pointables": pointables})
    return {"metadata": {"formatVersion": 1, "frames": len(found), "generatedBy": "LeapJS"}, "frames": found}


def _poses(cells: Cells, result: Result, frames: Sequence[int], name: str) -> str:
    """Option that gives a repair the poses of a body that moves alone, as a recording has them."""
    if len(result.bodies) > 1 or not result.body.moves:
        return ""
    rows = np.column_stack(result.body.poses())[list(frames)]
    text = [",".join(f"{value!r}" for value in row) for row in rows.tolist()]
    (cells.folder / f"{name}-poses.csv").write_text("\n".join(["px,py,pz,qw,qx,qy,qz", *text, ""]))
    return f"--object-poses {name}-poses.csv"


class Command(NamedTuple):
    """Line of a cell, its exit codes, and what its JSON document has to hold."""

    line: str
    codes: tuple[int, ...] = (0,)
    holds: str = ""


READERS: dict[str, tuple[Command, ...]] = {
    "replay": (),
    "run again": (Command("replay {file} --json", holds="identical"),),
    "verify": (Command("verify {file} --quiet --every 50"),),
    "view, film": (
        Command("view {file} --rerun {file}.rrd --every 25 --quiet"),
        Command("view {file} --video {file}.gif --pixels 160 --slow 0.1 --quiet"),
    ),
    "report": (Command("report {file} --out {file}.html --quiet"),),
    "compare": (Command("compare {file} {file} {hand} --json", holds="comparable"),),
    "gate": (Command("gate {file} --quiet", (0, 1)),),
    "export": (Command("export {file} {file}.csv --columns all {hand} --quiet"),),
    "scene, score": (
        Command(f"scene {{words}} {SHORT} --out {{folder}} --quiet"),
        # The example is the user's own hand, which goes through things: suspected, code 1.
        Command("score {folder}/example-submission.csv --out {folder}-score.h5 --surface {surface} --quiet", (0, 1)),
    ),
    "repair": (Command("repair {folder}.csv {recorded} --max-correction 200 --out {folder}-free.csv --quiet", (0, 1)),),
    "live": (
        Command(
            "live glove {glove} --surface {surface} --duration 0.3 --rate 100 --level 3 --no-realtime "
            "--record {folder}-live.h5 --quiet"
        ),
        Command("replay {folder}-live.h5 --json", holds="identical"),
        Command("verify {folder}-live.h5 --quiet"),
    ),
}
"""What is done with each scene; live with as many gloves as it has hands."""
CELLS = [(scene, reader) for scene in SCENES for reader in READERS]
QUICK = Scene("one", "joint, driven", "mesh"), ("replay", "run again", "compare", "export")
"""What `make test` runs."""
WORDS = {"joint, driven": "joint driven", "joint, free": "joint free", "several": "several bodies"}


@pytest.fixture(scope="module")
def cells(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cells]:
    with CommandServer(tmp_path_factory.mktemp("matrix"), 600.0) as server:
        yield Cells(server)


def page(repository: Path) -> tuple[dict[str, dict[str, str]], dict[str, str]]:
    """Return the cells of the page by row and column, and the reasons of its refusals by letter."""
    text = (repository / "docs" / "matrix.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]
    head, _, *body = rows
    reasons = dict(re.findall(r"^- (\w): `([^`]*)`", text, re.MULTILINE))
    return {row[0]: dict(zip(head[1:], row[1:], strict=True)) for row in body}, reasons


def test_the_page_has_every_cell(repository: Path) -> None:
    table, reasons = page(repository)
    assert list(table) == [WORDS.get(kind, kind) for kind in KINDS]
    assert all(list(row) == list(READERS) for row in table.values())
    assert {cell for row in table.values() for cell in row.values()} == {"✓", *reasons}


@pytest.mark.parametrize(
    ("scene", "reader"),
    sampled(CELLS, lambda _, cell: cell[0] == QUICK[0] and cell[1] in QUICK[1]),
    ids=lambda value: "-".join(value) if isinstance(value, Scene) else value,
)
def test_a_cell_does_what_the_page_says(cells: Cells, repository: Path, scene: Scene, reader: str) -> None:
    table, reasons = page(repository)
    said, found = table[WORDS.get(scene.kind, scene.kind)][reader], cells.outcome(scene, reader)
    assert found == WORKS if said == "✓" else reasons[said] in found

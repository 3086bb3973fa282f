"""Each cell of hands × kinds of bodies × surfaces × commands, run short, does what docs/matrix.md says.

A cell works, or is refused in one line.
"""

import json
import re
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from body_tables import TABLE, body, body_file, joint
from command_server import CommandServer, Served
from leap_document import keypoint_table, leap_hand
from sampled import sampled

from hhsim.hand.configuration import HandConfiguration
from hhsim.replay.stored_scene import stored_hand
from hhsim.result.reader import Result, load_result

HANDS = ("one", "two")
SURFACES = ("spheres", "mesh")
BOTH = ("--hands", "both")
KINDS: dict[str, tuple[str, ...]] = {
    "fixed": ("cube", "grasp"),
    "driven": ("cube", "carry"),
    "free": ("cube", "grasp", "--free"),
    "joint, driven": ("lid.toml", "grasp"),
    "joint, free": ("slide.toml", "grasp"),
    "several": ("blocks.toml", "grasp"),
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
SHORT = ("--rate", "25", "--level", "3")
WORKS = "works"


class Scene(NamedTuple):
    """Scene of the matrix."""

    hands: str
    kind: str
    surface: str

    @property
    def words(self) -> tuple[str, ...]:
        """Arguments of `hhsim replay`, but for the number of ticks."""
        both = BOTH if self.hands == "two" else ()
        return (*KINDS[self.kind], *both, "--surface", self.surface)

    @property
    def file(self) -> str:
        return "-".join(self).replace(", ", "-") + ".h5"


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

    def run(self, *arguments: str, codes: Sequence[int] = (0,)) -> Served:
        """Run a command; raise Refused where it is refused, AssertionError where it fails in another way."""
        answer = self.server.run(*arguments)
        if answer.code == 2:
            raise Refused(answer.err.strip().splitlines()[-1].removeprefix("hhsim: error: ").removeprefix("Error: "))
        assert answer.code in codes, (arguments, answer.code, answer.err[-2000:])
        return answer

    def _replayed(self, scene: Scene) -> str:
        # Code 1 is a verdict: at so few ticks a second a hand may be stuck.
        self.run("replay", *scene.words, *SHORT, "--out", scene.file, "--quiet", codes=(0, 1))
        return scene.file

    def outcome(self, scene: Scene, reader: str) -> str:
        """Return `WORKS`, or the line with which the cell is refused."""
        try:
            READERS[reader](self, scene)
        except Refused as refused:
            return str(refused)
        return WORKS

    def result(self, scene: Scene) -> Result:
        return load_result(self.folder / self.replayed(scene))


def _of_hands(scene: Scene) -> tuple[str, ...]:
    """Options of a command that reads one hand of a file."""
    return ("--hand", "left") if scene.hands == "two" else ()


def _replay(cells: Cells, scene: Scene) -> None:
    cells.replayed(scene)


def _again(cells: Cells, scene: Scene) -> None:
    answer = cells.run("replay", cells.replayed(scene), "--json")
    assert json.loads(answer.out)["identical"], answer.out


def _verify(cells: Cells, scene: Scene) -> None:
    cells.run("verify", cells.replayed(scene), "--quiet", "--every", "50")


def _view(cells: Cells, scene: Scene) -> None:
    cells.run("view", cells.replayed(scene), "--rerun", f"{scene.file}.rrd", "--every", "25", "--quiet")
    film = ("--video", f"{scene.file}.gif", "--pixels", "160", "--slow", "0.1", "--quiet")
    cells.run("view", cells.replayed(scene), *film)


def _report(cells: Cells, scene: Scene) -> None:
    cells.run("report", cells.replayed(scene), "--out", f"{scene.file}.html", "--quiet")


def _compare(cells: Cells, scene: Scene) -> None:
    answer = cells.run("compare", *(cells.replayed(scene),) * 2, *_of_hands(scene), "--json")
    assert json.loads(answer.out)["comparable"]


def _gate(cells: Cells, scene: Scene) -> None:
    cells.run("gate", cells.replayed(scene), "--quiet", codes=(0, 1))


def _export(cells: Cells, scene: Scene) -> None:
    result = cells.replayed(scene)
    cells.run("export", result, f"{scene.file}.csv", "--columns", "all", *_of_hands(scene), "--quiet")
    cells.run("export", result, f"{scene.file}.npz", "--as", "npz", *_of_hands(scene), "--quiet")


def _score(cells: Cells, scene: Scene) -> None:
    folder = scene.file.removesuffix(".h5")
    own = tuple(word for word in scene.words if word not in ("--surface", scene.surface))
    cells.run("scene", *own, *SHORT, "--out", folder, "--quiet")
    # The example is the user's own hand, which goes through things: suspected, code 1.
    submission = f"{folder}/example-submission.csv"
    out = ("--out", f"{folder}-score.h5", "--surface", scene.surface, "--quiet")
    cells.run("score", submission, *out, codes=(0, 1))


def _repair(cells: Cells, scene: Scene) -> None:
    result, name = cells.result(scene), scene.file.removesuffix(".h5")
    frames = range(0, result.ticks, 12)
    (cells.folder / f"{name}.csv").write_text(keypoint_table(_leap(result, frames)))
    poses = tuple(_poses(cells, result, frames, name))
    both = BOTH if scene.hands == "two" else ()
    given = ("--object", KINDS[scene.kind][0], *poses, *both, "--max-correction", "200")
    cells.run("repair", f"{name}.csv", *given, "--out", f"{name}-free.csv", "--quiet", codes=(0, 1))


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


def _poses(cells: Cells, result: Result, frames: Sequence[int], name: str) -> Iterator[str]:
    """Options that give a repair the poses of a body that moves alone, as a recording has them."""
    if len(result.bodies) > 1 or not result.body.moves:
        return
    rows = np.column_stack(result.body.poses())[list(frames)]
    text = [",".join(f"{value!r}" for value in row) for row in rows.tolist()]
    (cells.folder / f"{name}-poses.csv").write_text("\n".join(["px,py,pz,qw,qx,qy,qz", *text, ""]))
    yield from ("--object-poses", f"{name}-poses.csv")


def _live(devices: str) -> Callable[[Cells, Scene], None]:
    def run(cells: Cells, scene: Scene) -> None:
        name, motion, *free = KINDS[scene.kind]
        words = (name, *free, "--trajectory", motion, "--device", devices, "--surface", scene.surface)
        record = scene.file.replace(".h5", "-live.h5")
        how = ("--duration", "0.3", "--rate", "100", "--level", "3", "--no-realtime", "--record", record, "--quiet")
        cells.run("live", "glove", *words, *how)
        assert json.loads(cells.run("replay", record, "--json").out)["identical"]
        cells.run("verify", record, "--quiet")

    return run


_one_glove, _two_gloves = _live("sim"), _live("left=sim,right=sim")


def _gloves(cells: Cells, scene: Scene) -> None:
    (_one_glove if scene.hands == "one" else _two_gloves)(cells, scene)


READERS: dict[str, Callable[[Cells, Scene], None]] = {
    "replay": _replay,
    "run again": _again,
    "verify": _verify,
    "view, film": _view,
    "report": _report,
    "compare": _compare,
    "gate": _gate,
    "export": _export,
    "scene, score": _score,
    "repair": _repair,
    "live": _gloves,
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


def row_of(scene: Scene) -> str:
    return f"{scene.hands} hand{'s' if scene.hands == 'two' else ''}, {WORDS.get(scene.kind, scene.kind)}"


def test_the_page_has_every_cell(repository: Path) -> None:
    table, reasons = page(repository)
    assert list(table) == list(dict.fromkeys(map(row_of, SCENES))) and len(table) == 2 * len(KINDS)
    assert all(list(row) == list(READERS) for row in table.values())
    assert {cell for row in table.values() for cell in row.values()} == {"✓", *reasons}


@pytest.mark.parametrize(
    ("scene", "reader"),
    sampled(CELLS, lambda _, cell: cell[0] == QUICK[0] and cell[1] in QUICK[1]),
    ids=lambda value: "-".join(value) if isinstance(value, Scene) else value,
)
def test_a_cell_does_what_the_page_says(cells: Cells, repository: Path, scene: Scene, reader: str) -> None:
    table, reasons = page(repository)
    said, found = table[row_of(scene)][reader], cells.outcome(scene, reader)
    assert found == WORKS if said == "✓" else reasons[said] in found

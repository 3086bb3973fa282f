"""Damaged files at every door: each command ends in time, in one line where it refuses, and never with a traceback.

Of a sealed file, no change of a byte goes unnoticed. One without a seal (of a run that was killed, of an older hhsim,
of another program) may be damaged where nobody can tell; there it is enough that everything ends, and ends well. A
recording of another program that is taken has the numbers of the sound one, or the command says that they are in doubt.
"""

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import trimesh
from command_server import CommandServer, Served
from joint_samples import joint_sample, mcap_bytes
from leap_document import document
from pose_samples import lerobot_bytes
from recording_damage import damaged_bytes, damaged_container
from recording_samples import smooth_recording
from sampled import sampled
from short_grasp import short_grasp, short_result

from hhsim.mesh.catalogue import load_object
from hhsim.motion.file import load_trajectory, save_trajectory
from hhsim.recordings.repair import repair
from hhsim.system.checksummed_file import SIZE
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.file import save_tree
from hhsim.trees.options import TreeOptions

pytestmark = pytest.mark.slow

SECONDS = 120.0
"""That a command may take over a damaged file, of a machine that has more to do: what hangs would take for ever."""
BLOCKS = [range(2), range(2, 6), *(range(first, min(first + 100, 1000)) for first in range(6, 1000, 100))]
"""Corruptions of a test. `make test` runs the first ones of most kinds, of results one for each command; `make soak` a
thousand of each."""


class Kind(NamedTuple):
    """A kind of file: the name of a sample, whether it is sealed, and the commands that take it."""

    name: str
    sealed: bool
    commands: tuple[str, ...]


RESULT_COMMANDS = (
    "report FILE --out page.html",
    "verify FILE --every 200 --json",
    "replay FILE --json",
    "view FILE --rerun out.rrd --every 10",
    "import FILE --out taken.h5",
    "replay cube FILE --level 2 --out again.h5",
)
RECORDING_COMMANDS = (
    "import FILE --out FILE.h5 --json",
    "replay cube FILE --level 2 --out again.h5",
    "scene cube FILE --level 2 --out FILE.scene",
    "live glove cube --device replay --trajectory FILE --level 2 --no-record",
)
KINDS = (
    Kind("result.h5", True, RESULT_COMMANDS),
    Kind("result.h5", False, RESULT_COMMANDS),
    Kind("tree.h5", True, ("replay cup touch --tree FILE --out again.h5",)),
    Kind("tree.h5", False, ("replay cup touch --tree FILE --out again.h5",)),
    Kind("motion.h5", True, ("replay cube FILE --level 2 --out again.h5", "import FILE --out taken.h5")),
    Kind("motion.h5", False, ("replay cube FILE --level 2 --out again.h5", "import FILE --out taken.h5")),
    Kind("take.npz", False, RECORDING_COMMANDS),
    Kind("take.json", False, ("import FILE --out taken.h5", "replay cube FILE --level 2 --out again.h5")),
    Kind("ball.stl", False, ("replay FILE touch --unit m --level 2 --out again.h5",)),
    Kind("take.mcap", False, RECORDING_COMMANDS),
    Kind("take.parquet", False, RECORDING_COMMANDS),
)
RECORDINGS = ("take.npz", "take.mcap", "take.parquet")
"""Of several parts, which have checksums or are said to have none."""


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """A sound file of each kind; of HDF5 files with their seal."""
    folder = tmp_path_factory.mktemp("samples")
    short_result(folder / "result.h5", short_grasp(hold=0.03))
    cup = load_object("cup").mesh
    save_tree(cached_sphere_tree(cup, TreeOptions(level=2)), folder / "tree.h5")
    recording = smooth_recording(60)
    save_trajectory(repair(recording).trajectory, folder / "motion.h5")
    motion = load_trajectory(folder / "motion.h5")
    np.savez_compressed(
        folder / "take.npz",
        t=motion.time,
        wrist_pos=motion.position,
        wrist_quat=motion.orientation,
        flex=motion.flexion,
        abd=motion.abduction,
    )
    (folder / "take.json").write_text(json.dumps(document()))
    (folder / "ball.stl").write_bytes(ball_stl())
    (folder / "take.mcap").write_bytes(mcap_bytes(joint_sample(), chunks=3))
    (folder / "take.parquet").write_bytes(lerobot_bytes())
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def ball_stl() -> bytes:
    """A binary STL file of 320 triangles: what takes time is the solid that each damaged one is made into."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.04)
    return bytes(trimesh.exchange.stl.export_stl(ball))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CommandServer]:
    with CommandServer(tmp_path_factory.mktemp("served"), SECONDS) as server:
        yield server


def check(answer: Served, told: str) -> None:
    assert answer.code is not None, f"{told}: {answer.err}"
    assert answer.code in (0, 1, 2), f"{told}: exit code {answer.code}\n{answer.err}"
    assert "Traceback" not in answer.err and "Warning: " not in answer.err, f"{told}\n{answer.err}"
    errors = [line for line in answer.err.splitlines() if line.startswith("hhsim: error: ")]
    assert len(errors) == (answer.code == 2), f"{told}: exit code {answer.code}\n{answer.err}"


def arguments(command: str, path: Path) -> list[str]:
    """A command's words, with the file's name for FILE."""
    return [word.replace("FILE", str(path)) for word in command.split()]


def imported(answer: Served, path: Path) -> tuple[list[bytes], list[Any]]:
    """The numbers of an import, and what it says of them."""
    motion = load_trajectory(Path(f"{path}.h5"))
    document = json.loads(answer.out)
    assert document["checksums"] == motion.checksums
    said = [document["findings"], document["flags"], motion.checksums]
    parts = (motion.time, motion.position, motion.orientation, motion.flexion, motion.abduction)
    return [part.tobytes() for part in parts], said


def name_of(value: Kind | range) -> str:
    """What a parameter is called."""
    return f"{value.name}-{'sealed' if value.sealed else 'bare'}" if isinstance(value, Kind) else f"from-{value.start}"


CASES = [(kind, block) for kind in KINDS for block in BLOCKS]


@pytest.mark.parametrize(
    ("kind", "block"),
    sampled(
        CASES,
        lambda _, case: (
            case[1] in BLOCKS[: 2 if case[0].name == "result.h5" else 1] and case[0] not in (KINDS[3], *KINDS[-2:])
        ),
    ),
    ids=name_of,
)
def test_a_damaged_file_is_refused_in_time_and_in_one_line(
    kind: Kind, block: range, samples: dict[str, bytes], server: CommandServer, tmp_path: Path
) -> None:
    data = samples[kind.name]
    if kind.name.endswith(".h5") and not kind.sealed:
        data = data[:-SIZE]
    codes: Counter[int | None] = Counter()
    sound: tuple[list[bytes], Any] = ([], None)
    if kind.name in RECORDINGS:
        path = tmp_path / kind.name
        path.write_bytes(data)
        sound = imported(server.run(*arguments(kind.commands[0], path)), path)
    for number in block:
        random = np.random.default_rng([number, KINDS.index(kind)])
        content = (damaged_container if kind.name in RECORDINGS else damaged_bytes)(data, random)
        path = tmp_path / f"{number}-{kind.name}"
        path.write_bytes(content)
        command = kind.commands[number % len(kind.commands)]
        answer = server.run(*arguments(command, path))
        check(answer, f"corruption {number} of {kind.name}, hhsim {command}")
        if kind.name in RECORDINGS and answer.code == 0 and command.startswith("import"):
            numbers, said = imported(answer, path)
            assert numbers == sound[0] or said != sound[1] or "missing" in said, f"corruption {number} of {kind.name}"
        elif kind.name in RECORDINGS and answer.code == 0:
            assert "on the way in: hhsim import tells what" in answer.out + answer.err
        codes[answer.code] += 1
        # Cut exactly at its end, a file has lost its seal and nothing else.
        if kind.sealed and content not in (data, data[:-SIZE]):
            assert answer.code == 2, f"corruption {number} of {kind.name} went through hhsim {command}"
        path.unlink()
    # Of texts without a seal a few in a row may have a digit changed, and nothing that could be refused.
    assert codes[2] > 0 or (len(block) < 10 and not kind.sealed), codes


@pytest.mark.parametrize(
    ("kind",),
    sampled(
        [(kind,) for kind in KINDS],
        lambda place, case: (
            case[0] not in (KINDS[3], KINDS[5]) and case[0].name not in ("result.h5", "ball.stl", *RECORDINGS)
        ),
    ),
    ids=name_of,
)
def test_the_sound_file_goes_through(
    kind: Kind, samples: dict[str, bytes], server: CommandServer, tmp_path: Path
) -> None:
    data = samples[kind.name]
    path = tmp_path / kind.name
    path.write_bytes(data if kind.sealed or not kind.name.endswith(".h5") else data[:-SIZE])
    for command in kind.commands:
        answer = server.run(*arguments(command, path))
        check(answer, command)
        assert answer.code in (0, 1), answer.err

"""Damaged files at every door: each command ends in time, in one line where it refuses, and never with a traceback.

No change of a sealed file goes unnoticed. Without a seal a file may be damaged unseen: everything ends well, and what
is written holds no impossible motion. tests/recordings/test_damage.py judges the numbers of recordings.
"""

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pytest
import trimesh
from column_map_sample import GLOVE, TABLE
from command_server import CommandServer, Served
from conftest import sampled
from gate_scene import SUITE
from joint_samples import array_npy, arrays_npz, joint_sample, mcap_bytes, openxr_csv, webxr_json
from leap_document import document
from pose_samples import lerobot_bytes
from recording_damage import damaged_bytes
from recording_samples import smooth_recording
from short_grasp import short_grasp, short_grasp_text, short_result
from sweep_plans import PLAN

from hhsim.mesh.catalogue import load_object
from hhsim.motion.file import load_trajectory, save_trajectory
from hhsim.recordings.cleaning import clean_recording
from hhsim.recordings.joint_names import KEYPOINTS
from hhsim.system.checksummed_file import SIZE
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.file import save_tree
from hhsim.trees.options import TreeOptions

pytestmark = pytest.mark.slow

SECONDS, PROCESSOR_SECONDS = 120.0, 20.0
"""Limits of a command, by the wall clock and of the processor's time, which may compile its kernels."""
BLOCKS = [range(1), *(range(first, min(first + 100, 300)) for first in range(1, 300, 100))]
"""Corruptions of a test: `make test` runs the first one, `make soak` all."""


class Kind(NamedTuple):
    """Kind of file: a sample's name, its seal ("kept", or "bare" without one), and its commands."""

    name: str
    seal: str
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
REPAIR = "repair FILE --object ball.obj --rate 100 --hand right --world-up y --length-unit m --max-correction 200"
MOTION_COMMANDS = ("replay cube FILE --level 2 --out again.h5", "import FILE --out taken.h5")
TREE_COMMANDS = ("replay cup touch --tree FILE --out again.h5",)
MESH_COMMANDS = ("replay FILE touch --unit m --level 2 --out again.h5",)
REPAIRED = ("hand.npy", "hand.json", "hand.csv", "hand.npz", "openxr.csv")
"""Joints of a hand, as `hhsim repair` takes them."""
WRITTEN = {"hand.json": ".npz"}
"""Suffix that a repair writes of what is only read."""
KINDS = (
    *(Kind("result.h5", seal, RESULT_COMMANDS) for seal in ("kept", "bare")),
    *(Kind("tree.h5", seal, TREE_COMMANDS) for seal in ("kept", "bare")),
    *(Kind("motion.h5", seal, MOTION_COMMANDS) for seal in ("kept", "bare")),
    Kind("take.npz", "bare", RECORDING_COMMANDS),
    Kind("take.json", "bare", MOTION_COMMANDS),
    Kind("ball.stl", "bare", MESH_COMMANDS),
    Kind("take.mcap", "bare", RECORDING_COMMANDS),
    Kind("take.parquet", "bare", RECORDING_COMMANDS),
)
OTHER_KINDS = (
    *(Kind(f"ball.{suffix}", "bare", MESH_COMMANDS) for suffix in ("obj", "off", "ply", "glb")),
    Kind("script.toml", "bare", ("replay cube FILE --level 2 --ticks 50 --out again.h5",)),
    Kind("hand.toml", "bare", ("replay cube pinch --hand-file FILE --level 2 --ticks 50 --out again.h5",)),
    Kind("suite.toml", "bare", ("gate FILE --no-time",)),
    Kind("plan.toml", "bare", ("sweep FILE --dry-run --json",)),
    *(Kind(name, "bare", (f"{REPAIR} --out FILE{WRITTEN.get(name, Path(name).suffix)}",)) for name in REPAIRED),
    Kind("columns.toml", "bare", ("import table.csv --columns FILE --out taken.h5",)),
)


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """A sound file of each kind; of HDF5 files with their seal."""
    folder = tmp_path_factory.mktemp("samples")
    short_result(folder / "result.h5", short_grasp(hold=0.03))
    cup = load_object("cup").mesh
    save_tree(cached_sphere_tree(cup, TreeOptions(level=2)), folder / "tree.h5")
    recording = smooth_recording(60)
    save_trajectory(clean_recording(recording).trajectory, folder / "motion.h5")
    motion = load_trajectory(folder / "motion.h5")
    names = ("t", "wrist_pos", "wrist_quat", "flex", "abd")
    arrays = (motion.time, motion.position, motion.orientation, motion.flexion, motion.abduction)
    take: dict[str, Any] = dict(zip(names, arrays))
    np.savez_compressed(folder / "take.npz", **take)
    (folder / "take.json").write_text(json.dumps(document()))
    (folder / "take.mcap").write_bytes(mcap_bytes(joint_sample(), chunks=3))
    (folder / "take.parquet").write_bytes(lerobot_bytes())
    # Of 320 triangles: what takes time is the solid that each damaged one is made into.
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.04)
    for suffix in ("stl", "obj", "off", "ply", "glb"):
        ball.export(folder / f"ball.{suffix}")
    points = joint_sample(count=24).named()
    (folder / "hand.npy").write_bytes(array_npy(points.astype(np.float32)))
    (folder / "hand.npz").write_bytes(arrays_npz(joints=points))
    (folder / "hand.json").write_text(webxr_json(joint_sample(count=24)))
    heading = ",".join(f"{name}_{axis}" for name in KEYPOINTS for axis in "xyz")
    np.savetxt(folder / "hand.csv", points.reshape(24, -1), "%.6f", ",", header=heading, comments="")
    (folder / "openxr.csv").write_text(openxr_csv(joint_sample(count=24)))
    texts = {"script": short_grasp_text(), "hand": HAND, "suite": SUITE, "plan": PLAN, "columns": GLOVE}
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


HAND = """
hand_length = 0.19
hand_breadth = 0.083
palm_level = 2
[index]
length = [0.048, 0.026, 0.011]
radius = [0.009, 0.0085, 0.0075, 0.006]
flexion_min = [-0.35, 0.0, -0.17]
flexion_max = [1.57, 1.75, 1.57]
abduction_min = -0.26
abduction_max = 0.73
[thumb]
distal = [-0.7, 0.7, 0.0]
"""


@pytest.fixture(scope="module")
def server(samples: dict[str, bytes], tmp_path_factory: pytest.TempPathFactory) -> Iterator[CommandServer]:
    """Commands in a folder that has what they take besides the damaged file."""
    folder = tmp_path_factory.mktemp("served")
    (folder / "result.h5").write_bytes(samples["result.h5"])
    (folder / "ball.obj").write_bytes(samples["ball.obj"])
    (folder / "table.csv").write_text(TABLE)
    (folder / "short.toml").write_text(short_grasp_text())
    with CommandServer(folder, SECONDS) as server:
        yield server


def damaged(kind: Kind, data: bytes, random: np.random.Generator) -> bytes:
    """The sample with a damage."""
    return damaged_bytes(data[:-SIZE] if kind.seal == "bare" and kind.name.endswith(".h5") else data, random)


def check_written(folder: Path, command: str, told: str) -> None:
    """Nothing impossible is in a motion that a command has made: whatever was wrong, it was noticed."""
    words = command.split()
    if "--out" not in words or not words[-1].endswith(".h5"):
        return
    with h5py.File(folder / words[-1]) as file:
        group = file["hands/right/tick/haptic"] if "tick" in file else file
        time = file["tick/time" if "tick" in file else "time"][()]
        assert np.isfinite(time).all() and (np.diff(time) > 0).all(), told
        for name in ("position", "orientation", "flexion", "abduction"):
            assert np.isfinite(group[name][()]).all(), told
        assert np.abs(np.linalg.norm(group["orientation"][()], axis=1) - 1.0).max() < 1e-9, told


def check(answer: Served, told: str) -> None:
    # A repair solves every frame, and draws its report.
    limit = (3.0 if "hhsim repair" in told else 1.0) * PROCESSOR_SECONDS
    assert answer.seconds < limit, f"{told}: {answer.seconds:.1f} s of the processor's time"
    assert answer.code is not None, f"{told}: {answer.err}"
    # The gate has a code for what cannot be compared.
    codes = (0, 1, 2, 3) if "hhsim gate" in told else (0, 1, 2)
    assert answer.code in codes, f"{told}: exit code {answer.code}\n{answer.err}"
    assert "Traceback" not in answer.err and "Warning: " not in answer.err, f"{told}\n{answer.err}"
    errors = [line for line in answer.err.splitlines() if line.startswith("hhsim: error: ")]
    assert len(errors) == (answer.code == 2), f"{told}: exit code {answer.code}\n{answer.err}"


def arguments(command: str, path: Path) -> list[str]:
    """A command's words, with the file's name for FILE."""
    return [word.replace("FILE", str(path)) for word in command.split()]


def name_of(value: Kind | range) -> str:
    """What a parameter is called."""
    return f"{value.name}-{value.seal}" if isinstance(value, Kind) else f"from-{value.start}"


CASES = [(kind, block) for kind in (*KINDS, *OTHER_KINDS) for block in BLOCKS]
OFTEN = ("hand.npy", "hand.json", "script.toml", "plan.toml")
"""Of the other kinds, those of which `make test` runs a corruption."""


@pytest.mark.parametrize(
    ("kind", "block"),
    sampled(
        CASES,
        lambda _, case: (
            case[1] in BLOCKS[:1]
            and case[0] not in (KINDS[3], *KINDS[9:])
            and (case[0] in KINDS or case[0].name in OFTEN)
        ),
    ),
    ids=name_of,
)
def test_a_damaged_file_is_refused_in_time_and_in_one_line(
    kind: Kind, block: range, samples: dict[str, bytes], server: CommandServer, tmp_path: Path
) -> None:
    data = samples[kind.name]
    codes: Counter[int | None] = Counter()
    for number in block:
        random = np.random.default_rng([number, (*KINDS, *OTHER_KINDS).index(kind)])
        content = damaged(kind, data, random)
        path = (server.folder if kind.name.endswith(".toml") else tmp_path) / f"{number}-{kind.name}"
        path.write_bytes(content)
        command = kind.commands[number % len(kind.commands)]
        answer = server.run(*arguments(command, path))
        told = f"corruption {number} of {kind.name}, {kind.seal}, hhsim {command}"
        check(answer, told)
        if answer.code == 0:
            check_written(server.folder, command, told)
        codes[answer.code] += 1
        # Cut exactly at its end, a file has lost its seal and nothing else.
        if kind.seal == "kept" and content not in (data, data[:-SIZE]):
            assert answer.code == 2, f"corruption {number} of {kind.name} went through hhsim {command}"
        path.unlink()
    # Of texts without a seal a few in a row may have a digit changed, and nothing that could be refused.
    assert codes[2] > 0 or (len(block) < 10 and kind.seal != "kept"), codes


@pytest.mark.parametrize(
    ("kind",), sampled([(kind,) for kind in (*KINDS, *OTHER_KINDS)], lambda place, _: place == 4), ids=name_of
)
def test_the_sound_file_goes_through(
    kind: Kind, samples: dict[str, bytes], server: CommandServer, tmp_path: Path
) -> None:
    data = samples[kind.name]
    path = (server.folder if kind.name.endswith(".toml") else tmp_path) / kind.name
    path.write_bytes(data if kind.seal != "bare" or not kind.name.endswith(".h5") else data[:-SIZE])
    for command in kind.commands:
        answer = server.run(*arguments(command, path))
        check(answer, command)
        assert answer.code in (0, 1), answer.err

"""Damaged submissions: each is refused or suspected by name, and a sound one is neither."""

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import conjugate
from hhsim.scene.scene import Scene, open_scene
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import HandSolver
from hhsim.submissions.pose_file import PARTS, Submission, format_poses, read_submission
from hhsim.submissions.scene_folder import example_submission
from hhsim.submissions.score import _free, require_scene, suspicions
from hhsim.trees.contact_surface import contact_surface

Arrays = dict[str, Any]
RATE = 250.0


@cache
def scene() -> Scene:
    """A scene in which nothing is symmetric: the palm is tilted, and fingers are spread before they touch."""
    return open_scene("cup", "handle", rate=RATE)


@cache
def near() -> NDArray[np.bool_]:
    hand = scene().hands[0]
    return ~_free(scene(), hand.model, HandConfiguration.of(hand.ticks))


def sound() -> Arrays:
    """What a method may send: where it touches, the hand is 2 mm off and pushed there; forces and times are there."""
    example = example_submission(scene())
    ticks = len(example.time)
    off = np.where(near()[:, None], [0.0, 0.0, 2e-3], 0.0)
    arrays = {block.part: np.array(values) for block, values in example.arrays.items()}
    arrays["position"] += off
    arrays["palm_force"] = 1000.0 * off
    arrays["phalanx_force"] = np.zeros((ticks, 5, 3, 3))
    arrays["duration"] = np.full(ticks, 2e-5)
    return arrays


def as_submission(arrays: Arrays, **said: Any) -> Submission:
    example = example_submission(scene())
    keys = {"method": "mine", "scene": example.scene, "made_by": example.made_by, "hand": example.hand, **said}
    shown = HandConfiguration(*(arrays[name] for name in HandConfiguration._fields))
    keys |= {name: arrays.get(name) for name in ("time", "phalanx_force", "palm_force", "duration")}
    return Submission(poses=shown, **keys)


def word_on(path: Path) -> str:
    """What hhsim says of a file; "" for nothing."""
    try:
        submission = read_submission(path)
        require_scene(submission, scene())
    except HhsimError as error:
        return str(error)
    return "; ".join(suspicions(submission, scene()))


Damage = Callable[[Arrays], Arrays]
Change = Callable[[FloatArray], FloatArray]


def put(name: str, make: Change) -> Damage:
    return lambda arrays: {name: make(arrays[name])}


def scaled(name: str, factor: float) -> Damage:
    return put(name, lambda values: factor * values)


def rows(make: Change, names: Iterable[str] = PARTS) -> Damage:
    """The same to the rows of several arrays."""
    return lambda arrays: {name: make(arrays[name]) for name in names}


def lag(ticks: int) -> Damage:
    """Poses of other ticks under the right stamps."""
    return rows(lambda a: a[np.clip(np.arange(len(a)) - ticks, 0, len(a) - 1)], HandConfiguration._fields)


def a_number(name: str, tick: int, value: float) -> Damage:
    return put(name, lambda a: np.where((np.arange(len(a)) == tick).reshape(-1, *[1] * (a.ndim - 1)), value, a))


other_motion = put("position", lambda p: p[::-1] + 0.05 * np.sin(np.arange(p.size)).reshape(-1, 3))
POSES: dict[str, tuple[Damage, str]] = {
    "millimetres": (scaled("position", 1e3), "m off the user's where nothing is near"),
    "another axis up": (put("position", lambda p: p[:, [0, 2, 1]] * [1, 1, -1]), "m off the user's"),
    "quaternion x y z w": (put("orientation", lambda q: q[:, [1, 2, 3, 0]]), "the palm is turned by"),
    "world to palm": (put("orientation", conjugate), "the palm is turned by"),
    "flexion in degrees": (scaled("flexion", 180.0 / np.pi), "flexion is"),
    "abduction in degrees": (scaled("abduction", 180.0 / np.pi), "abduction is"),
    "a left hand's abduction": (scaled("abduction", -1.0), "abduction is"),
    "little finger first": (put("flexion", lambda bent: bent[:, ::-1]), "flexion is"),
    "fingertip first": (put("flexion", lambda bent: bent[:, :, ::-1]), "flexion is"),
    "late": (lag(5), "frame, order or time?"),
    "early": (lag(-12), "frame, order or time?"),
    "another origin": (put("position", lambda p: p + [0.1, 0.0, -0.02]), "the palm is 0.102 m off"),
    "another motion": (other_motion, "m off the user's"),
    "forces in mN": (scaled("palm_force", 1e3), "millinewtons?"),
    "forces on the object": (scaled("palm_force", -1.0), "those on the object?"),
    "durations in µs": (scaled("duration", 1e6), "microseconds?"),
    "negative duration": (a_number("duration", 3, -1.0), "duration of tick 3 is negative"),
    "infinity": (a_number("flexion", 7, np.inf), "flexion of tick 7 is not finite"),
    "no quaternion": (scaled("orientation", 0.5), "orientation of tick 0 has length 0.5"),
    "a tick is missing": (rows(lambda a: np.delete(a, 100, 0)), "tick 100 is at 0.404 s; expected 750 ticks, 250 a"),
    "cut short": (rows(lambda a: a[:-50]), "it has 700 ticks; expected 750 ticks"),
    "a tick is there twice": (rows(lambda a: np.insert(a, 100, a[100], 0)), "tick 101 is at 0.4 s"),
    "half the rate": (rows(lambda a: a[::2]), "tick 1 is at 0.008 s"),
    "time in ms": (scaled("time", 1e3), "tick 1 is at 4 s"),
    "time begins later": (put("time", lambda t: t + 0.02), "tick 0 is at 0.02 s"),
}
SAID: dict[str, tuple[dict[str, Any], str]] = {
    "another scene": (
        {"scene": "ab" * 32, "made_by": {"object": "teapot", "trajectory": "touch"}},
        "is of teapot touch",
    ),
    "no scene": ({"scene": ""}, "does not say its scene: expected # scene: "),
    "a left hand": ({"hand": "left"}, "is of a left hand"),
    "no hand": ({"hand": "both"}, "expected right or left"),
}


def text(change: Callable[[str], str]) -> Callable[[Path], object]:
    return lambda path: path.write_text(change(path.read_text()))


def one_line(number: int, change: Callable[[str], str]) -> Callable[[Path], object]:
    def changed(whole: str) -> str:
        lines = whole.splitlines()
        return "\n".join([*lines[:number], change(lines[number]), *lines[number + 1 :]])

    return text(changed)


HEADER = 5
TEXTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "another unit": (text(lambda all_: all_.replace("px [m]", "px [mm]")), "column px is in mm; expected m"),
    "degrees": (text(lambda all_: all_.replace("thumb_flex1 [rad]", "thumb_flex1 [deg]")), "is in deg; expected rad"),
    "no such column": (text(lambda all_: all_.replace("thumb_abd", "thumb_spread")), "unknown column 'thumb_spread'"),
    "a column twice": (text(lambda all_: all_.replace("py [m]", "px [m]")), "column px [m] twice"),
    "a column less": (
        one_line(HEADER, lambda line: line.replace(",little_abd [rad]", "")),
        "750 of 750 lines of another length",
    ),
    "a short line": (one_line(40, lambda line: line.rpartition(",")[0]), "line 41 has"),
    "decimal commas": (
        text(lambda all_: "".join(line.replace(",", ";").replace(".", ",") for line in all_.splitlines(keepends=True))),
        "expected JSON as in the example of hhsim scene",
    ),
    "a word": (one_line(40, lambda line: "x" + line), "line 41: time [s] is 'x"),
    "half a file": (text(lambda all_: all_[: len(all_) // 2]), "values; expected"),
    "empty": (text(lambda all_: ""), "no header line"),
    "a remark of no JSON": (text(lambda all_: all_.replace("# made_by: {", "# made_by: ")), "expected JSON"),
    "another format": (text(lambda all_: all_.replace("hhsim-poses", "hhsim-trajectory")), "expected hhsim-poses"),
    "no text": (lambda path: path.write_bytes(b"\xff\xfe\x00" * 99), "not UTF-8"),
}


@pytest.mark.parametrize("separator", [";", "\t"])
def test_semicolons_or_tabs_between_columns_are_the_same_submission(separator: str, tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    path.write_text(format_poses(as_submission(sound())))
    lines = path.read_text().splitlines()
    (tmp_path / "others.csv").write_text(
        "\n".join(line if line.startswith("#") else line.replace(",", separator) for line in lines) + "\n"
    )
    assert format_poses(read_submission(tmp_path / "others.csv")) == format_poses(read_submission(path))


Cases = Iterator[tuple[str, Submission, Callable[[Path], object], str]]


def damaged() -> Cases:
    """Name of each case, what is written, what is done to the file, and the word that names it."""
    for name, (damage, word) in POSES.items():
        yield name, as_submission(sound() | damage(sound())), Path.exists, word
    for name, (said, word) in SAID.items():
        yield name, as_submission(sound(), **said), Path.exists, word
    arrays = {name: values for name, values in sound().items() if name in PARTS and not PARTS[name].optional}
    for name, (change, word) in TEXTS.items():
        yield name, as_submission(arrays), change, word


def test_damaged_poses_are_named(tmp_path: Path) -> None:
    for name, submission, change, word in damaged():
        path = tmp_path / "poses.csv"
        path.write_text(format_poses(submission))
        change(path)
        assert word in word_on(path), name


def test_no_file_and_another_file_are_named(tmp_path: Path) -> None:
    assert "no such file" in word_on(tmp_path / "none.csv")
    assert "unknown suffix" in word_on(Path(__file__))


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_a_sound_submission_is_read_bit_for_bit_and_not_suspected(kind: type, tmp_path: Path) -> None:
    arrays = {name: values.astype(kind).astype(np.float64) for name, values in sound().items()}
    path = tmp_path / "poses.csv"
    path.write_text(format_poses(as_submission(arrays)))
    assert word_on(path) == ""
    for (_, name), values in read_submission(path).arrays.items():
        # A quaternion is made unit.
        off = (1e-15 if kind is np.float64 else 1e-6) if name == "orientation" else 0.0
        assert np.abs(values - arrays[name]).max() <= off


def test_a_hand_may_be_a_tick_behind() -> None:
    """A method with inertia is behind, as `penalty` is."""
    assert suspicions(as_submission(sound() | lag(1)(sound())), scene()) == ()


@pytest.mark.parametrize("method", METHODS.names())
def test_no_method_of_ours_is_suspected(method: str) -> None:
    options = SolverOptions(method=method).at_rate(RATE)
    surface = contact_surface("spheres", scene().solids[0].placed_mesh, scene().solids[0].placed_tree)
    record = HandSolver(scene().hands[0].model, surface, options).run(*HandConfiguration.of(scene().hands[0].ticks))
    arrays = {name: values for name, values in sound().items() if name == "time"}
    arrays |= HandConfiguration.of(record)._asdict()
    arrays |= {"phalanx_force": record.phalanx, "palm_force": record.total - record.phalanx.sum(axis=(1, 2))}
    assert suspicions(as_submission(arrays), scene()) == ()

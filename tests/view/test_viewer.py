"""A result as a rerun recording: read back from the file, entity by entity, and held against the result."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

import h5py
import numpy as np
import pytest
from file_faults import changed
from PIL import Image
from rerun_files import SETTINGS, Recording, listening
from short_grasp import short_grasp, short_result, short_scene, swung_result

from hhsim.errors import InputError, OutputError
from hhsim.hand.fingers import FINGERS, PHALANX_NAMES
from hhsim.hand.model import HandModel
from hhsim.render.triangle_soup import piece_poses
from hhsim.result.reader import Result, load_result
from hhsim.result.writer import add_skin
from hhsim.view import film, sink
from hhsim.view.film import FPS, check_video_path, video_frames, video_ticks, write_video
from hhsim.view.plots import CONTACTS, DEPTH, FORCE, RESULT_PLOTS, TIME, VARIATION
from hhsim.view.scene_log import FORCE_LENGTH, NORMAL_LENGTH, moment
from hhsim.view.sink import check_target, parse_target, viewer_program
from hhsim.view.viewer import shown_scene, view_result
from tools.shapes.generators import sphere


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("replay") / "short.h5", short_grasp(hold=0.03))


@pytest.fixture(scope="module")
def written(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("view") / "short.rrd"
    viewed = view_result(result, parse_target(str(path)), spheres=True)
    assert viewed.to_json() == {"ticks": 180, "shown_ticks": 180, "rerun": str(path)}
    return path


@pytest.fixture(scope="module")
def recording(written: Path) -> Recording:
    return Recording(written)


def test_rerun_itself_finds_no_fault_and_the_views_come_with_it(written: Path, recording: Recording) -> None:
    command = [viewer_program(), "rrd", "verify", str(written)]
    answer = subprocess.run(command, capture_output=True, text=True, env=SETTINGS)
    assert answer.returncode == 0 and "verified without error" in answer.stdout + answer.stderr, answer.stderr
    assert recording.blueprints == 1


@pytest.mark.parametrize("whose", ["graphic", "haptic"])
def test_each_piece_of_a_hand_is_where_the_result_says(recording: Recording, result: Result, whose: str) -> None:
    names = ("position", "orientation", "flexion", "abduction")
    poses = piece_poses(HandModel.default(), *(result[f"{whose}/{name}"] for name in names))
    for body, name in enumerate([f"{finger}/{phalanx}" for finger in FINGERS for phalanx in PHALANX_NAMES] + ["palm"]):
        entity = f"/world/{whose}/{name}"
        translation = recording.array(entity, "Transform3D:translation")[:, 0]
        quaternion = recording.array(entity, "Transform3D:quaternion")[:, 0]
        np.testing.assert_allclose(translation, poses.translation[:, body], atol=1e-7)
        np.testing.assert_allclose(quaternion[:, [3, 0, 1, 2]], poses.quaternion[:, body], atol=1e-7)
        if whose == "graphic" and body < 15:
            np.testing.assert_allclose(translation, result["graphic/joints"][:, body // 3, body % 3], atol=1e-7)
        assert "Mesh3D:vertex_positions" in recording.fixed[entity]
    np.testing.assert_allclose(recording.times("/world/graphic/palm"), result["time"], atol=1e-9)


def test_the_plots_show_the_datasets(recording: Recording, result: Result) -> None:
    for plot in RESULT_PLOTS:
        assert recording.fixed[f"/{plot.path}"]["SeriesLines:names"] == [list(plot.series)]
    values = {plot: recording.array(f"/{plot.path}", "Scalars:scalars") for plot in RESULT_PLOTS}
    finger = result["force/phalanx"].sum(axis=2)
    np.testing.assert_allclose(values[FORCE][:, 0], np.linalg.norm(result["force/total"], axis=1), rtol=1e-15)
    np.testing.assert_allclose(values[FORCE][:, 1:6], np.linalg.norm(finger, axis=2), rtol=1e-12)
    rest = np.linalg.norm(result["force/total"] - finger.sum(axis=1), axis=1)
    np.testing.assert_allclose(values[FORCE][:, 6], rest, atol=1e-12)
    expected = {
        DEPTH: [1e6 * result[f"penetration_{name}"] for name in ("depth", "finger", "palm")],
        VARIATION: [result["force_variation_rate"], result["force_variation_finger"]],
        TIME: [1e-3 * result[f"duration/{name}"] for name in ("detect", "palm", "fingers", "force", "total")],
        CONTACTS: [result["contacts/candidates"], result["contacts/touching"]],
    }
    for plot, columns in expected.items():
        np.testing.assert_allclose(values[plot], np.column_stack(columns))


def test_the_arrows_are_the_forces(recording: Recording, result: Result) -> None:
    vectors = recording.rows("/world/forces", "Arrows3D:vectors")
    total = np.zeros((result.ticks, 3))
    for tick, row in enumerate(vectors):
        for vector in np.array(row or []).reshape(-1, 3):
            length = np.linalg.norm(vector)
            total[tick] += vector * length / FORCE_LENGTH**2
    # Forces below 0.01 N have no arrow; there are sixteen at most.
    np.testing.assert_allclose(total, result["force/total"], atol=0.16)
    held = slice(160, 180)
    np.testing.assert_allclose(total[held], result["force/total"][held], atol=2e-2)
    assert np.linalg.norm(total[held], axis=1).min() > 0.5


def test_the_phases_and_the_state_of_the_ticks_are_lanes(recording: Recording, result: Result) -> None:
    assert recording.rows("/states/phase", "StateChange:state") == [["approach"], ["grasp"], ["hold"]]
    starts = [result["time"][phase.first_tick] for phase in result.phases]
    np.testing.assert_allclose(recording.times("/states/phase"), starts, atol=1e-9)
    status = result["status"]
    changes = 1 + int(np.count_nonzero(np.diff(status)))
    assert len(recording.rows("/states/ticks", "StateChange:state")) == changes


def test_the_object_and_its_spheres_are_there(recording: Recording, result: Result) -> None:
    vertices = np.array(recording.fixed["/world/object"]["Mesh3D:vertex_positions"][0])
    faces = np.array(recording.fixed["/world/object"]["Mesh3D:triangle_indices"][0])
    np.testing.assert_allclose(vertices[faces], result.body.vertices[result.body.faces], atol=1e-7)
    level = result.body.static["tree/level"]
    sizes = np.array(recording.fixed["/world/spheres"]["Ellipsoids3D:half_sizes"][0])
    np.testing.assert_allclose(sizes[:, 0], result.body.static["tree/radius"][level == level.max()], atol=1e-7)
    (text,) = recording.fixed["/run"]["TextDocument:text"][0]
    assert "coupled" in text
    assert "180" in text


def test_the_viewer_moves_the_object_and_finds_the_contacts_on_it(tmp_path: Path) -> None:
    path = tmp_path / "driven.rrd"
    result = swung_result(short_scene(short_grasp(hold=0.03)), tmp_path / "driven.h5")
    view_result(result, parse_target(str(path)), spheres=True)
    recording, moved = Recording(path), result.moved_since_first()
    for entity in ("/world/object", "/world/spheres"):
        quaternion = recording.array(entity, "Transform3D:quaternion")[:, 0][:, [3, 0, 1, 2]]
        np.testing.assert_allclose(quaternion, moved.turn, atol=1e-6)
        np.testing.assert_allclose(recording.array(entity, "Transform3D:translation")[:, 0], moved.shift, atol=1e-6)
    points = recording.rows("/world/contacts/points", "Points3D:positions")
    normals = recording.rows("/world/contacts/normals", "Arrows3D:vectors")
    assert [len(row or []) for row in points] == result["contacts/touching"].tolist()
    assert result["contacts/touching"].max() > 3
    level = result.body.static["tree/level"]
    leaves = level == level.max()
    center, radius = result.body.static["tree/center"][leaves], result.body.static["tree/radius"][leaves]
    for tick in np.flatnonzero(result["contacts/touching"])[::10]:
        one = type(moved)(moved.turn[tick : tick + 1], moved.shift[tick : tick + 1])
        ways = np.array(points[tick])[:, None] - one.points(center[None])[0]
        away = np.abs(np.linalg.norm(ways, axis=2) - radius)
        assert away.min(axis=1).max() < 1.1e-5
        outward = ways[np.arange(len(ways)), away.argmin(axis=1)]
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        np.testing.assert_allclose(np.array(normals[tick]) / NORMAL_LENGTH, outward, atol=1e-4)


def test_a_thinned_recording_keeps_the_worst_of_the_ticks_between(result: Result, tmp_path: Path) -> None:
    path = tmp_path / "thin.rrd"
    viewed = view_result(result, parse_target(str(path)), every=7)
    assert viewed.shown == 26
    thin = Recording(path)
    translation = thin.array("/world/graphic/palm", "Transform3D:translation")[:, 0]
    np.testing.assert_allclose(translation, result["graphic/position"][::7], atol=1e-7)
    time = thin.array("/plots/time", "Scalars:scalars")[:, -1]
    assert time.tolist() == [1e-3 * result["duration/total"][first : first + 7].max() for first in range(0, 180, 7)]
    touching = thin.rows("/world/contacts/points", "Points3D:positions")
    assert [len(row or []) for row in touching] == result["contacts/touching"][::7].tolist()
    force = thin.array("/plots/force", "Scalars:scalars")[:, 0]
    np.testing.assert_allclose(force, np.linalg.norm(result["force/total"][::7], axis=1), rtol=1e-15)


def test_a_run_that_was_stopped_is_shown_as_far_as_it_went(result: Result, tmp_path: Path) -> None:
    stopped = tmp_path / "stopped.h5"
    shutil.copy(result.path, stopped)
    with changed(stopped) as file:
        file.attrs["complete"] = 0
        for name in ("graphic/joints", "status"):
            file["hands/right/tick"][name].resize(120, axis=0)
    path = tmp_path / "stopped.rrd"
    assert view_result(load_result(stopped), parse_target(str(path))).ticks == 120
    recording = Recording(path)
    assert len(recording.rows("/plots/force", "Scalars:scalars")) == 120
    assert "cut short" in recording.fixed["/run"]["TextDocument:text"][0][0]


@pytest.mark.soak
def test_a_disk_that_is_full_is_told_and_leaves_nothing(result: Result, tmp_path: Path) -> None:
    code = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))"
    command = [sys.executable, "-c", f"{code}; from hhsim.cli.main import main; main()"]
    arguments = ["view", str(result.path), "--rerun", "full.rrd"]
    answer = subprocess.run([*command, *arguments], capture_output=True, text=True, cwd=tmp_path)
    assert answer.returncode == 2
    assert "hhsim: error: cannot write full.rrd" in answer.stderr
    assert "Traceback" not in answer.stderr
    assert list(tmp_path.iterdir()) == []


def test_an_older_recording_is_replaced_and_other_files_are_not(result: Result, tmp_path: Path) -> None:
    path = tmp_path / "again.rrd"
    for _ in range(2):
        view_result(result, parse_target(str(path)), every=60)
    assert Recording(path).blueprints == 1
    other = tmp_path / "notes.rrd"
    other.write_text("my notes")
    with pytest.raises(OutputError, match="no recording of rerun's"):
        view_result(result, parse_target(str(other)))
    assert other.read_text() == "my notes"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again.rrd", "notes.rrd"]


@pytest.mark.parametrize(
    ("text", "kind", "url"),
    [
        ("spawn", "spawn", "rerun+http://127.0.0.1:9876/proxy"),
        ("connect", "connect", "rerun+http://127.0.0.1:9876/proxy"),
        ("connect=9999", "connect", "rerun+http://127.0.0.1:9999/proxy"),
        ("connect=lab:1234", "connect", "rerun+http://lab:1234/proxy"),
        ("connect=lab", "connect", "rerun+http://lab:9876/proxy"),
        ("connect=rerun://lab:443/proxy", "connect", "rerun://lab:443/proxy"),
        ("connect=[::1]:9876", "connect", "rerun+http://[::1]:9876/proxy"),
    ],
)
def test_targets_are_read(text: str, kind: str, url: str) -> None:
    target = parse_target(text)
    assert (target.kind, target.url) == (kind, url)


@pytest.mark.parametrize("text", ["", "run.h5", "connect=http://lab:1/x", "connect=lab:port", "connect=:9876", "Spawn"])
def test_what_is_no_target_is_told(text: str) -> None:
    with pytest.raises(InputError, match=r"expected .*HOST:PORT"):
        parse_target(text)


def test_a_viewer_that_is_not_there_is_told_before_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="no viewer listens at"):
        check_target(parse_target("connect=127.0.0.1:1"))
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InputError, match="no screen"):
        check_target(parse_target("spawn"))


def test_a_viewer_that_is_opened_listens_to_this_machine_alone_and_sends_no_statistics(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("CI", raising=False)
    for name in ("HOME", "XDG_CONFIG_HOME"):  # where statistics might have been switched off
        monkeypatch.setenv(name, str(tmp_path))
    answers, opened = iter(["nobody", None]), []
    with monkeypatch.context() as patched:
        patched.setattr(sink, "_listens", lambda url: next(answers))
        patched.setattr(sink, "_opened", [])
        patched.setattr(subprocess, "Popen", lambda words, **given: opened.append((words, given["env"])))
        sink.open_viewer()
    ((command, environment),) = opened
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    words, environment = [command[0], "--version"], {**environment, "RUST_LOG": "debug"}
    answer = subprocess.run(words, capture_output=True, text=True, env=environment, check=True)
    assert "Analytics disabled" in answer.stdout + answer.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_viewer_that_is_open_gets_the_same(result: Result, written: Path, tmp_path: Path) -> None:
    path = tmp_path / "got.rrd"
    with listening(path) as (port, _):
        view_result(result, parse_target(f"connect={port}"))
    sent, whole = Recording(path), Recording(written)
    for entity, column in (
        ("/world/haptic/little/distal", "Transform3D:quaternion"),
        ("/world/forces", "Arrows3D:vectors"),
        ("/plots/variation", "Scalars:scalars"),
    ):
        np.testing.assert_equal(sent.rows(entity, column), whole.rows(entity, column))


def test_a_notebook_shows_the_same_in_its_cell(
    result: Result, written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def show(recording: Any) -> None:
        recording.save(tmp_path / "cell.rrd")
        recording.disconnect()

    monkeypatch.setitem(sys.modules, "rerun_notebook", None)
    with pytest.raises(InputError, match=r"pip install 'rerun-sdk\[notebook\]'"):
        view_result(result)
    package = ModuleType("rerun_notebook")
    package.__spec__ = ModuleSpec("rerun_notebook", None)
    monkeypatch.setitem(sys.modules, "rerun_notebook", package)
    monkeypatch.setattr("rerun.notebook_show", show)
    assert view_result(result, spheres=True).to_json()["rerun"] == "the notebook"
    shown, expected = Recording(tmp_path / "cell.rrd"), Recording(written)
    assert (shown.blueprints, shown.fixed.keys()) == (expected.blueprints, expected.fixed.keys())
    assert shown._batches.keys() == expected._batches.keys()
    name = "/world/forces"
    assert {name} < shown._batches.keys()
    np.testing.assert_array_equal(shown.times(name), expected.times(name))


def test_an_empty_result_is_refused(result: Result, tmp_path: Path) -> None:
    empty = Result(**{**{name: getattr(result, name) for name in result.__dataclass_fields__}, "ticks": 0})
    with pytest.raises(InputError, match="holds no tick"):
        view_result(empty, parse_target(str(tmp_path / "x.rrd")))
    with pytest.raises(InputError, match="expected 1 or more"):
        view_result(result, parse_target(str(tmp_path / "x.rrd")), every=0)


BALL = sphere(0.05, subdivisions=1)


def skin_of(result: Result) -> np.ndarray:
    """A ball that goes with the palm, shape (T, V, 3)."""
    return np.asarray(BALL.vertices + result["graphic/position"][:, None])


@pytest.fixture
def skinned(result: Result, tmp_path: Path) -> Result:
    path = Path(shutil.copy(result.path, tmp_path / "skin.h5"))
    add_skin(path, skin_of(result), BALL.faces)
    return load_result(path)


def test_a_skin_is_read_back_and_all_else_stays(result: Result, skinned: Result) -> None:
    assert result.skin_faces is None and skinned.complete
    np.testing.assert_array_equal(skinned.skin_faces, BALL.faces)
    expected = skin_of(result).astype(np.float32)
    np.testing.assert_array_equal(skinned.skin(slice(None)), expected)
    np.testing.assert_array_equal(skinned.skin(slice(3, 20, 5)), expected[3:20:5])
    assert skinned.keys() == result.keys()
    for name in ("graphic/position", "force/total", "status"):
        np.testing.assert_array_equal(skinned[name], result[name])


def test_a_skin_beside_a_moving_object_is_seen_from_it(tmp_path: Path) -> None:
    world = skin_of(swung_result(short_scene(short_grasp(hold=0.01)), tmp_path / "moving.h5"))
    add_skin(tmp_path / "moving.h5", world, BALL.faces)
    result = load_result(tmp_path / "moving.h5")
    seen = result.seen_from_object.skin(slice(None))
    palm = result.seen_from_object["graphic/position"]
    np.testing.assert_allclose(seen.mean(axis=1), palm, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(seen - palm[:, None], axis=2), 0.025, atol=1e-6)
    assert np.abs(result.skin(slice(None)) - seen).max() > 1e-3


@pytest.mark.parametrize("fault", ["ticks", "faces", "lacks", "shape"])
def test_a_skin_that_does_not_fit_is_damage(skinned: Result, fault: str) -> None:
    with changed(skinned.path) as file:
        group: h5py.Group = file["hands/right/skin"]
        values = {name: group[name][...] for name in group}
        if fault == "faces":
            values["faces"][0, 0] = len(BALL.vertices)
        elif fault == "lacks":
            del values["faces"]
        else:
            values["vertices"] = values["vertices"][:-1] if fault == "ticks" else values["vertices"][:, :, :2]
        del file["hands/right/skin"]
        for name, array in values.items():
            file[f"hands/right/skin/{name}"] = array
    with pytest.raises(InputError, match=r"skin|faces|vertices"):
        _ = load_result(skinned.path).skin_faces


def test_what_cannot_be_stored_is_told(result: Result, skinned: Result, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot write"):
        add_skin(tmp_path / "none.h5", skin_of(result), BALL.faces)
    add_skin(skinned.path, 2.0 * skin_of(result), BALL.faces[:9])
    again = load_result(skinned.path)
    assert len(again.skin_faces) == 9
    np.testing.assert_array_equal(again.skin(slice(None)), (2.0 * skin_of(result)).astype(np.float32))


def test_pictures_show_the_skin(skinned: Result) -> None:
    shown = moment(skinned, shown_scene(skinned), 7)
    corners = skin_of(skinned)[7].astype(np.float32)[BALL.faces].reshape(-1, 3)
    np.testing.assert_array_equal(shown.graphic.points[shown.graphic.faces].reshape(-1, 3), corners)


def test_rerun_gets_the_skin_of_each_shown_tick(skinned: Result, tmp_path: Path) -> None:
    path = tmp_path / "skin.rrd"
    view_result(skinned, parse_target(str(path)), every=9)
    recording = Recording(path)
    positions = recording.array("/world/skin", "Mesh3D:vertex_positions")
    np.testing.assert_array_equal(positions, skin_of(skinned)[::9].astype(np.float32))
    normals = recording.array("/world/skin", "Mesh3D:vertex_normals")
    # A ball's normals lead away from its middle, as nearly as its triangles are.
    away = BALL.vertices / np.linalg.norm(BALL.vertices, axis=1, keepdims=True)
    assert (np.einsum("tvi,vi->tv", normals, away) > np.cos(np.radians(1.0))).all()


SMALL = 160
"""Width of a small film [pixels]."""


@pytest.mark.parametrize("slow", [1.0, 2.0, 0.5, 7.3])
def test_a_frame_shows_the_newest_tick_at_its_time(result: Result, slow: float) -> None:
    ticks = video_ticks(result, slow)
    times = np.arange(len(ticks) - 1) / (FPS * slow)
    expected = [max(t for t in range(result.ticks) if t / result.rate <= time + 1e-12) for time in times]
    assert ticks[:-1].tolist() == expected
    assert ticks[-1] == result.ticks - 1
    assert (np.diff(ticks) >= 0).all()


@pytest.mark.parametrize("suffix", [".gif", ".webp"])
@pytest.mark.quick(".gif")
def test_an_animation_has_its_frames_and_its_speed(suffix: str, result: Result, tmp_path: Path) -> None:
    path = tmp_path / f"film{suffix}"
    seen: list[tuple[int, int]] = []
    frames = write_video(result, path, 2.0, SMALL, lambda what, done, count: seen.append((done, count)))
    assert frames == len(video_ticks(result, 2.0))
    assert seen == [(number, frames) for number in range(frames)]
    with Image.open(path) as shown:
        assert (getattr(shown, "n_frames"), shown.size) == (frames, (160, 120))  # noqa: B009
        assert shown.info["loop"] == 0
        first = np.asarray(shown.convert("RGB")).astype(int)
        shown.seek(frames - 1)
        shown.load()
        assert shown.info["duration"] == 40
        last = np.asarray(shown.convert("RGB")).astype(int)
    assert (np.abs(first - last).max(axis=2) > 60).mean() > 0.02, "nothing moves"
    assert sorted(path.name for path in tmp_path.iterdir()) == [path.name]


def test_what_cannot_be_result_is_told_before_the_work(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(OutputError, match="no folder"):
        check_video_path(tmp_path / "nowhere" / "film.gif")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(InputError, match="needs the program ffmpeg"):
        check_video_path(tmp_path / "film.mp4")
    monkeypatch.setattr(film, "MOST_FRAMES", 3)
    with pytest.raises(InputError, match="the most are 3"):
        video_ticks(result, 1.0)


@pytest.fixture
def fake_ffmpeg(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A program of that name that keeps what it is given, or fails where a file says so."""
    folder = tmp_path_factory.mktemp("bin")
    program = folder / "ffmpeg"
    program.write_text(
        f'#!/bin/sh\nfor last; do :; done\n[ -e {folder}/fail ] && echo "no codec" >&2 && exit 1\ncat > "$last"\n'
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    yield folder


def test_ffmpeg_gets_every_frame_whole(result: Result, tmp_path: Path, fake_ffmpeg: Path) -> None:
    frames = write_video(result, tmp_path / "film.mp4", width=SMALL)
    expected = b"".join(frame.tobytes() for frame in video_frames(result, video_ticks(result, 1.0), SMALL))
    assert (tmp_path / "film.mp4").read_bytes() == expected
    assert len(expected) == frames * 120 * 160 * 3


def test_an_ffmpeg_that_fails_leaves_nothing(result: Result, tmp_path: Path, fake_ffmpeg: Path) -> None:
    (fake_ffmpeg / "fail").touch()
    (tmp_path / "film.mp4").write_bytes(b"older")
    with pytest.raises(OutputError, match=r"ffmpeg cannot write .*no codec"):
        write_video(result, tmp_path / "film.mp4", width=SMALL)
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("film.mp4", b"older")]


@pytest.mark.skipif(shutil.which("ffmpeg") is None or shutil.which("ffprobe") is None, reason="no ffmpeg")
def test_an_mp4_plays(result: Result, tmp_path: Path) -> None:
    frames = write_video(result, tmp_path / "film.mp4", width=SMALL)
    command = ["ffprobe", "-v", "error", "-count_frames", "-show_entries", "stream=width,height,nb_read_frames"]
    command += ["-of", "csv=p=0", tmp_path / "film.mp4"]
    answer = subprocess.run(command, capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == f"160,120,{frames}"

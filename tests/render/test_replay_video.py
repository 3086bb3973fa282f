"""A film shows the ticks that it says, at the speed that it says, and what moves in it is where the result says."""

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from short_grasp import short_result

from hhsim.errors import InputError, OutputError
from hhsim.render import replay_video
from hhsim.render.rasterizer import OVERSAMPLING, Camera, look_from, shade
from hhsim.render.replay_video import VideoOptions, check_video_path, video_frames, video_ticks, write_video
from hhsim.render.triangle_soup import SKIN, round_cone_surface
from hhsim.result.reader import Result

SMALL = VideoOptions(width=160)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("replay") / "short.h5")


@pytest.mark.parametrize(("slow", "fps"), [(1.0, 25.0), (2.0, 25.0), (0.5, 30.0), (7.3, 24.0)])
def test_a_frame_shows_the_newest_tick_at_its_time(result: Result, slow: float, fps: float) -> None:
    ticks = video_ticks(result, VideoOptions(slow=slow, fps=fps))
    times = np.arange(len(ticks) - 1) / (fps * slow)
    expected = [max(t for t in range(result.ticks) if t / result.rate <= time + 1e-12) for time in times]
    assert ticks[:-1].tolist() == expected
    assert ticks[-1] == result.ticks - 1
    assert (np.diff(ticks) >= 0).all()


def test_a_part_of_a_picture_is_rendered_as_in_the_whole(result: Result) -> None:
    cone = round_cone_surface(np.array([0.01, 0.0, 0.02]), np.array([0.05, 0.02, 0.03]), 8e-3, 6e-3, SKIN)
    camera = Camera(look_from((1.0, 0.5, 0.3)), np.array([0.0, 0.0, 0.01]), 0.2, (240, 320))
    part = replay_video._part(cone.points, camera)
    whole, cut = shade(cone, camera), shade(cone, replay_video._camera_part(camera, part))
    fine = tuple(slice(OVERSAMPLING * side.start, OVERSAMPLING * side.stop) for side in part)
    assert whole.seen().sum() == cut.seen().sum() > 1000
    np.testing.assert_allclose(cut.depth, whole.depth[fine], atol=1e-9)
    np.testing.assert_allclose(cut.facing, whole.facing[fine], atol=1e-6)


def test_a_gif_has_its_frames_and_its_speed(result: Result, tmp_path: Path) -> None:
    path = tmp_path / "film.gif"
    seen: list[tuple[int, int]] = []
    frames = write_video(
        result, path, VideoOptions(width=160, slow=2.0), lambda what, done, count: seen.append((done, count))
    )
    assert frames == len(video_ticks(result, VideoOptions(slow=2.0)))
    assert seen == [(number, frames) for number in range(frames)]
    with Image.open(path) as film:
        assert (getattr(film, "n_frames"), film.size) == (frames, (160, 120))  # noqa: B009
        assert film.info["duration"] == 40
        assert film.info["loop"] == 0
        first = np.asarray(film.convert("RGB")).astype(int)
        film.seek(frames - 1)
        last = np.asarray(film.convert("RGB")).astype(int)
    assert (np.abs(first - last).max(axis=2) > 60).mean() > 0.02, "nothing moves"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["film.gif"]


def test_a_frame_holds_the_hand_on_white(result: Result) -> None:
    (frame,) = video_frames(result, np.array([0]), VideoOptions(width=320))
    red, green, blue = (frame[..., channel].astype(int) for channel in range(3))
    skin = (red > green + 15) & (green > blue)
    assert 0.02 < skin.mean() < 0.6
    assert frame.shape == (240, 320, 3)
    assert (frame[0] == 255).all()


def test_what_cannot_be_filmed_is_told_before_the_work(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match=r"\.gif or \.mp4"):
        check_video_path(tmp_path / "film.avi")
    with pytest.raises(OutputError, match="no folder"):
        check_video_path(tmp_path / "nowhere" / "film.gif")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(InputError, match="needs the program ffmpeg"):
        check_video_path(tmp_path / "film.mp4")
    for options in ({"slow": 0.0}, {"slow": float("nan")}, {"fps": 0.0}, {"width": 10}):
        with pytest.raises(InputError, match="expected"):
            VideoOptions(**options)
    monkeypatch.setattr(replay_video, "MOST_FRAMES", 3)
    with pytest.raises(InputError, match="the most are 3"):
        video_ticks(result, VideoOptions())


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
    frames = write_video(result, tmp_path / "film.mp4", SMALL)
    expected = b"".join(frame.tobytes() for frame in video_frames(result, video_ticks(result, SMALL), SMALL))
    assert (tmp_path / "film.mp4").read_bytes() == expected
    assert len(expected) == frames * 120 * 160 * 3


def test_an_ffmpeg_that_fails_leaves_nothing(result: Result, tmp_path: Path, fake_ffmpeg: Path) -> None:
    (fake_ffmpeg / "fail").touch()
    (tmp_path / "film.mp4").write_bytes(b"older")
    with pytest.raises(OutputError, match=r"ffmpeg cannot write .*no codec"):
        write_video(result, tmp_path / "film.mp4", SMALL)
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("film.mp4", b"older")]


@pytest.mark.skipif(shutil.which("ffmpeg") is None or shutil.which("ffprobe") is None, reason="no ffmpeg")
def test_an_mp4_plays(result: Result, tmp_path: Path) -> None:
    frames = write_video(result, tmp_path / "film.mp4", SMALL)
    command = ["ffprobe", "-v", "error", "-count_frames", "-show_entries", "stream=width,height,nb_read_frames"]
    answer = subprocess.run(
        [*command, "-of", "csv=p=0", tmp_path / "film.mp4"], capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == f"160,120,{frames}"

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
from hhsim.result.reader import Result
from hhsim.view import film
from hhsim.view.film import FPS, check_video_path, video_frames, video_ticks, write_video

SMALL = 160
"""Width of a small film [pixels]."""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("replay") / "short.h5")


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


def test_what_cannot_be_filmed_is_told_before_the_work(
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
    answer = subprocess.run(
        [*command, "-of", "csv=p=0", tmp_path / "film.mp4"], capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == f"160,120,{frames}"

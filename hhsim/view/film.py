"""Film of a result: graphic hand in skin colour, haptic hand in blue, forces in red, a transparent object.

Pillow writes a GIF or a WebP, the program ffmpeg an MP4.
"""

import contextlib
import io
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, OutputError
from hhsim.hand.quaternion import rotation_matrix
from hhsim.metrics.metrics import FORCE_FLOOR
from hhsim.render import triangle_soup as soup
from hhsim.render.hand_picture import transparent
from hhsim.render.rasterizer import OVERSAMPLING, composed, frame, shade
from hhsim.result.reader import Result
from hhsim.system.atomic_write import partial_file, write_atomically
from hhsim.system.input_file import media_kind_of
from hhsim.system.output_path import check_output_path
from hhsim.system.progress import Progress, silent
from hhsim.view.scene_log import Moment, both_hands, clearest_view, moment, overview_tick
from hhsim.view.viewer import shown_scene

Picture = NDArray[np.uint8]

SUFFIXES = (".gif", ".webp", ".mp4")
QUALITY = 45
"""Quality of a WebP, 0 to 100."""
FPS = 25.0
"""Frames a second."""
ASPECT = 0.75
MOST_FRAMES = 20_000
FRAMED = 40
"""Ticks that decide what fits into the picture."""
FINENESS = 1.25
"""Rendered pixels for one of a frame, across: more is smoother, and slower by its square."""
INK = (36, 41, 47)


def frame_shape(width: int) -> tuple[int, int]:
    """Return rows and columns of a frame about so wide [pixels], even as video codecs want them."""
    return 2 * round(0.5 * ASPECT * width), 2 * round(0.5 * width)


def check_video_path(output_path: Path) -> None:
    """Raise InputError for a suffix not of `SUFFIXES`, or .mp4 without ffmpeg; OutputError as `check_output_path`."""
    suffix = output_path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{output_path}: a film is a file that ends in .gif, .webp or .mp4")
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError(f"{output_path} needs the program ffmpeg, which is not installed here: name a .gif instead")
    ours = "a picture (GIF)", "a picture (WebP)", "a video (MP4)"
    check_output_path(output_path, "film", lambda path: media_kind_of(path) in ours)


def write_video(
    result: Result,
    output_path: Path,
    slow: float = 1.0,
    width: int = 640,
    progress: Progress = silent,
    other: Result | None = None,
) -> int:
    """Make a film of a result, complete or not, and return its number of frames; it appears when it is whole.

    Args:
        slow: Factor by which it is slower than the motion.
        width: Width of a frame [pixels].
        other: Result of the other hand on the same object.

    Raises:
        InputError: As `video_ticks`; or the result's hand cannot be told.
        OutputError: The file cannot be written: ffmpeg fails, or a full disk.
    """
    ticks = video_ticks(result, slow)

    def frames() -> Iterator[Picture]:
        for number, picture in enumerate(video_frames(result, ticks, width, other)):
            progress("frames", number, len(ticks))
            yield picture

    if output_path.suffix.lower() == ".mp4":
        _write_mp4(frames(), output_path, frame_shape(width))
    else:
        _write_animation(frames(), output_path)
    return len(ticks)


def video_ticks(result: Result, slow: float) -> IntArray:
    """Return the tick that each frame shows, shape (frames,): the newest one at its time, the last tick last.

    InputError for a result without a tick, or a film of more than `MOST_FRAMES` frames.
    """
    if result.ticks == 0:
        raise InputError(f"{result.path} holds no tick")
    step = result.rate / (FPS * slow)
    count = int((result.ticks - 1) / step) + 1
    if count > MOST_FRAMES:
        raise InputError(f"a film of {count:,} frames: the most are {MOST_FRAMES:,}; play it faster with --slow")
    ticks = np.floor(step * np.arange(count) + 1e-9).astype(np.int64)
    return ticks if ticks[-1] == result.ticks - 1 else np.append(ticks, result.ticks - 1)


def video_frames(result: Result, ticks: IntArray, width: int, other: Result | None = None) -> Iterator[Picture]:
    """Yield pictures, shape (rows, columns, 3), by one camera that sees hands and object near them all the time.

    InputError for a result whose hand cannot be told (`hhsim.replay.stored_scene.stored_hand`).
    """
    results = [result] if other is None else [result, other]
    scenes = [shown_scene(one) for one in results]
    pieces, scene = [soup.piece_surfaces(one.hand) for one in scenes], scenes[0]

    def at(tick: int) -> Moment:
        return both_hands([moment(one, scenes[i], tick, pieces[i]) for i, one in enumerate(results)])

    some = ticks[:: max(1, len(ticks) // FRAMED)].tolist()
    points = np.concatenate([surface.points for tick in some for surface in at(tick).hands])
    usual = overview_tick(result)
    moves = bool(result.meshes_moved(usual))
    if moves:
        bodies = [soup.mesh_surface(mesh, soup.STONE) for mesh, _ in scene.bodies.values()]
        body = _at_tick(bodies, result, usual)
        points = np.concatenate([points, *(scene.placed(result.meshes_moved(tick)).box_corners for tick in some)])
    else:
        body = soup.mesh_surface(soup.near_hands(scene.mesh, points), soup.STONE)
    shown = at(usual)
    rows, columns = (round(FINENESS / OVERSAMPLING * side) for side in frame_shape(width))
    view = clearest_view(shown, body)
    camera = frame(np.concatenate([points, body.points]), soup.look_from(view.towards), (rows, columns), margin=0.06)
    stone = shade(body, camera)
    for tick in ticks.tolist():
        # An object that stands still is rendered once.
        if moves:
            stone = shade(_at_tick(bodies, result, tick), camera)
        now = at(tick)
        layers, _ = transparent(*now.hands, stone, now.forces, camera)
        yield _written_on(composed(layers), results, tick, width)


def _at_tick(bodies: Sequence[soup.Surface], result: Result, tick: int) -> soup.Surface:
    now = zip(bodies, result.meshes_moved(tick), strict=True)
    return soup.joined([soup.moved(body, rotation_matrix(motion.turn[0]), motion.shift[0]) for body, motion in now])


def _written_on(picture: FloatArray, results: Sequence[Result], tick: int, width: int) -> Picture:
    """Return the frame with time, phase and each hand's force written below."""
    from PIL import Image, ImageDraw, ImageFont

    rows, columns = frame_shape(width)
    drawn = Image.fromarray(np.rint(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8))
    image = drawn.resize((columns, rows), Image.Resampling.LANCZOS)
    size = max(11, round(0.028 * image.width))
    forces = [float(np.linalg.norm(one["force/total"][tick])) for one in results]
    felt = [f"{force:.2f} N" for force in forces if force >= FORCE_FLOOR]
    time, phase = float(results[0]["time"][tick]), results[0].phase_at(tick)
    text = "   ".join(filter(None, (f"{time:.3f} s", phase, *felt)))
    place = size, image.height - 1.8 * size
    ImageDraw.Draw(image).text(place, text, fill=INK, font=ImageFont.load_default(size))
    return np.asarray(image)


def _write_animation(frames: Iterator[Picture], output_path: Path) -> None:
    """Write a GIF or a WebP by Pillow."""
    from PIL import Image

    pictures = [Image.fromarray(picture) for picture in frames]
    buffer = io.BytesIO()
    how: dict[str, Any] = {"save_all": True, "duration": round(1000.0 / FPS), "loop": 0}
    if output_path.suffix.lower() == ".webp":
        pictures[0].save(buffer, format="WEBP", append_images=pictures[1:], quality=QUALITY, **how)
    else:
        # One palette for all frames: else colours flicker. It is that of the first frame and of every tenth.
        sheet = pictures[:: max(1, len(pictures) // 10)]
        columns, rows = pictures[0].size
        together = Image.new("RGB", (columns, rows * len(sheet)))
        for number, picture in enumerate(sheet):
            together.paste(picture, (0, number * rows))
        palette = together.quantize(255, dither=Image.Dither.NONE)
        flat = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
        flat[0].save(buffer, format="GIF", append_images=flat[1:], optimize=False, **how)
    write_atomically(output_path, buffer.getvalue())


def _write_mp4(frames: Iterator[Picture], output_path: Path, shape: tuple[int, int]) -> None:
    rows, columns = shape
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{columns}x{rows}"]
    command += ["-r", f"{FPS:g}", "-i", "-", "-an", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    with partial_file(output_path, ".mp4") as partial, tempfile.TemporaryFile() as log:
        program = subprocess.Popen([*command, str(partial)], stdin=subprocess.PIPE, stdout=log, stderr=log)
        assert program.stdin is not None
        try:
            # A program that has ended takes no more: its exit code says why.
            with contextlib.suppress(BrokenPipeError):
                for picture in frames:
                    program.stdin.write(picture.tobytes())
        except BaseException:
            program.kill()
            raise
        finally:
            with contextlib.suppress(BrokenPipeError):
                program.stdin.close()
            code = program.wait()
        if code != 0:
            log.seek(0)
            lines = log.read().decode(errors="replace").strip().splitlines()
            raise OutputError(f"ffmpeg cannot write {output_path}: {lines[-1] if lines else 'it says nothing'}")

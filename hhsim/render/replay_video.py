"""Film of a result: graphic hand in skin colour, haptic hand in blue, forces in red, a transparent object.

Frames are rendered as by `hhsim.render.replay_figure`. Pillow writes a GIF, the program ffmpeg an MP4.
"""

import contextlib
import io
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, OutputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.metrics.metrics import FORCE_FLOOR
from hhsim.render import replay_figure as still
from hhsim.render.hand_meshes import piece_poses, piece_surfaces
from hhsim.render.rasterizer import OVERSAMPLING, Camera, Layer, composed, frame, look_from, shade
from hhsim.render.triangle_soup import Surface, joined, mesh_surface, near_hands, painted
from hhsim.render.viewpoint import viewpoint
from hhsim.replay.stored_scene import stored_hand, stored_mesh
from hhsim.result.reader import Result
from hhsim.system.atomic_write import write_atomically
from hhsim.system.output_path import check_output_path
from hhsim.system.progress import Progress, silent

Picture = NDArray[np.uint8]

SUFFIXES = (".gif", ".mp4")
ASPECT = 0.75
LEAST_WIDTH, MOST_WIDTH = 160, 1920
MOST_FRAMES = 20_000
FRAMED = 40
"""Ticks that decide what fits into the picture."""
FINENESS = 1.25
"""Rendered pixels for one of a frame, across: more is smoother, and slower by its square."""
ROOM = 3
"""Margin around what moves [pixels]."""
INK = (36, 41, 47)


@dataclass(frozen=True)
class VideoOptions:
    """Options of a film: slow-down factor, frames a second, and width of a frame [pixels]; InputError out of range."""

    slow: float = 1.0
    fps: float = 25.0
    width: int = 640

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0.01 <= self.slow <= 1000.0:
            raise InputError(f"{self.slow:g} times slower: expected 0.01 to 1000")
        if not 1.0 <= self.fps <= 100.0:
            raise InputError(f"{self.fps:g} frames a second: expected 1 to 100")
        if not LEAST_WIDTH <= self.width <= MOST_WIDTH:
            raise InputError(f"a film {self.width} pixels wide: expected {LEAST_WIDTH} to {MOST_WIDTH}")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a frame [pixels], even as video codecs want them."""
        return 2 * round(0.5 * ASPECT * self.width), 2 * round(0.5 * self.width)


def check_video_path(output_path: Path) -> None:
    """Raise InputError for a name but .gif or .mp4, or .mp4 without ffmpeg; OutputError as `check_output_path`."""
    suffix = output_path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{output_path}: a film is a file that ends in .gif or .mp4")
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError(f"{output_path} needs the program ffmpeg, which is not installed here: name a .gif instead")
    check_output_path(output_path)


def write_video(
    result: Result, output_path: Path, options: VideoOptions | None = None, progress: Progress = silent
) -> int:
    """Make a film of a result, complete or not, and return its number of frames; it appears when it is whole.

    Raises:
        InputError: As `check_video_path` and `video_ticks`; or the result's hand cannot be told.
        OutputError: As `check_video_path`; ffmpeg fails, or a full disk.
    """
    chosen = options or VideoOptions()
    check_video_path(output_path)
    ticks = video_ticks(result, chosen)

    def frames() -> Iterator[Picture]:
        for number, picture in enumerate(video_frames(result, ticks, chosen)):
            progress("frames", number, len(ticks))
            yield picture

    (_write_gif if output_path.suffix.lower() == ".gif" else _write_mp4)(frames(), output_path, chosen)
    return len(ticks)


def video_ticks(result: Result, options: VideoOptions) -> IntArray:
    """Return the tick that each frame shows, shape (frames,): the newest one at its time, the last tick last.

    Raises:
        InputError: The result holds no tick, or the film would have more than `MOST_FRAMES` frames.
    """
    if result.ticks == 0:
        raise InputError(f"{result.path} holds no tick")
    step = result.rate / (options.fps * options.slow)
    count = int((result.ticks - 1) / step) + 1
    if count > MOST_FRAMES:
        raise InputError(f"a film of {count:,} frames: the most are {MOST_FRAMES:,}; play it faster with --slow")
    ticks = np.floor(step * np.arange(count) + 1e-9).astype(np.int64)
    return ticks if ticks[-1] == result.ticks - 1 else np.append(ticks, result.ticks - 1)


def video_frames(result: Result, ticks: IntArray, options: VideoOptions) -> Iterator[Picture]:
    """Yield pictures, shape (rows, columns, 3), by one camera that sees hands and object near them all the time.

    Raises:
        InputError: The result's hand cannot be told (`hhsim.replay.stored_scene.stored_hand`).
    """
    hand = stored_hand(result)
    pieces = piece_surfaces(hand)
    whole = mesh_surface(stored_mesh(result), still.STONE)
    some = ticks[:: max(1, len(ticks) // FRAMED)]
    points = np.concatenate([joined(_hands(result, hand, pieces, int(tick))).points for tick in some])
    body = near_hands(whole, points)
    if result.driven:
        body = _moved(whole, result, still.shown_tick(result))
        corners = stored_mesh(result).box_corners[None]
        moves = (result.moved_since_first(int(tick)) for tick in some)
        points = np.concatenate([points, *(moved.points(corners)[0] for moved in moves)])
    forces = _forces(result, still.shown_tick(result))
    marks = np.array([force.contact for force in forces]).reshape(-1, 3)
    vectors = np.array([still.arrow(force) for force in forces]).reshape(-1, 3)
    rows, columns = (round(FINENESS / OVERSAMPLING * side) for side in options.shape)
    view = viewpoint(_hands(result, hand, pieces, still.shown_tick(result))[0], body, marks, vectors)
    points = np.concatenate([points, body.points[np.unique(body.faces)]])
    camera = frame(points, look_from(view.towards), (rows, columns), margin=0.06)
    # An object that stands still is rendered once, and of each frame the part where a hand or a force is.
    stone = shade(body, camera)
    background = composed([(stone, still.BODY_OPACITY)])
    for tick in ticks.tolist():
        if result.driven:
            stone = shade(_moved(whole, result, tick), camera)
            background = composed([(stone, still.BODY_OPACITY)])
        graphic, haptic = _hands(result, hand, pieces, tick)
        arrows = still.arrow_surfaces(_forces(result, tick))
        part = _part(np.concatenate([surface.points for surface in (graphic, haptic, *arrows)]), camera)
        picture = background.copy()
        down, across = (slice(OVERSAMPLING * side.start, OVERSAMPLING * side.stop) for side in part)
        behind = Layer(stone.color[down, across], stone.depth[down, across], stone.facing[down, across])
        picture[down, across] = composed(still.transparent(graphic, haptic, behind, arrows, _camera_part(camera, part)))
        yield _written_on(picture, result, tick, options)


def _moved(surface: Surface, result: Result, tick: int) -> Surface:
    """Return the object at its place at a tick."""
    moved = result.moved_since_first(tick)
    points, normals = moved.points(surface.points[None])[0], moved.vectors(surface.normals[None])[0]
    return replace(surface, points=points, normals=normals)


def _forces(result: Result, tick: int) -> list[still.PhalanxForce]:
    """Return the forces of a tick that can be felt, in the world."""
    found = still.phalanx_forces(result.seen_from_object, tick)
    if not result.driven:
        return found
    moved = result.moved_since_first(tick)
    return [
        replace(one, contact=moved.points(one.contact[None])[0], force=moved.vectors(one.force[None])[0])
        for one in found
    ]


def _hands(result: Result, hand: HandModel, pieces: tuple[Surface, ...], tick: int) -> list[Surface]:
    """Return the graphic hand, and the haptic one in blue."""
    found = []
    for whose in ("graphic", "haptic"):
        pose = HandConfiguration(*(result[f"{whose}/{name}"][tick][None] for name in HandConfiguration._fields))
        places = piece_poses(hand, *pose)
        turns = rotation_matrix(places.quaternion[0])
        moved = [
            replace(piece, points=piece.points @ turn.T + place, normals=piece.normals @ turn.T)
            for piece, turn, place in zip(pieces, turns, places.translation[0])
        ]
        found.append(joined(moved))
    return [found[0], painted(found[1], still.GHOST)]


def _part(points: FloatArray, camera: Camera) -> tuple[slice, slice]:
    """Return rows and columns of the finished picture that hold these points [m], with a margin for shadows."""
    rows, columns = camera.shape
    scale = rows / camera.height
    seen = (points - camera.center) @ camera.rotation[:2].T * (scale, -scale) + (0.5 * columns, 0.5 * rows)
    low = np.clip(np.floor(seen.min(axis=0)).astype(int) - ROOM, 0, (columns - 1, rows - 1))
    high = np.clip(np.ceil(seen.max(axis=0)).astype(int) + ROOM, low + 1, (columns, rows))
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))


def _camera_part(camera: Camera, part: tuple[slice, slice]) -> Camera:
    """Return the camera of a part of another one's picture, pixel for pixel."""
    rows, columns = camera.shape
    down, across = (0.5 * (side.start + side.stop) for side in part)
    pixel = camera.height / rows
    offset = np.array([(across - 0.5 * columns) * pixel, (0.5 * rows - down) * pixel, 0.0])
    shape = part[0].stop - part[0].start, part[1].stop - part[1].start
    return Camera(camera.rotation, camera.center + offset @ camera.rotation, shape[0] * pixel, shape)


def _written_on(picture: FloatArray, result: Result, tick: int, options: VideoOptions) -> Picture:
    """Return the frame with time, phase and force written below."""
    from PIL import Image, ImageDraw, ImageFont

    rows, columns = options.shape
    drawn = Image.fromarray(np.rint(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8))
    image = drawn.resize((columns, rows), Image.Resampling.LANCZOS)
    size = max(11, round(0.028 * image.width))
    force = float(np.linalg.norm(result["force/total"][tick]))
    felt = f"{force:.2f} N" if force >= FORCE_FLOOR else ""
    text = "   ".join(filter(None, (f"{float(result['time'][tick]):.3f} s", result.phase_at(tick), felt)))
    place = size, image.height - 1.8 * size
    ImageDraw.Draw(image).text(place, text, fill=INK, font=ImageFont.load_default(size))
    return np.asarray(image)


def _write_gif(frames: Iterator[Picture], output_path: Path, options: VideoOptions) -> None:
    from PIL import Image

    # One palette for all frames: else colours flicker. It is that of the first frame and of every tenth.
    pictures = [Image.fromarray(picture) for picture in frames]
    sheet = pictures[:: max(1, len(pictures) // 10)]
    columns, rows = pictures[0].size
    together = Image.new("RGB", (columns, rows * len(sheet)))
    for number, picture in enumerate(sheet):
        together.paste(picture, (0, number * rows))
    palette = together.quantize(255, dither=Image.Dither.NONE)
    flat = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    buffer = io.BytesIO()
    # Browsers play what asks for less than 20 ms a frame ten times slower.
    duration = max(20, round(1000.0 / options.fps))
    flat[0].save(buffer, format="GIF", save_all=True, append_images=flat[1:], duration=duration, loop=0, optimize=False)
    write_atomically(output_path, buffer.getvalue())


def _write_mp4(frames: Iterator[Picture], output_path: Path, options: VideoOptions) -> None:
    rows, columns = options.shape
    partial = output_path.with_name(f".{output_path.name}.{os.getpid()}.mp4")
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{columns}x{rows}"]
    command += ["-r", f"{options.fps:g}", "-i", "-", "-an", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    try:
        with tempfile.TemporaryFile() as log:
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
        partial.replace(Path(os.path.realpath(output_path)))
    finally:
        partial.unlink(missing_ok=True)

"""A result in the rerun viewer, with all of its hands."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hhsim.arrays import AnyArray, FloatArray
from hhsim.errors import InputError
from hhsim.hand.fingers import FINGERS
from hhsim.metrics.moving_parts import bodies_mesh, result_parts
from hhsim.replay.stored_scene import stored_hand
from hhsim.result.reader import Result
from hhsim.result.safety import why_free_or_held
from hhsim.result.schema import LIVE_EVENT, LIVE_TICK
from hhsim.solver.options import TOUCH
from hhsim.system.progress import Progress, silent
from hhsim.view import plots
from hhsim.view.scene_log import APPLICATION, EVENT_LEVELS, OBJECT, RerunScene, ShownScene, status_words
from hhsim.view.sink import NOTEBOOK, RerunTarget, rerun_stream

if TYPE_CHECKING:
    import rerun.blueprint as rrb


BLOCK_TICKS = 16_384

LIVE_COLUMNS = tuple(f"{LIVE_TICK}/{name}" for name in ("command_stiffness", "wakeup", "latency"))
"""Datasets of a session for `GLOVE` and `LOOP`."""
MOST_FRAMED = 50
"""Ticks that decide where the scene is looked at from."""

MANY_TICKS = 200_000
"""Number of ticks from which on a viewer needs gigabytes."""


class Shown(NamedTuple):
    """One hand's result with the beginning of its entities' names, and its scene."""

    root: str
    result: Result
    scene: ShownScene

    def bounds(self) -> FloatArray:
        """Return least and largest corner [m], shape (2, 3), of object and hand while they touch."""
        result, touching = self.result, np.flatnonzero(self.result["contacts/touching"])
        some = touching[:: max(1, len(touching) // MOST_FRAMED)] if len(touching) else np.arange(1)
        joints = (result.at(int(tick), ("graphic/joints",))["graphic/joints"] for tick in some)
        bodies = (self.scene.placed(result.meshes_moved(int(tick))).bounds for tick in some)
        points = np.concatenate([*(placed.reshape(-1, 3) for placed in joints), *bodies])
        return np.stack([points.min(axis=0), points.max(axis=0)])


@dataclass(frozen=True)
class Viewed:
    """Number of ticks of the hands that are shown, of those with a pose in the viewer, and where they went."""

    ticks: int
    shown: int
    target: RerunTarget

    def to_json(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"ticks": self.ticks, "shown_ticks": self.shown, "rerun": str(self.target)}


def view_result(
    result: Result,
    target: RerunTarget = NOTEBOOK,
    *,
    every: int = 1,
    spheres: bool = False,
    progress: Progress = silent,
) -> Viewed:
    """Show a result of a replay or a session, complete or not; by default in the notebook whose cell calls this.

    Of a file of two hands as a whole both are shown. Only every so-manieth tick is shown (`every`); plots but for
    forces show the worst of the ticks between. With `spheres` the leaf spheres stand in place of the object's mesh.
    Raises InputError for a result without a tick, or that cannot be read; and as `rerun_stream`, OutputError too.
    """
    if every < 1:
        raise InputError(f"every {every} ticks: expected 1 or more")
    hands, shown = [result] if result.name else list(result.hands.values()), []
    for result in hands:
        if result.ticks == 0:
            raise InputError(f"{result.label} holds no tick")
        root = f"{result.name}/" if len(hands) > 1 else ""
        shown.append(Shown(root, result, shown_scene(result, spheres=spheres)))
    with rerun_stream(target, APPLICATION, arranged(shown)) as stream:
        stream.send_recording_name(hands[0].path.name)
        for one in shown:
            send_ticks(RerunScene(stream, one.scene, one.root), one.result, every, progress)
    ticks = [result.ticks for result in hands]
    return Viewed(sum(ticks), sum(-(-count // every) for count in ticks), target)


def send_ticks(viewer: RerunScene, result: Result, every: int, progress: Progress) -> None:
    """Send a result block by block, what is fixed first; `every` as of `view_result`."""
    viewer.log_static(result_plots(result))
    time, changes = result["time"], dict[int, str]()
    # A gap between two phases has no state.
    for phase in sorted(result.phases, key=lambda phase: phase.first_tick):
        changes[phase.first_tick] = phase.name
        if phase.last_tick + 1 < result.ticks:
            changes[phase.last_tick + 1] = ""
    starts = sorted(changes)
    viewer.log_states("phase", starts, [float(time[tick]) for tick in starts], [changes[tick] for tick in starts])
    log_lane(viewer, "ticks", time, result["status"], status_words)
    if result.live is not None:
        log_lane(viewer, "fingers", time, result[f"{LIVE_TICK}/safety"], why_free_or_held)
        begin = float(result[f"{LIVE_TICK}/deadline"][0]) - 1e9 * float(time[0])
        for time_ns, level, text in zip(*(result[f"{LIVE_EVENT}/{name}"] for name in ("time", "level", "text"))):
            words = text.decode("utf-8", "replace")
            viewer.log_event(1e-9 * (float(time_ns) - begin), EVENT_LEVELS[int(level)], words)
    # A block holds whole groups of ticks, so that each shown tick has those that it stands for.
    step = max(1, BLOCK_TICKS // every) * every
    names = (*plots.SHOWN_COLUMNS, *(LIVE_COLUMNS if result.live is not None else ()))
    for number, block in enumerate(result.blocks(names, step)):
        first, count, more = number * step, len(block["time"]), {}
        progress("ticks", first, result.ticks)
        if result.live is not None:
            stiffness, wakeup, latency = (block[name] for name in LIVE_COLUMNS)
            more = {plots.GLOVE: stiffness, plots.LOOP: plots.loop_values(wakeup, latency)}
        moved = result.meshes_moved(slice(first, first + count))
        kept = np.arange(0, count, every)
        numbers = np.arange(first, first + count)
        ticks = plots.shown_ticks(block.__getitem__, numbers, kept, kept, more, moved)
        viewer.log_ticks(ticks)
        if result.skin_faces is not None:
            viewer.log_skin(ticks, result.skin(slice(first, first + count, every)), result.skin_faces)
    progress("ticks", result.ticks, result.ticks)


def shown_scene(result: Result, *, spheres: bool = False) -> ShownScene:
    """Return what does not change with time; raise InputError for an unknown hand or a damaged mesh or tree."""
    solver = result.scene.get("solver", {})
    used = solver.get("fingers", FINGERS)
    return ShownScene(
        mesh=bodies_mesh(result),
        tree=result.body.tree,
        hand=stored_hand(result),
        fingers=np.array([finger in used for finger in FINGERS]),
        touch=float(solver.get("touch", TOUCH)),
        surface=str(solver.get("surface", "spheres")),
        spheres=spheres,
        text=description(result),
        parts=result_parts(result),
    )


def result_plots(result: Result) -> tuple[plots.Plot, ...]:
    """Return the plots of a replay, or of a session."""
    return plots.RESULT_PLOTS if result.live is None else plots.LIVE_PLOTS


def arranged(shown: Sequence[Shown]) -> "rrb.Blueprint":
    """Arrange the views of the hands of a file; the scene is seen from where it fills the view while they touch."""
    result, corners = shown[0].result, np.array([one.bounds() for one in shown])
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    duration = np.concatenate([1e-3 * one.result["duration/total"] for one in shown])
    # A pause of the machine is a thousand ticks long: it would flatten all that the plot is for.
    top = min(float(duration.max()), 4.0 * float(np.quantile(duration, 0.99)))
    # The viewer draws spheres with flat facets: the mesh would show through where no sphere leaves it. Two hands have
    # one object, which is drawn once.
    hidden = [f"{one.root}{OBJECT}" for one in shown if one.scene.spheres or one is not shown[0]]
    hidden += [f"{one.root}world/graphic" for one in shown if one.result.skin_faces is not None]
    return plots.blueprint(
        0.5 * (low + high),
        float(np.linalg.norm(high - low)),
        f"{result.path.name}: graphic hand, haptic hand (blue), contact forces (red)",
        result_plots(result),
        hidden=hidden,
        tops={plots.TIME: max(top, 1.0)},
        hands={one.root: one.result.name for one in shown},
    )


def description(result: Result) -> str:
    """Return what was run and what came out, as Markdown."""
    lines = [f"# {result.path.name}", "", f"`{result!r}`, by hhsim {result.hhsim_version}, {result.created_utc}"]
    lines += ["", "| summary | SI units |", "|---|---|"]
    shown = {name: f"{value:.6g}" if isinstance(value, float) else value for name, value in result.summary.items()}
    lines += [f"| {name} | {value} |" for name, value in shown.items()]
    solver = json.dumps(result.scene.get("solver", {}), indent=1)
    return "\n".join([*lines, "", "## Options of the solver", "```json", solver, "```", ""])


def log_lane(viewer: RerunScene, lane: str, time: AnyArray, bits: AnyArray, words: Callable[[int], str]) -> None:
    """Send the bits of the ticks in words as a lane of the state timeline, where they change."""
    change = np.flatnonzero(np.concatenate([[True], bits[1:] != bits[:-1]]))
    viewer.log_states(lane, change.tolist(), time[change].tolist(), [words(int(bits[tick])) for tick in change])

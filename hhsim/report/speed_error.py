"""Picture of speed against error: each result a point, by what its file says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from hhsim.arrays import IntArray
from hhsim.errors import HhsimError
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.metrics.contact_points import find_contact_points
from hhsim.metrics.mesh_penetration import contact_error, mesh_clearance, sampled
from hhsim.metrics.run.registry import tick_figures
from hhsim.metrics.run_ticks import PLACED, result_ticks
from hhsim.motion.trajectory import RigidMotion
from hhsim.report.figure import ReportFigure, drawn_figure, run_style, time_text
from hhsim.report.trade_off import MARKS, Mark, TradeOff, trade_off_drawing
from hhsim.result.reader import Result
from hhsim.scene.motion_catalogue import of_the_paper
from hhsim.trees.contact_surface import encloses
from hhsim.view.viewer import shown_scene

SAMPLES = 20
"""Ticks in contact whose hand is compared with the mesh: exact, and slow."""
PANEL = 2.3, 2.0
"""Least width of a panel with its labels, and its height [inches]."""
PAPER_DEPTH = 1e-4
"""Deepest penetration that the paper states, about [m]."""


@dataclass(frozen=True)
class SpeedError:
    """One result as a point; NaN where a figure is undefined."""

    label: str
    p50: float  # CPU time of a tick in contact [s]
    p99: float
    depth: float  # deepest penetration of the touched surface, leaf spheres or mesh, of all ticks [m]
    mesh: float  # deepest penetration of the mesh, or largest distance of a contact point from it, of sampled ticks [m]
    excess: float  # coupling energy above the optimum, mean of the hold [%]
    of_paper: bool = False  # True if the scene is one of the paper's


AXES = (
    ("depth", "deep in what is touched [µm]", 1e6, 1e-3),
    ("mesh", "off the true mesh [mm]", 1e3, 1e-2),
    ("excess", "over the optimum [%]", 1.0, 1e-3),
)
"""Panels: field of `SpeedError`, title with unit, scale to that unit, and a tenth of the lowest decade shown."""


def speed_error_figure(results: Mapping[str, Result]) -> ReportFigure:
    """Draw each result by its label as a point: CPU time of a tick in contact, p50 to p99, against three errors."""
    points = [_measured(label, result) for label, result in results.items()]
    styles = [(run_style(number)[0], MARKS[number % len(MARKS)]) for number in range(len(points))]
    of_paper = any(point.of_paper for point in points)
    panels = [
        TradeOff(
            title,
            [Mark(point.p50, scale * getattr(point, field), *style, point.p99) for point, style in zip(points, styles)],
            least,
            paper=scale * PAPER_DEPTH if field == "depth" and of_paper else None,
        )
        for field, title, scale, least in AXES
    ]
    names = dict(zip((point.label for point in points), styles))
    drawing = trade_off_drawing(panels, names, PANEL)
    return drawn_figure("speed-error", "Speed against error", _caption(points), _alt(points), drawing)


def _measured(label: str, result: Result) -> SpeedError:
    result = result.seen_from_object
    ticks = result_ticks(result)
    figures = tick_figures(ticks)
    return SpeedError(
        label,
        figures["tick_cpu_p50"],
        figures["tick_cpu_p99"],
        figures["penetration_max"] if result.ticks else np.nan,
        _off_the_mesh(result, np.flatnonzero(ticks.contact)),
        float(result.summary.get("tracking_excess", np.nan)),
        of_the_paper(result.scene),
    )


def _off_the_mesh(result: Result, contact: IntArray) -> float:
    """Return `SpeedError.mesh` at sampled ticks in contact; NaN without one, or where the scene is not known."""
    try:
        scene = shown_scene(result)
        trees = [build_mesh_bvh(mesh.vertices, mesh.faces) for mesh, _ in scene.bodies.values()]
        # Nothing is in a skin.
        solid = [encloses(mesh) for mesh, _ in scene.bodies.values()]
    except HhsimError:
        # The hand, tree or mesh is not that of the run.
        return np.nan
    chosen = sampled(contact, SAMPLES)
    ticks = [result.at(int(tick), PLACED) for tick in chosen]
    if not ticks:
        return np.nan
    placed = PlacedHand(*(np.array([tick[name] for tick in ticks]) for name in ticks[0]))
    touching, farthest = 0, 0.0
    for bvh, has_inside, surface, moved in zip_longest(trees, solid, scene.surface_arrays, result.meshes_moved()):
        seen = placed if moved is None else RigidMotion(moved.turn[chosen], moved.shift[chosen]).seen_hand(placed)
        off = contact_error(bvh, find_contact_points(surface, scene.shape, seen, scene.touch).point)
        farthest = max(farthest, off.max(initial=0.0))
        if has_inside:
            farthest = max(farthest, -mesh_clearance(bvh, scene.shape, seen).min())
        touching += len(off)
    return float(farthest) if touching else np.nan


def _caption(points: Sequence[SpeedError]) -> str:
    text = (
        "Mark: p50 of the CPU time of ticks in contact; the line from it ends at p99. Further left is faster, further "
        "down is nearer to the truth; the axes are logarithmic, with a line of its own for 0 and less. First the "
        "deepest penetration of what is touched, the spheres or the mesh. Then how far the hand is in the true mesh or "
        f"a contact point off it, the larger, at up to {SAMPLES} ticks in contact: it holds the error of the sphere "
        "tree too. Last the coupling energy over that of the local optimum, mean of the hold, as the table has it. "
        "Red: 1 ms."
    )
    if any(point.of_paper for point in points):
        text += " Grey: the paper's mean times for simple objects, on its own machine."
    missing = [point.label for point in points if not np.isfinite(point.p50)]
    return text + (f" Not in contact, so without a point: {', '.join(missing)}." if missing else "")


def _alt(points: Sequence[SpeedError]) -> str:
    sentences = ["CPU time against three errors."]
    for point in points:
        if not np.isfinite(point.p50):
            sentences.append(f"{point.label}: no tick in contact.")
            continue
        off = f"{1e3 * point.mesh:.3g} mm off the mesh" if np.isfinite(point.mesh) else "off the mesh not measured"
        over = (
            f"{round(point.excess, 6) + 0.0:.3g} % over the optimum"
            if np.isfinite(point.excess)
            else "no optimum computed"
        )
        sentences.append(
            f"{point.label}: {time_text(point.p50)} to {time_text(point.p99)}, {1e6 * point.depth:.3g} µm deep in "
            f"what it touches, {off}, {over}."
        )
    return " ".join(sentences)

"""Small pictures of a hand on an object: skin for the graphic hand, blue for the haptic one, as in the paper."""

from itertools import product

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.paper.run import SceneRun
from hhsim.hand.fingers import FINGERS
from hhsim.mesh.mesh import Mesh
from hhsim.render.rasterizer import blend, depth_of, frame, look_from, shade
from hhsim.render.replay_figure import GHOST, STONE, behind
from hhsim.render.triangle_soup import hand_surface, joined, mesh_surface, painted, round_cone_surface
from hhsim.render.viewpoint import View

GLASS = 0.4
"""Opacity of the haptic hand."""
AZIMUTHS, ELEVATIONS = range(0, 360, 45), (15.0, 50.0)
"""Views that are tried [degrees]."""
TRIAL = (48, 48)
"""Rows and columns of a trial view [pixels]."""


def scene_picture(
    run: SceneRun, mesh: Mesh, moment: int = 0, shape: tuple[int, int] = (300, 300), view: FloatArray | None = None
) -> FloatArray:
    """Render the hand at one of the moments that a run of one motion keeps.

    Args:
        mesh: The object's, its own frame.
        shape: Rows and columns of the picture [pixels].
        view: Direction to the viewer, shape (3,); None for `best_view`.

    Returns:
        The picture, shape (rows, columns, 3), 0 to 1.
    """
    shown = run.shown[moment]
    graphic, haptic = (hand_surface(run.stage.hand, *pose) for pose in (shown.graphic, shown.haptic))
    body = mesh_surface(mesh, STONE)
    towards = best_view(run, mesh, moment) if view is None else view
    camera = frame(joined([graphic, body]).points, look_from(towards), shape)
    hand, ghost = shade(graphic, camera), shade(painted(haptic, GHOST), camera)
    return blend([(hand, 1.0), (shade(body, camera), 1.0), (behind(ghost, hand), GLASS)])


def best_view(run: SceneRun, mesh: Mesh, moment: int = 0) -> FloatArray:
    """Return the direction to the viewer that shows most of the fingertips that are to touch.

    Between equals, the visible part of hand and object decides, of whichever shows less.
    """
    pose, hand = run.shown[moment].graphic, run.stage.hand
    joints = hand.joints(*pose)
    named = {touch.part for touches in run.stage.script.hold_touches for touch in touches}
    tips = joined(
        [
            round_cone_surface(joints[f, 2], joints[f, 3], hand.radius[f, 2], hand.radius[f, 3], STONE, 8, 16)
            for f, finger in enumerate(FINGERS)
            if finger in named
        ]
    )
    whole, body = hand_surface(hand, *pose), mesh_surface(mesh, STONE)
    both = joined([whole, body])
    best, most = np.array([1.0, 0.0, 0.0]), -1.0
    for elevation, azimuth in product(ELEVATIONS, AZIMUTHS):
        towards = View(azimuth, elevation).towards
        camera = frame(both.points, look_from(towards), TRIAL)
        skin, stone, tip = (depth_of(surface, camera) for surface in (whole, body, tips))
        pads = float((tip > np.maximum(skin - 1e-3, stone)).sum()) if named else 0.0
        seen = pads + 0.2 * min(float((skin > stone).sum()), 1.5 * float((stone > skin).sum()))
        if seen > most:
            best, most = towards, seen
    return best

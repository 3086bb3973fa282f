"""Result file of a repair: a tick a frame, with the recorded hand as the haptic and the repaired one as the graphic."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary
from hhsim.scene.scene import Scene
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.known_methods import SUBMITTED, known_for_now
from hhsim.solver.options import UNLIMITED, SolverOptions
from hhsim.submissions.pose_file import Submission
from hhsim.submissions.score import submitted_method
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import ContactSurface

METHOD = "hhsim repair"
"""Name of the method in the result of a repair."""
LINEARISATIONS = 100
"""Most linearisations after which the forces of a frame are taken."""


def write_result(
    scene: Scene,
    surface: ContactSurface,
    posture: HandConfiguration,
    path: Path,
    *,
    description: Mapping[str, Any],
    command: Sequence[str] = (),
    progress: Progress = silent,
) -> ReplaySummary:
    """Write the result file of repaired frames, as the object sees them; OutputError if it cannot be written.

    Ticks of the scene are the frames; `surface` bears the forces.
    """
    forces = equilibrium_forces(scene, surface, posture)
    submission = Submission(METHOD, "", scene.ticks.time, posture, *forces)
    name = f"{SUBMITTED}{METHOD}"
    # The hand of the written recording is outside; ours is inside by what the fit left.
    method = replace(submitted_method(name, submission), never_penetrates=False)
    with known_for_now(name, method):
        options = SolverOptions(method=name, surface="mesh")
        more: dict[str, Any] = {"description": description, "command": command, "progress": progress}
        return replay_scene(scene, options, path, **more)


def equilibrium_forces(
    scene: Scene, surface: ContactSurface, posture: HandConfiguration
) -> tuple[FloatArray, FloatArray]:
    """Compute the contact forces that balance the coupling where a hand comes to rest from a posture [N].

    They are on the phalanges, shape (T, 5, 3, 3), and on the palm, shape (T, 3), as the object sees them.
    """
    options = SolverOptions(surface="mesh", linearisations=LINEARISATIONS, budget=UNLIMITED)
    solver = HandSolver(scene.hand, surface, options)
    haptic = HandConfiguration.of(scene.ticks)
    phalanx, palm = np.zeros((posture.ticks, 5, 3, 3)), np.zeros((posture.ticks, 3))
    for frame in range(posture.ticks):
        shown = posture.part(frame, frame + 1)
        solver.place(*shown.at(0))
        # The shown abduction is held: it has no force.
        record = solver.run(*haptic.part(frame, frame + 1)._replace(abduction=shown.abduction))
        phalanx[frame] = record.phalanx[0]
        palm[frame] = record.total[0] - record.phalanx[0].sum(axis=(0, 1))
    return phalanx, palm

"""Result file of a repair: a tick a frame, with the recorded hand as the haptic and the repaired one as the graphic."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from hhsim.arrays import BoolArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.kernels.tick.block import HapticBlock
from hhsim.kernels.tick.method import Coupled
from hhsim.kernels.tick.state import STATUS_STUCK
from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary
from hhsim.scene.scene import Scene
from hhsim.solver.known_methods import SUBMITTED, known_for_now
from hhsim.solver.linearising_engine import LinearisingEngine
from hhsim.solver.method import FORCES, Method
from hhsim.solver.options import SolverOptions
from hhsim.solver.workspace import tick_record
from hhsim.system.progress import Progress, silent

if TYPE_CHECKING:
    from hhsim.kernels.tick.block import TickRecord
    from hhsim.solver.workspace import TickWorkspace

REPAIR = f"{SUBMITTED}hhsim repair"
"""Method of the result of a repair."""
LINEARISATIONS = 100
"""Most linearisations after which the forces of a frame are taken."""


def write_result(
    scene: Scene,
    posture: HandConfiguration,
    marked: BoolArray,
    path: Path,
    *,
    description: Mapping[str, Any],
    command: Sequence[str] = (),
    progress: Progress = silent,
) -> ReplaySummary:
    """Write the result file of repaired frames.

    Args:
        scene: Object and recorded hand; its ticks are the frames.
        posture: Repaired hand of each frame, as the object sees it.
        marked: Frames without a repair, shape (T,), which count as stuck.

    Raises:
        OutputError: The file cannot be written.
    """
    method = Method(
        summary="frames of a recording, repaired",
        engine=cast(Any, partial(_RepairedFrames, posture, marked)),
        never_penetrates=True,
        gives=frozenset([FORCES]),
        compiled=False,
    )
    with known_for_now(REPAIR, method):
        options = SolverOptions(method=REPAIR, surface="mesh")
        more: dict[str, Any] = {"description": description, "command": command, "progress": progress}
        return replay_scene(scene, options, path, **more)


class _RepairedFrames:
    """Engine that shows a given hand in each frame, with the forces of the nearest equilibrium."""

    def __init__(self, posture: HandConfiguration, marked: BoolArray, workspace: "TickWorkspace") -> None:
        self.posture, self.marked, self.workspace, self.frame = posture, marked, workspace, 0
        self.engine = LinearisingEngine(workspace, Coupled(workspace.tick_options))

    def begin(self) -> None:
        """See `hhsim.solver.method.Engine.begin`."""
        self.engine.begin()

    def run(self, haptic: HapticBlock, record: "TickRecord") -> int:
        """See `hhsim.solver.method.Engine.run`."""
        count = len(haptic.position)
        shown = self.posture.part(self.frame, self.frame + count)
        pose = self.workspace.states[0].pose
        for i in range(count):
            for name, values in shown._asdict().items():
                pose[name][:] = values[i]
            self.engine.begin()
            one = tick_record(1)
            # The shown abduction is held: it has no force.
            goal = HapticBlock(*(values[i : i + 1] for values in (*haptic[:3], shown.abduction)))
            self.engine.approach(LINEARISATIONS, goal, one)
            for own, values in zip(record, one, strict=True):
                own[i] = values[0]
        for name, values in shown._asdict().items():
            getattr(record, name)[:count] = values
        record.joints[:count] = forward_kinematics(self.workspace.model, *shown).joints
        record.status[:count] = np.where(self.marked[self.frame : self.frame + count], STATUS_STUCK, 0)
        self.frame += count
        return count

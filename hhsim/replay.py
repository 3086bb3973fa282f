"""The main job: run a hand through a motion, tick by tick, and write down everything.

The ticks run in compiled blocks; each block is measured and written before the next one starts, outside of the timed
ticks.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import HhsimError
from hhsim.interrupt import interruptible_between
from hhsim.kernels.block import TickRecord
from hhsim.kernels.contact import COUNT_NODE_TESTS, COUNT_PAIR_TESTS
from hhsim.kernels.hand import PALM_BODY
from hhsim.kernels.step import DURATION_DETECT, DURATION_FINGERS, DURATION_FORCE, DURATION_PALM
from hhsim.kernels.tick_state import (
    WORK_BODIES,
    WORK_CANDIDATES,
    WORK_LINEARISATIONS,
    WORK_QP_ITERATIONS,
    WORK_ROWS,
    WORK_TOUCHING,
    WORK_UNITS,
)
from hhsim.kernels.tree import TreeArrays
from hhsim.metrics import force_variation_rate, penetration
from hhsim.result import CHUNK_TICKS, ResultWriter
from hhsim.scene import Scene
from hhsim.solver import HandSolver
from hhsim.solver_options import FINGERS, SolverOptions
from hhsim.summary import ReplaySummary, TickSeries, summarise
from hhsim.warm_up import warm_up

Array = NDArray[Any]
Progress = Callable[[str, int, int], None]


def replay(
    scene: Scene,
    options: SolverOptions,
    destination: Path,
    *,
    description: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> ReplaySummary:
    """Replay the scene's motion and write a result file.

    Args:
        scene: Object, hand and motion.
        options: Of the solver.
        destination: The result file; an existing result there is replaced when the new one is complete.
        description: What else the file is to say of how the scene came about, as plain values.
        progress: Called with what is being done, how much is done and how much there is.

    Returns:
        The figures of the table.

    Raises:
        OutputError: The file cannot be written.
        HhsimError: More pairs were near than the solver holds.
    """
    options = replace(options, period=1.0 / scene.ticks.rate)
    prepared = warm_up(scene.hand, options)
    arrays = scene.hand.arrays()
    palm_center = np.stack([arrays.palm_x, arrays.palm_y, arrays.palm_z], axis=1)
    tree = scene.tree.arrays()
    fingers = np.array([finger in options.fingers for finger in FINGERS])
    solver = HandSolver(scene.hand, tree, options)
    ticks, total = scene.ticks, scene.ticks.tick_count
    described = {
        **(description or {}),
        "solver": options.to_json(),
        "rate": ticks.rate,
        "motion": scene.trajectory.name,
        "motion_source": scene.trajectory.source,
        "hand": {"side": scene.hand.side, "length": scene.hand.hand_length, "palm_spheres": len(palm_center)},
        "object_spheres": scene.tree.leaf_count,
        "modelled": modelled(scene, options),
    }
    static = {
        "object/vertices": scene.mesh.vertices,
        "object/faces": scene.mesh.faces,
        "object/tree/center": scene.tree.center,
        "object/tree/radius": scene.tree.radius,
        "object/tree/level": scene.tree.level,
        "object/tree/parent": scene.tree.parent,
        "hand/phalanx_radius": scene.hand.radius,
        "hand/phalanx_length": scene.hand.length,
        "hand/palm_center": palm_center,
        "hand/palm_radius": arrays.palm_radius,
    }
    series = TickSeries(total)
    carry = _Carry(np.full((1, 3), np.nan), np.full((1, 5, 3), np.nan))
    with ResultWriter(destination, scene=described, static=static, phases=ticks.phases) as writer:
        with interruptible_between() as check_interrupt:
            for first in range(0, total, CHUNK_TICKS):
                if progress is not None:
                    progress("ticks", first, total)
                part = slice(first, min(first + CHUNK_TICKS, total))
                record = solver.run(
                    ticks.position[part], ticks.orientation[part], ticks.flexion[part], ticks.abduction[part]
                )
                if not np.isfinite(record.joints).all():
                    raise HhsimError(
                        f"the graphic hand is not finite after tick {first}: please report this with the command"
                    )
                block, carry = _block(scene, part, record, tree, palm_center, arrays.palm_radius, fingers, carry)
                writer.append(block)
                series.keep(part, block)
                check_interrupt()
        if progress is not None:
            progress("ticks", total, total)
        summary = summarise(scene, options, series, prepared)
        path = writer.finish(summary.attributes())
    return summary.at(path)


def modelled(scene: Scene, options: SolverOptions) -> dict[str, Any]:
    """What the scene models: bodies, spheres and pairs that a model without trees would test every tick."""
    leaves = scene.tree.leaf_count
    palm = len(scene.hand.arrays().palm_radius)
    return {
        "fingers": list(options.fingers),
        "phalanges": int(options.modelled()[:PALM_BODY].sum()),
        "palm_spheres": palm,
        "object_spheres": leaves,
        "all_pairs": scene.all_pairs,
        "not_modelled": ["friction", "dynamics", "deformation", "finger-to-finger contact"],
    }


class _Carry(NamedTuple):
    """Forces of the last tick of the block before, for the variation rate of the first tick."""

    total: Array
    finger: Array


def _block(
    scene: Scene,
    part: slice,
    record: TickRecord,
    tree: TreeArrays,
    palm_center: Array,
    palm_radius: Array,
    fingers: Array,
    carry: _Carry,
) -> tuple[dict[str, Array], _Carry]:
    ticks = scene.ticks
    depth = penetration(
        tree,
        scene.hand.radius,
        palm_center,
        palm_radius,
        record.joints,
        record.position,
        record.orientation,
        fingers,
    )
    finger = record.phalanx.sum(axis=2)
    total_carried = np.concatenate([carry.total, record.total])
    finger_carried = np.concatenate([carry.finger, finger])
    block: dict[str, Array] = {
        "time": ticks.time[part],
        "input_seq": ticks.input_seq[part],
        "status": record.status.astype(np.int32),
        "lag": record.lag,
        "haptic/position": ticks.position[part],
        "haptic/orientation": ticks.orientation[part],
        "haptic/flexion": ticks.flexion[part],
        "haptic/abduction": ticks.abduction[part],
        "graphic/position": record.position,
        "graphic/orientation": record.orientation,
        "graphic/flexion": record.flexion,
        "graphic/abduction": record.abduction,
        "graphic/joints": record.joints,
        "penetration_depth": depth.depth,
        "penetration_palm": depth.palm,
        "penetration_finger": depth.finger,
        "force/phalanx": record.phalanx,
        "force/fingertip_normal": record.fingertip_normal,
        "force/palm_wrench": record.palm_wrench,
        "force/total": record.total,
        "force_variation_rate": force_variation_rate(total_carried)[1:],
        "force_variation_finger": force_variation_rate(finger_carried)[1:],
        "duration/detect": record.duration[:, DURATION_DETECT],
        "duration/palm": record.duration[:, DURATION_PALM],
        "duration/fingers": record.duration[:, DURATION_FINGERS],
        "duration/force": record.duration[:, DURATION_FORCE],
        "duration/total": record.duration_total,
        "duration/total_cpu": record.duration_cpu,
        "contacts/candidates": record.work[:, WORK_CANDIDATES],
        "contacts/touching": record.work[:, WORK_TOUCHING],
        "work/node_tests": record.work[:, COUNT_NODE_TESTS],
        "work/pair_tests": record.work[:, COUNT_PAIR_TESTS],
        "work/qp_iterations": record.work[:, WORK_QP_ITERATIONS],
        "work/linearisations": record.work[:, WORK_LINEARISATIONS],
        "work/rows": record.work[:, WORK_ROWS],
        "work/bodies": record.work[:, WORK_BODIES],
        "work/units": record.work[:, WORK_UNITS],
    }
    return block, _Carry(total_carried[-1:], finger_carried[-1:])

"""Main loop: run a hand through a motion, and write down everything.

The ticks run in compiled blocks; each is measured and written before the next one starts, outside of the timed ticks.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.errors import HhsimError, InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.metrics.run.registry import needed_columns
from hhsim.replay.moving_object import scene_frames
from hhsim.replay.stored_scene import describe_scene, static_arrays
from hhsim.replay.summary import GRAPHIC_HAND, ReplaySummary, summarise
from hhsim.replay.tick_columns import KeptColumns, TickColumns
from hhsim.result.reader import CHUNK_TICKS
from hhsim.result.schema import CONTACT, CONTACT_COLUMNS, FREE_COLUMNS, OBJECT_COLUMNS
from hhsim.result.writer import ResultWriter
from hhsim.scene.motion_catalogue import of_the_paper
from hhsim.scene.scene import Scene
from hhsim.solver.compile import warm_up
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.method import METHODS, Method
from hhsim.solver.options import SolverOptions
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import contact_surface

OF_FREE_OBJECT = (
    *(column.name for column in (*OBJECT_COLUMNS, *FREE_COLUMNS)),
    *(f"{CONTACT}/{column.name}" for column in CONTACT_COLUMNS),
)
"""Datasets of a free object that the table needs."""


def replay_scene(
    scene: Scene,
    options: SolverOptions,
    output_path: str | Path,
    *,
    description: Mapping[str, Any] | None = None,
    command: Sequence[str] = (),
    before_ticks: Callable[[], None] | None = None,
    progress: Progress | None = None,
) -> ReplaySummary:
    """Replay the scene's motion, write a result file, and return the figures of the table.

    Args:
        output_path: Result file; an existing one is replaced when the new one is complete.
        description: Further description of the scene as plain values, over the scene's own.
        command: Command line that makes the result, for the file to record; empty in a program.
        before_ticks: Called once before the first tick: the place to wait for disturbances to end.
        progress: Called with the current stage, how much is done and how much there is.

    Raises:
        InputError: Invalid options, or a method that lacks what it needs.
        OutputError: The file cannot be written.
        HhsimError: More pairs were near than the solver holds.
    """
    if not isinstance(options, SolverOptions):
        raise InputError(f"options: expected SolverOptions, found {options!r}")
    options, free, report = options.at_rate(scene.ticks.rate), scene.free, progress or silent
    prepared = warm_up(scene.hand, options, free)
    surface = contact_surface(options.surface, scene.mesh, scene.tree)
    solver = HandSolver(scene.hand, surface, options, free)
    ticks, total = scene.ticks, scene.ticks.tick_count
    motion = scene.trajectory
    static = static_arrays(scene.mesh, scene.tree, scene.hand, motion.object_position, motion.object_orientation)
    described = {
        **scene.description,
        **(description or {}),
        "rate": ticks.rate,
        "motion": motion.name,
        "motion_source": motion.source,
        **_of_outside_method(options.method, solver.method),
        **describe_scene(scene.mesh, scene.tree, scene.hand, options, static, free),
    }
    series, kept = KeptColumns((*needed_columns(), *GRAPHIC_HAND)), KeptColumns(OF_FREE_OBJECT if free else ())
    columns = TickColumns(surface.arrays, scene.hand, options)
    frame_of = scene_frames(scene, solver)
    moves: dict[str, Any] = {"driven": scene.driven is not None, "free": free is not None}
    with ResultWriter(
        Path(output_path), scene=described, static=static, phases=ticks.phases, command=command, **moves
    ) as writer:
        if before_ticks is not None:
            before_ticks()
        with interruptible_between() as check_interrupt:
            for first in range(0, total, CHUNK_TICKS):
                report("ticks", first, total)
                part = slice(first, min(first + CHUNK_TICKS, total))
                record = solver.run(*HandConfiguration.of(ticks).at(part))
                if not np.isfinite(record.joints).all():
                    raise HhsimError(f"the graphic hand is not finite after tick {first}: please report the command")
                frame = frame_of(part)
                block = columns.block(ticks.time[part], ticks.input_seq[part], frame.haptic, record)
                whole, contacts = frame.world(block), frame.contacts(first)
                writer.append(whole, {CONTACT: contacts})
                kept.keep(whole | {f"{CONTACT}/{name}": rows for name, rows in contacts.items()})
                series.keep(block)
                check_interrupt()
        report("ticks", total, total)
        summary = summarise(scene, surface, options, series, prepared, kept, of_paper=of_the_paper(described))
        path = writer.finish(summary.attributes())
    return replace(summary, path=path)


def _of_outside_method(name: str, method: Method) -> dict[str, Any]:
    if name in METHODS:
        return {}
    known = {"gives": sorted(method.gives), "promises": sorted(method.promises)}
    return {**known, "method_source": method.source} if method.source else known

"""`hhsim replay`."""

import math
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from click.shell_completion import CompletionItem

from . import options, rerun_option, tree_file, tree_level
from .console import announce_compilation, print_json, print_notes, print_table, progress
from .number_list import number_list
from .object_argument import complete_object, read_object
from .run_again import names_a_result, run_again

if TYPE_CHECKING:
    from hhsim.hand.model import HandModel
    from hhsim.motion.trajectory import Trajectory
    from hhsim.scene.demonstration import Demonstration
    from hhsim.scene.script import Script
    from hhsim.solver.options import SolverOptions, Stiffness
    from hhsim.view.background_viewer import ViewAhead
    from hhsim.view.sink import RerunTarget


def complete_trajectory(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the names of the catalogue, and files where what is typed looks like one."""
    from hhsim.scene.motion_catalogue import trajectory_names

    names = [CompletionItem(name) for name in trajectory_names() if name.startswith(incomplete)]
    return names or [CompletionItem(incomplete, type="file")]


@click.command()
@click.argument("object_", metavar="[OBJECT]", default="bunny", shell_complete=complete_object)
@click.argument("trajectory", metavar="[TRAJECTORY]", default="grasp", shell_complete=complete_trajectory)
@options.method
@click.option(
    "--qp",
    metavar="NAME",
    default="active-set",
    show_default=True,
    help="QP solver: active-set, our own, or any installed one that qpsolvers knows, such as clarabel.",
)
@click.option(
    "--force",
    type=click.Choice(["kkt", "paper"]),
    help="kkt: forces from the program's multipliers; paper: from the paper's Eq. 14. Default: kkt; paper with "
    "--method paper.",
)
@tree_level.level
@tree_level.max_error
@tree_file.tree
@options.fingers
@options.rate
@options.samples
@options.place_object("recorded")
@click.option(
    "--hand",
    type=click.Choice(["right", "left"]),
    help="Which hand grasps. Default: the recording's, else the right one.",
)
@click.option(
    "--hand-file",
    type=click.Path(path_type=Path),
    metavar="TOML",
    help="Sizes and joint limits of the hand that differ from the default one (hhsim/hand/model.py has an example).",
)
@click.option(
    "--stiffness",
    callback=number_list("k_t [N/m]", "k_r [N·m/rad]", "k_θ [N·m/rad]", positive=True),
    metavar="K_T,K_R,K_THETA",
    help="Virtual coupling of palm position [N/m], palm rotation and joints [N·m/rad]. Default: 1000,5,0.5.",
)
@click.option(
    "--penalty-stiffness",
    type=click.FloatRange(0.0, min_open=True),
    metavar="K",
    help="Stiffness of each contact with --method penalty [N/m]. Default: 100000.",
)
@options.margin
@options.linearisations
@options.budget
@click.option(
    "--tolerance",
    type=click.FloatRange(0.0, min_open=True),
    metavar="SHARE",
    help="Largest violation of a contact's row, as a share of the margin. Default: 1e-8.",
)
@click.option(
    "--frustum-ends",
    type=click.Choice(["spheres", "flat"]),
    help="With --method paper, a joint's sphere bounds the cone frustum as the fingertip's does (spheres, Eq. 13), or "
    "Eq. 7 holds there as printed (flat). Default: spheres.",
)
@click.option(
    "--threads",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    metavar="N",
    help="Threads that share each tick: finding contacts and, with progressive, the fingers' programs (coupled has "
    "only one program). The same result with any number; hhsim bench threads says when they pay.",
)
@click.option(
    "--tremor",
    callback=number_list("mm", "degrees"),
    metavar="MM,DEG",
    help="Add seeded tremor of 10 Hz: amplitude of the palm's position [mm] and rotation [°], such as 0.1,0.2.",
)
@options.unit
@options.size
@options.thickness
@options.seed
@rerun_option.rerun
@options.out
@options.json
@options.quiet
def command(
    object_: str,
    trajectory: str,
    method: str,
    qp: str,
    force: str | None,
    level: int | None,
    max_error: float | None,
    tree_path: Path | None,
    fingers: tuple[str, ...] | None,
    rate: float,
    samples: Literal["interpolate", "hold"],
    place_object: Literal["recorded", "auto"],
    hand: Literal["right", "left"] | None,
    hand_file: Path | None,
    stiffness: tuple[float, ...] | None,
    penalty_stiffness: float | None,
    margin: float | None,
    linearisations: int | None,
    budget: int | None,
    tolerance: float | None,
    frustum_ends: str | None,
    threads: int,
    tremor: tuple[float, ...] | None,
    unit: str | None,
    size: float | None,
    thickness: float | None,
    seed: int,
    rerun: "RerunTarget | None",
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Replay a hand motion against an object, every tick measured.

    OBJECT is a name (hhsim objects) or a mesh file; TRAJECTORY is a name (hhsim trajectories), a .toml script or a
    recording, .csv or .h5, or .npz, .json, .bvh as hhsim import reads them. Without them, five fingers grasp the
    bunny. The table shows the paper's figures beside those of this run; every tick is in the file. Ctrl-C stops the
    replay and keeps the ticks so far.

    OBJECT may also be a result or a recorded live session: its ticks are run again with the options that it holds, and
    every array is compared bit for bit; the exit code is 1 where one differs. As TRAJECTORY, such a file is the motion
    in it.

    \b
    Examples:
      hhsim replay
      hhsim replay cube pinch --method progressive --out pinch.h5
      hhsim replay mug.stl grasp --unit mm --tremor 0.1,0.2
      hhsim replay mug.stl grasp --unit mm --tree mug.h5
      hhsim replay cup glove.npz --place-object auto
      hhsim replay results/session.h5
      hhsim replay cube results/session.h5 --method progressive
      hhsim replay cube pinch --rerun spawn
    """
    if names_a_result(object_):
        return run_again(click.get_current_context(), Path(object_), as_json=as_json, quiet=quiet)
    from hhsim.motion.trajectory import Trajectory
    from hhsim.replay.replay import replay as run
    from hhsim.result.reader import check_result_path
    from hhsim.scene.recorded_grasp_pose import place_at_grasp
    from hhsim.scene.scene import make_scene, side_of
    from hhsim.system.output_path import dated_output_path

    changed = {
        "force": force,
        "frustum_ends": frustum_ends,
        "stiffness": _stiffness(stiffness, penalty_stiffness, method),
        "margin": None if margin is None else 1e-3 * margin,
        "linearisations": linearisations,
        "budget": budget,
        "tolerance": tolerance,
        "fingers": fingers,
        "threads": threads,
    }
    solver = _solver_options(method, qp, {name: value for name, value in changed.items() if value is not None})
    motion = _motion(trajectory, tremor, place_object)
    remarks = _mended(motion, trajectory)
    announce_compilation(quiet=quiet)
    mesh, usual_level = read_object(object_, unit, size, thickness)
    output_path = out or dated_output_path(f"{mesh.name}-{motion.name}")
    check_result_path(output_path)
    print_notes(mesh.warnings, prefix="warning")
    with ExitStack() as stack:
        # Before the thread of the progress bar: a process with threads is no good to fork.
        viewer = stack.enter_context(_view_ahead(rerun)) if rerun is not None else None
        report = stack.enter_context(progress(quiet=quiet))
        model = _hand(hand or side_of(motion), hand_file)
        unit_length = tree_file.length_unit(object_, unit, size) if tree_path else 1.0
        chosen = tree_level.choose_tree(mesh, level, usual_level, max_error, report, tree_path, unit_length)
        placement = None
        if place_object == "auto" and isinstance(motion, Trajectory):
            placement = place_at_grasp(motion, model, chosen.tree)
            motion = placement.motion
            remarks.append(placement.text)
        scene = make_scene(mesh, chosen.tree, model, motion, rate=rate, mode=samples, seed=seed)
        description = {
            "object": object_,
            "object_mesh": mesh.sha256,
            "unit": unit,
            "size_mm": size,
            "thickness_mm": thickness,
            "object_repairs": list(mesh.repairs),
            "level": chosen.level,
            "max_error": max_error,
            "tree": str(tree_path) if tree_path else None,
            "tree_options": dict(chosen.tree.options),
            "trajectory": trajectory,
            "samples": samples,
            "place_object": place_object,
            "placement": placement.to_json() if placement else None,
            "hand_file": str(hand_file) if hand_file else None,
            "tremor_mm_deg": tremor,
            "seed": seed,
        }
        settle = viewer.settle if viewer is not None else None
        summary = run(
            scene,
            solver,
            output_path,
            description=description,
            command=("hhsim", *sys.argv[1:]),
            before_ticks=settle,
            progress=report,
        )
        if viewer is not None:
            viewer.show(output_path, report)
    if as_json:
        document = summary.to_json()
        placed = {"placement": placement.to_json()} if placement else {}
        print_json({**document, **placed, "notes": [*remarks, *document["notes"]]})
    elif not quiet:
        title = f"{mesh.name}, {motion.name}, {method}: {summary.ticks:,} ticks"
        rows = [(row.label, row.shown, row.unit, row.paper) for row in summary.rows]
        print_table(("", "hhsim", "unit", "paper"), rows, title=title, numbers=("hhsim", "paper"))
        for note in (*remarks, *chosen.notes, *summary.notes):
            if note not in mesh.warnings:
                print(f"note: {note}")
        print(f"every tick is in {summary.path}")
    return 0


def _view_ahead(target: "RerunTarget") -> "ViewAhead":
    # Imported only where it is wanted: it is slow to import.
    from hhsim.view.background_viewer import ViewAhead

    return ViewAhead(target)


def _solver_options(
    method: str,
    qp: str,
    changed: "dict[str, Any]",
) -> "SolverOptions":
    from hhsim.errors import UnknownNameError
    from hhsim.solver.options import SolverOptions
    from hhsim.solver.qp import ACTIVE_SET, available_backends

    if qp != ACTIVE_SET and qp not in available_backends():
        raise UnknownNameError("QP solver", qp, available_backends())
    return SolverOptions(method=method, qp=qp, **changed)


def _stiffness(numbers: tuple[float, ...] | None, penalty: float | None, method: str) -> "Stiffness | None":
    from hhsim.solver.options import Stiffness

    if penalty is not None and method != "penalty":
        raise click.UsageError(f"--penalty-stiffness is for --method penalty, not {method}")
    changed = {} if penalty is None else {"penalty": penalty}
    if numbers is not None:
        changed |= dict(zip(("translation", "rotation", "flexion"), numbers))
    return Stiffness(**changed) if changed else None


def _motion(
    trajectory: str, tremor: tuple[float, ...] | None, place_object: str
) -> "Script | Demonstration | Trajectory":
    from hhsim.motion.trajectory import Trajectory
    from hhsim.scene.motion_catalogue import resolve_trajectory
    from hhsim.scene.script import Script

    motion = resolve_trajectory(trajectory)
    if place_object == "auto" and not isinstance(motion, Trajectory):
        raise click.UsageError(f"--place-object is for recordings; '{trajectory}' finds its place at the object itself")
    if tremor is None:
        return motion
    if not isinstance(motion, Script):
        raise click.UsageError(f"--tremor is for scripts; '{trajectory}' is a recording, with what tremor the hand had")
    position, rotation = tremor
    shaken = replace(motion.disturbance, tremor_position=1e-3 * position, tremor_rotation=math.radians(rotation))
    return replace(motion, disturbance=shaken)


def _mended(motion: "Script | Demonstration | Trajectory", trajectory: str) -> list[str]:
    """A remark on a recording that was imported on the way in, and what that changed."""
    import numpy as np

    from hhsim.motion.sample_flags import MENDED, marked
    from hhsim.motion.trajectory import Trajectory
    from hhsim.scene.motion_catalogue import RECORDING_SUFFIXES

    if not isinstance(motion, Trajectory) or motion.flags is None:
        return []
    if Path(trajectory).suffix.lower() in RECORDING_SUFFIXES:
        return []
    mended = int(np.sum(marked(motion.flags, MENDED)))
    return [f"{mended:,} of {motion.sample_count:,} samples were mended on the way in: hhsim import tells what"]


def _hand(side: Literal["right", "left"], file: Path | None) -> "HandModel":
    from hhsim.hand.model import HandModel

    return HandModel.default(side) if file is None else HandModel.from_toml(file, side)

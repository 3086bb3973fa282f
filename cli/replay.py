"""`hhsim replay`."""

import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from click.shell_completion import CompletionItem

from hhsim.ranges import RANGES
from hhsim.system.counted import counted
from hhsim.table.table import Table, number, words

from .arguments import options, rerun_option
from .arguments.comma_list import number_list
from .arguments.free_object import FreeChoice
from .arguments.method_name import isolate
from .arguments.object_argument import MeshFile, complete_object
from .arguments.option_group import GroupedCommand, option, shared
from .arguments.options import COUNT, Side, within
from .arguments.tree_choice import TreeOrFile
from .console import announce_compilation, print_json, print_line, print_notes, print_table, progress
from .run_again import names_a_result, run_again

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hhsim.hand.model import HandModel
    from hhsim.motion.trajectory import Trajectory
    from hhsim.replay.summary import ReplaySummary
    from hhsim.scene.demonstration import Demonstration
    from hhsim.scene.described_scene import SceneWords
    from hhsim.scene.script import Script
    from hhsim.solver.options import SolverOptions, Stiffness
    from hhsim.view.sink import RerunTarget


STIFFNESSES = ("translation", "rotation", "flexion")
"""Parts of --stiffness in their order, as the library names them."""


def complete_trajectory(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the names of the catalogue, and files where what is typed looks like one."""
    from hhsim.scene.motion_catalogue import trajectory_names

    names = [CompletionItem(name) for name in trajectory_names() if name.startswith(incomplete)]
    return names or [CompletionItem(incomplete, type="file")]


class SolverSettings(options.Linearising, options.SolverChoice):
    """How the hand is solved for, with all that steers it; `stiffness` is k_t [N/m], k_r and k_θ [N·m/rad]."""

    isolate: bool = shared(isolate)
    qp: str = option(
        metavar="NAME",
        default="active-set",
        help="QP solver: active-set, our own, or any installed one that qpsolvers knows, such as clarabel.",
    )
    force: str | None = option(
        type=click.Choice(["kkt", "paper"]),
        help="kkt: forces from the program's multipliers; paper: from the paper's Eq. 14. Default: kkt; paper with "
        "--method paper.",
    )
    stiffness: tuple[float, ...] | None = option(
        callback=number_list(
            "k_t [N/m]",
            "k_r [N·m/rad]",
            "k_θ [N·m/rad]",
            ranges=[RANGES[f"stiffness {name}"][:2] for name in STIFFNESSES],
        ),
        metavar="K_T,K_R,K_THETA",
        help="Virtual coupling of palm position [N/m], palm rotation and joints [N·m/rad]. Default: 1000,5,0.5.",
    )
    penalty_stiffness: float | None = option(
        type=within("stiffness penalty"),
        metavar="K",
        help="Stiffness of each contact with --method penalty [N/m]. Default: 100000.",
    )
    tolerance: float | None = option(
        type=within("tolerance"),
        metavar="SHARE",
        help="Largest violation of a contact's row, as a share of the margin. Default: 1e-8.",
    )
    frustum_ends: str | None = option(
        type=click.Choice(["spheres", "flat"]),
        help="With --method paper, a joint's sphere bounds the cone frustum as the fingertip's does (spheres, "
        "Eq. 13), or Eq. 7 holds there as printed (flat). Default: spheres.",
    )
    threads: int = option(
        type=within("threads"),
        default=1,
        metavar="N",
        help="Threads that share each tick: finding contacts and, with progressive, the fingers' programs (coupled "
        "has only one program). The same result with any number; hhsim bench threads says when they pay.",
    )

    def options(self) -> "SolverOptions":
        """The same for the library.

        Raises:
            UsageError: An option of another method.
            HhsimError: No such QP solver, a method whose engine is not installed, or a number out of range.
        """
        from hhsim.errors import InputError, UnknownNameError
        from hhsim.solver.known_methods import find_method
        from hhsim.solver.method_names import isolated_name
        from hhsim.solver.options import SolverOptions
        from hhsim.solver.qp import ACTIVE_SET, available_backends

        changed = {**self.given(), "margin": options.metres(self.margin), "stiffness": self._stiffness()}
        changed.pop("penalty_stiffness", None)
        if changed.pop("isolate"):
            changed["method"] = isolated_name(self.method)
        if self.qp != ACTIVE_SET and self.qp not in available_backends():
            raise UnknownNameError("QP solver", self.qp, available_backends())
        if missing := find_method(changed["method"]).missing:
            raise InputError(f"method {self.method} {missing}")
        return SolverOptions(**{name: value for name, value in changed.items() if value is not None})

    def _stiffness(self) -> "Stiffness | None":
        from hhsim.solver.options import Stiffness

        if self.penalty_stiffness is not None and self.method != "penalty":
            raise click.UsageError(f"--penalty-stiffness is for --method penalty, not {self.method}")
        changed = {} if self.penalty_stiffness is None else {"penalty": self.penalty_stiffness}
        if self.stiffness is not None:
            changed |= dict(zip(STIFFNESSES, self.stiffness))
        return Stiffness(**changed) if changed else None


class HandAndMotion(options.Sampling, heading="Hand and motion"):
    """The hand, and how it moves; `tremor` is an amplitude of the palm's position [mm] and one of its rotation [°]."""

    place_object: Literal["recorded", "auto"] | None = options.place_object(None)
    object_pose: Literal["recorded", "fixed"] = option(
        type=click.Choice(["recorded", "fixed"]),
        default="recorded",
        help="Of a recording whose object moves: recorded: it moves as it did; fixed: it stays where it was at first.",
    )
    side: Side | None = option(
        "--hand", type=options.SIDES, help="Which hand grasps. Default: the recording's, else the right one."
    )
    hand_file: Path | None = shared(options.hand_file)
    tremor: tuple[float, ...] | None = option(
        callback=number_list("mm", "degrees", ranges=[(0.0, 100.0), (0.0, 180.0)]),
        metavar="MM,DEG",
        help="Add seeded tremor of 10 Hz: amplitude of the palm's position [mm] and rotation [°], such as 0.1,0.2.",
    )
    ticks: int | None = option(type=COUNT, metavar="N", help="Run the first N ticks alone. Default: the whole motion.")

    def motion(self, trajectory: str) -> "Script | Demonstration | Trajectory":
        """What TRAJECTORY names, with its tremor.

        Raises:
            UsageError: A script is placed as a recording is, a recording gets tremor, or an object that moves as
                recorded is to be put elsewhere.
            HhsimError: No such motion, or a file that cannot be read.
        """
        from hhsim.motion.trajectory import Trajectory
        from hhsim.scene.motion_catalogue import resolve_trajectory
        from hhsim.scene.script import Script

        motion = resolve_trajectory(trajectory)
        if self.place_object == "auto" and not isinstance(motion, Trajectory):
            raise click.UsageError(
                f"--place-object is for recordings; '{trajectory}' finds its place at the object itself"
            )
        if isinstance(motion, Trajectory) and motion.object_motion is not None:
            if self.object_pose == "fixed":
                motion = motion.placed(motion.object_position, motion.object_orientation)
            elif self.place_object == "auto":
                raise click.UsageError(
                    f"'{trajectory}' holds where its object was at every moment: --place-object auto needs "
                    "--object-pose fixed"
                )
        elif self.object_pose == "fixed" and isinstance(motion, Script):
            raise click.UsageError(f"--object-pose is for recordings; in '{trajectory}' the object moves by the script")
        if self.tremor is None:
            return motion
        if not isinstance(motion, Script):
            raise click.UsageError(
                f"--tremor is for scripts; '{trajectory}' is a recording, with what tremor the hand had"
            )
        return motion.shaken(self.tremor)

    def hand(self, motion: "Script | Demonstration | Trajectory") -> "HandModel":
        """The hand that makes a motion."""
        from hhsim.hand.model import HandModel
        from hhsim.scene.scene import side_of

        side = self.side or side_of(motion)
        return HandModel.default(side) if self.hand_file is None else HandModel.from_toml(self.hand_file, side)

    def words(self, object_: str, trajectory: str, mesh_file: MeshFile, tree: TreeOrFile, seed: int) -> "SceneWords":
        """What was asked for, for the result to say."""
        from hhsim.scene.described_scene import SceneWords

        return SceneWords(
            object=object_,
            trajectory=trajectory,
            unit=mesh_file.unit,
            size_mm=mesh_file.size,
            thickness_mm=mesh_file.thickness,
            max_error=tree.max_error,
            tree=str(tree.path) if tree.path else None,
            hand_file=str(self.hand_file) if self.hand_file else None,
            tremor_mm_deg=self.tremor,
            samples=self.samples,
            place_object=self.place_object,
            object_pose=self.object_pose,
            rate=self.rate,
            ticks=self.ticks,
            seed=seed,
        )


class ReplayOutput(options.Output):
    """Where the result goes, and how much of it is printed."""

    whole: bool = option(
        "--all", is_flag=True, help="Print every figure; without it those that matter, and what is over its limit."
    )
    repeat: int = option(
        type=COUNT,
        default=1,
        metavar="N",
        help="Run the ticks N times and print mean and standard deviation of the times, which alone differ; the file "
        "is of the last run and says both, for hhsim compare and hhsim report to go by.",
    )


@click.command(cls=GroupedCommand)
@click.argument("object_", metavar="[OBJECT]", default="bunny", shell_complete=complete_object)
@click.argument("trajectory", metavar="[TRAJECTORY]", default="grasp", shell_complete=complete_trajectory)
@SolverSettings.argument("solver")
@TreeOrFile.argument("tree")
@HandAndMotion.argument("moving")
@FreeChoice.argument("free")
@MeshFile.argument("mesh_file")
@ReplayOutput.argument("output")
@options.seed
@rerun_option.rerun
def command(
    object_: str,
    trajectory: str,
    solver: SolverSettings,
    tree: TreeOrFile,
    moving: HandAndMotion,
    free: FreeChoice,
    mesh_file: MeshFile,
    output: ReplayOutput,
    seed: int,
    rerun: "RerunTarget | None",
) -> int:
    """Replay a hand motion against an object, every tick measured.

    OBJECT is a name (hhsim objects) or a mesh file; TRAJECTORY is a name (hhsim trajectories), a .toml script or a
    recording, .h5 or .csv, or any file that hhsim import reads without options. Without them, five fingers grasp the
    bunny. Above the table stands the verdict, beside the figures their limits and, in scenes of the paper, the paper's
    figures; every tick is in the file. A recording whose hand touches nothing, or begins inside the object, gets its
    object placed. The exit code is 1 where more than half of the ticks are stuck, and else 0 whatever the verdict:
    hhsim gate fails on it. Ctrl-C stops the replay and keeps the ticks so far.

    OBJECT may also be a result or a recorded live session: its ticks are run again with the options that it holds, and
    every array is identical bit for bit, within rounding (another processor's last bits, by bounds that are printed) or
    different; the exit code is 1 where one is different. As TRAJECTORY, such a file is the motion in it.

    \b
    Examples:
      hhsim replay
      hhsim replay bunny grasp --all
      hhsim replay cube pinch --method progressive --out pinch.h5
      hhsim replay mug.stl grasp --unit mm --tremor 0.1,0.2
      hhsim replay mug.stl grasp --unit mm --tree mug.h5
      hhsim replay cup glove.npz --place-object auto
      hhsim replay results/session.h5
      hhsim replay cube results/session.h5 --method progressive
      hhsim replay cube grasp --free --mass 0.1 --friction 0.6
      hhsim replay cube pinch --rerun spawn
    """
    if names_a_result(object_):
        return run_again(click.get_current_context(), Path(object_), as_json=output.as_json, quiet=output.quiet)
    from hhsim.replay.replay import replay_scene as run
    from hhsim.result.reader import check_result_path
    from hhsim.scene.described_scene import described_scene
    from hhsim.scene.motion_catalogue import import_remarks

    solver_options = solver.options()
    motion = moving.motion(trajectory)
    free.require(solver_options, motion, way_out=": --object-pose fixed keeps it where it is at first")
    remarks = import_remarks(motion, trajectory)
    announce_compilation(quiet=output.quiet)
    solid = solver.surface != "mesh"
    mesh, usual_level = mesh_file.read(object_, solid=solid)
    # A mesh that can have no mass is refused before a tree is built of it.
    free.object(mesh, object_)
    output_path = output.path(f"{mesh.name}-{motion.name}-{solver.word}")
    check_result_path(output_path)
    print_notes(mesh.warnings, prefix="warning")
    with ExitStack() as stack:
        viewer = None
        if rerun is not None:
            # Imported only where it is wanted: it is slow to import.
            from hhsim.view.background_viewer import ViewAhead

            # Before the thread of the progress bar: a process with threads is no good to fork.
            viewer = stack.enter_context(ViewAhead(rerun))
        report = stack.enter_context(progress(quiet=output.quiet))
        hand = moving.hand(motion)
        if tree.path is None:
            chosen = tree.choose(mesh, usual_level, report, solid=solid)
        else:
            chosen = tree.load(mesh, mesh_file.unit_length(object_))
        words = moving.words(object_, trajectory, mesh_file, tree, seed)
        placed = described_scene(words, mesh, chosen.tree, chosen.level, hand, motion, solver_options.fingers)
        remarks += filter(None, [placed.note])
        scene = replace(placed.scene, free=free.object(placed.scene.mesh, object_))
        runs = [
            run(
                scene,
                solver_options,
                output_path,
                command=("hhsim", *sys.argv[1:]),
                before_ticks=viewer.settle if viewer is not None else None,
                progress=report,
            )
            for _ in range(output.repeat)
        ]
        summary = runs[-1]
        repeated = _state_repeats(runs) if output.repeat > 1 else {}
        if viewer is not None:
            viewer.show(output_path, report)
    if output.as_json:
        document = summary.to_json()
        placement = {"placement": placed.to_json()} if placed.placement else {}
        print_json({**document, **placement, **repeated, "notes": [*remarks, *document["notes"]]})
    elif not output.quiet:
        _print(summary, whole=output.whole)
        if output.repeat > 1:
            _print_times(runs)
        for note in (*remarks, *chosen.notes, *summary.notes):
            if note not in mesh.warnings:
                print_line(f"note: {note}")
        print_line(f"every tick is in {summary.path}")
    elif summary.verdict.mostly_stuck:
        print_notes([summary.verdict.line], prefix="missed")
    return int(summary.verdict.mostly_stuck)


def _print(summary: "ReplaySummary", *, whole: bool) -> None:
    """Print the verdict and the table; the column of the paper only where the scene is the paper's."""
    from hhsim.replay.summary_table import figure_table, short_table, whole_table

    found = summary.verdict
    touched = "" if summary.surface == "spheres" else f", {summary.surface}"
    print_line(
        f"{summary.object_name}, {summary.motion_name}, {summary.method}{touched}: {counted(summary.ticks, 'tick')}"
    )
    print_line(found.line)
    print()
    rows = whole_table(summary.rows) if whole else short_table(summary.rows, found.missed)
    print_table(figure_table(rows, promises=summary.promises), optional=("paper",))
    if not whole:
        print_line(f"{len(rows)} of {len(whole_table(summary.rows))} figures: --all prints all")


def _state_repeats(runs: "Sequence[ReplaySummary]") -> dict[str, Any]:
    """Put the times over several runs in the file of the last one; what the JSON document says of them."""
    from hhsim.replay.repeated_times import repeated_document
    from hhsim.result.writer import state_repeats

    repeated = repeated_document(runs)
    path = runs[-1].path
    assert path is not None
    state_repeats(path, repeated)
    return {"repeated": repeated}


def _print_times(runs: "Sequence[ReplaySummary]") -> None:
    """Print times over several runs: mean ± standard deviation."""
    from hhsim.replay.repeated_times import repeated_times

    print()
    columns = (
        words("", lambda time: time.row.label),
        number("mean ± σ", "shown"),
        words("unit", lambda time: time.row.unit),
    )
    print_table(Table(columns, repeated_times(runs), f"times of {len(runs)} runs"))

"""`hhsim replay`."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from click.shell_completion import CompletionItem

from hhsim.ranges import RANGES
from hhsim.system.counted import counted
from hhsim.table.table import Table, number, words

from .arguments import options, recording_options
from .arguments.comma_list import number_list
from .arguments.free_object import FreeChoice
from .arguments.object_argument import MeshFile, TreeOrFile, complete_object
from .arguments.option_group import GroupedCommand, option, shared
from .arguments.options import COUNT, ranged
from .arguments.recording_options import HandData, Sampling
from .arguments.solver_options import Linearising, SolverChoice, trust
from .arguments.written import RERUN, RERUN_METAVAR, read_target
from .console import print_json, print_line, print_notes, print_table, progress
from .run_again import names_a_result, run_again

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hhsim.replay.summary import ReplaySummary
    from hhsim.scene.described_scene import SceneWords
    from hhsim.solver.options import SolverOptions
    from hhsim.view.sink import RerunTarget


HANDS = options.HANDS
STIFFNESSES = {"translation": "k_t [N/m]", "rotation": "k_r [N·m/rad]", "flexion": "k_θ [N·m/rad]"}
"""Parts of --stiffness in their order, by the library's names."""


def complete_trajectory(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete names of the catalogue, and files where what is typed looks like one."""
    from hhsim.scene.motion_catalogue import trajectory_names

    names = [CompletionItem(name) for name in trajectory_names() if name.startswith(incomplete)]
    return names or [CompletionItem(incomplete, type="file")]


class SolverSettings(Linearising, SolverChoice):
    """Options of the solver; `stiffness` is k_t [N/m], k_r and k_θ [N·m/rad]."""

    qp: str = option(
        metavar="NAME",
        default="active-set",
        help="QP solver: active-set (hhsim's own); for coupled also one that qpsolvers finds, such as clarabel.",
    )
    force: str | None = option(
        type=click.Choice(["kkt", "paper"]),
        help="Forces from the multipliers (kkt) or from Eq. 14 (paper). Default: kkt; paper with --method paper.",
    )
    stiffness: tuple[float, ...] | None = option(
        callback=number_list(*STIFFNESSES.values(), ranges=[RANGES[f"stiffness {name}"][:2] for name in STIFFNESSES]),
        metavar="K_T,K_R,K_THETA",
        help="Virtual coupling of palm position [N/m], palm rotation and joints [N·m/rad]. Default: 1000,5,0.5.",
    )
    penalty_stiffness: float | None = ranged(
        "stiffness penalty", "K", "Stiffness of each contact with --method penalty [N/m]. Default: 100000."
    )
    tolerance: float | None = ranged(
        "tolerance", "SHARE", "Largest violation of a contact's row, as a share of the margin. Default: 1e-8."
    )
    self_contact: Literal["on", "off"] = option(
        type=click.Choice(["on", "off"]),
        default="off",
        help="Keep the fingers and the palm out of each other (on), or let them through (off); with --method coupled.",
    )
    frustum_ends: str | None = option(
        type=click.Choice(["spheres", "flat"]),
        help="Ends of a frustum with --method paper: spheres (Eq. 13) or flat (Eq. 7). Default: spheres.",
    )
    threads: int = ranged(
        "threads",
        "N",
        "Threads that solve the fingers with --method progressive; the result is the same with any number.",
        default=1,
    )

    def options(self) -> "SolverOptions":
        """Return the options; UsageError, HhsimError for another method's, no such solver or engine, a bad number."""
        from hhsim.errors import InputError, UnknownNameError
        from hhsim.solver.known_methods import find_method
        from hhsim.solver.options import SolverOptions, Stiffness
        from hhsim.solver.qp import ACTIVE_SET, available_backends

        stiffness = dict(zip(STIFFNESSES, self.stiffness or ()))
        if self.penalty_stiffness is not None:
            if self.method != "penalty":
                raise click.UsageError(f"--penalty-stiffness is for --method penalty, not {self.method}")
            stiffness["penalty"] = self.penalty_stiffness
        changed = {**self.given(), "margin": options.metres(self.margin), "self_contact": self.self_contact == "on"}
        changed |= {"stiffness": Stiffness(**stiffness) if stiffness else None}
        changed.pop("penalty_stiffness", None)
        if self.qp != ACTIVE_SET and self.qp not in available_backends():
            raise UnknownNameError("QP solver", self.qp, available_backends())
        if missing := find_method(self.method).missing:
            raise InputError(f"method {self.method} {missing}")
        return SolverOptions(**{name: value for name, value in changed.items() if value is not None})


class HandAndMotion(Sampling, heading="Hand and motion"):
    """Hand and its motion; `tremor` is an amplitude of the palm's position [mm] and of its rotation [°]."""

    place_object: Literal["recorded", "auto"] | None = recording_options.place_object(None)
    object_pose: Literal["recorded", "fixed"] = option(
        type=click.Choice(["recorded", "fixed"]),
        default="recorded",
        help="An object that a recording moves: it moves as recorded, or stays fixed where it was at first.",
    )
    side: Literal["right", "left", "both"] | None = option(
        *("--hand", "--hands"),
        type=click.Choice(["right", "left", "both"]),
        help="Which hand grasps, or both. Default: the recording's, else the right one.",
    )
    hand_file: Path | None = shared(options.hand_file)
    tremor: tuple[float, float] | None = option(
        callback=number_list("mm", "degrees", ranges=[(0.0, 100.0), (0.0, 180.0)]),
        metavar="MM,DEG",
        help="Add seeded tremor of 10 Hz of this amplitude: palm position [mm] and rotation [°], such as 0.1,0.2.",
    )
    seed: int = shared(options.seed)
    ticks: int | None = option(type=COUNT, metavar="N", help="Run only the first N ticks. Default: the whole motion.")

    def words(
        self, object_: str, trajectory: str, mesh_file: MeshFile, tree: TreeOrFile, data: HandData, free: FreeChoice
    ) -> "SceneWords":
        """Return what the command line says of the scene."""
        from hhsim.scene.described_scene import SceneWords

        own = ("samples", "place_object", "object_pose", "rate", "ticks", "seed")
        reading = {name: str(of) if isinstance(of, Path) else of for name, of in data.given().items()}
        return SceneWords(
            object=object_,
            trajectory=trajectory,
            tree=str(tree.path) if tree.path else None,
            hand=self.side,
            hand_file=str(self.hand_file) if self.hand_file else None,
            tremor_mm_deg=self.tremor,
            free=free.words(),
            **mesh_file.words(tree),
            **{name: getattr(self, name) for name in own},
            reading=reading or None,
        )


class ReplayOutput(options.Output):
    """Path of the result, and amount of output."""

    whole: bool = option(
        "--all", is_flag=True, help="Print every figure; without it those that matter, and what is over its limit."
    )
    repeat: int = option(
        type=COUNT,
        default=1,
        metavar="N",
        help="Run the ticks N times, and print and store mean and standard deviation of their times.",
    )
    trust: bool = shared(trust)


@click.command(cls=GroupedCommand)
@click.argument("object_", metavar="[OBJECT]", default="bunny", shell_complete=complete_object)
@click.argument("trajectory", metavar="[TRAJECTORY]", default="grasp", shell_complete=complete_trajectory)
@SolverSettings.argument("solver")
@TreeOrFile.argument("tree")
@HandAndMotion.argument("moving")
@HandData.argument("data")
@FreeChoice.argument("free")
@MeshFile.argument("mesh_file")
@ReplayOutput.argument("output")
@click.option(
    "--rerun",
    callback=read_target,
    type=RERUN,
    metavar=RERUN_METAVAR,
    help="Show the replay in rerun: open a viewer, write a file, or send to an open viewer at HOST:PORT.",
)
def command(
    object_: str,
    trajectory: str,
    solver: SolverSettings,
    tree: TreeOrFile,
    moving: HandAndMotion,
    data: HandData,
    free: FreeChoice,
    mesh_file: MeshFile,
    output: ReplayOutput,
    rerun: "RerunTarget | None",
) -> int:
    """Replay a hand motion against an object, every tick measured.

    OBJECT is a name (hhsim objects), a mesh, URDF or MJCF file, or the TOML of several bodies; TRAJECTORY is a name
    (hhsim trajectories), a .toml script or a recording of one of the formats of hhsim import. Above the table
    stands the verdict, beside the figures their limits and, in scenes of the paper, the paper's figures; every tick
    is in the file. A recording whose hand touches nothing, or begins inside the object, gets its object placed. The
    exit code is 1 where more than half of the ticks are stuck; hhsim gate fails on any missed limit. Ctrl-C stops
    the replay and keeps the ticks so far.

    OBJECT may also be a result or a recorded session: its ticks run again with their options, and each array is
    identical, within rounding or different; the exit code is 1 where one is different. As TRAJECTORY, such a file is
    the motion in it.

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
      hhsim replay laptop close --surface mesh
      hhsim replay drawer.urdf grasp --free
      hhsim replay cube pinch --rerun spawn
    """
    if names_a_result(object_):
        how = {"as_json": output.as_json, "quiet": output.quiet, "trust": output.trust}
        return run_again(click.get_current_context(), Path(object_), **how)
    from hhsim.replay.replay import replay_scene, replay_two_hands
    from hhsim.replay.summary import repeated_document, repeated_times
    from hhsim.result.reader import check_result_path
    from hhsim.result.writer import add_document
    from hhsim.scene.described_scene import load_words
    from hhsim.scene.motion_catalogue import import_remarks
    from hhsim.solver.free_object import require_free

    if moving.side == "both" and output.repeat > 1:
        raise click.UsageError("--repeat is of one hand")
    solver_options = solver.options()
    loaded = load_words(moving.words(object_, trajectory, mesh_file, tree, data, free), surface=solver.surface)
    motion, bodies = loaded.motions[0], loaded.bodies
    free.require(solver_options, motion, way_out=": --object-pose fixed keeps it where it is at first")
    remarks = import_remarks(motion, trajectory)
    if any(body.is_free for body in bodies.settings):
        require_free(solver_options)
    output_path = output.path(f"{bodies.name}-{motion.name}-{solver.word}")
    check_result_path(output_path)
    print_notes(bodies.mesh.warnings, prefix="warning")
    with progress(quiet=output.quiet) as report:
        placed = loaded.placed(solver_options.fingers, report)
        scene, notes = placed.scene, placed.notes
        remarks += filter(None, [placed.note])
        about: dict[str, Any] = {"command": ("hhsim", *sys.argv[1:]), "progress": report}
        runs: list[ReplaySummary] = []
        hands: dict[str, ReplaySummary] = {}
        if len(scene.hands) > 1:
            both = replay_two_hands(scene, solver_options, output_path, **about)
            hands.update(zip(HANDS, both.hands))
            document = both.to_json()
            remarks.append(both.note)
        else:
            runs = [replay_scene(scene, solver_options, output_path, **about) for _ in range(output.repeat)]
            hands[scene.hands[0].model.side], document = runs[-1], runs[-1].to_json()
            document |= {"placement": placed.to_json()} if placed.placement else {}
        if output.repeat > 1:
            document["repeated"] = repeated_document(runs)
            add_document(output_path, "repeated", document["repeated"])
        if rerun is not None:
            from hhsim.view.viewer import view_file

            view_file(output_path, rerun, progress=report)
    stuck = [summary.verdict.line for summary in hands.values() if summary.verdict.mostly_stuck]
    if output.as_json:
        print_json({**document, "notes": [*remarks, *document.get("notes", ())]})
    elif not output.quiet:
        _print(hands, whole=output.whole)
        if output.repeat > 1:
            print()
            columns = words("", "row.label"), number("mean ± σ", "shown"), words("unit", "row.unit")
            print_table(Table(columns, repeated_times(runs), f"times of {len(runs)} runs"))
        of_hands = [note for summary in hands.values() for note in summary.notes]
        for note in dict.fromkeys((*remarks, *notes, *of_hands)):
            if note not in bodies.mesh.warnings:
                print_line(f"note: {note}")
        print_line(f"every tick is in {output_path}")
    else:
        print_notes(stuck, prefix="missed")
    return int(bool(stuck))


def _print(hands: "Mapping[str, ReplaySummary]", *, whole: bool) -> None:
    """Print the verdict on each hand and the table of all."""
    from hhsim.replay.summary_table import figure_table, hands_table, short_table, whole_table

    summary, several = next(iter(hands.values())), len(hands) > 1
    touched = "" if summary.surface == "spheres" else f", {summary.surface}"
    print_line(
        f"{summary.object_name}, {summary.motion_name}, {summary.method}{touched}: {counted(summary.ticks, 'tick')}"
    )
    for name, of in hands.items():
        print_line(f"{name} hand: {of.verdict.line}" if several else of.verdict.line)
    print()
    missed = [figure for of in hands.values() for figure in of.verdict.missed]
    tables = {name: whole_table(of.rows) if whole else short_table(of.rows, missed) for name, of in hands.items()}
    rows = next(iter(tables.values()))
    if several:
        print_table(hands_table(tables, summary.promises))
    else:
        print_table(figure_table(rows, promises=summary.promises), optional=("paper",))
    if not whole:
        print_line("the main figures: --all prints all")

"""`hhsim replay`: a motion against an object, or the ticks of a result once more."""

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import click

from hhsim.ranges import RANGES
from hhsim.system.counted import counted
from hhsim.table.table import Table, number, words

from .arguments import object_options, options, scene_options
from .arguments.command import make_command, option, refuse_typed
from .arguments.recording_options import HandData, Place
from .console import print_notes, progress

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from hhsim.replay.summary import ReplaySummary
    from hhsim.solver.options import SolverOptions

STIFFNESSES = {"translation": "k_t [N/m]", "rotation": "k_r [N·m/rad]", "flexion": "k_θ [N·m/rad]"}
"""Parts of --stiffness in their order, by the library's names."""
READ_STIFFNESS = options.number_list(
    *STIFFNESSES.values(), ranges=[RANGES[f"stiffness {name}"][:2] for name in STIFFNESSES]
)
READ_TREMOR = options.number_list("mm", "degrees", ranges=[(0.0, 100.0), (0.0, 180.0)])


class SolverSettings(scene_options.Linearising, scene_options.SolverChoice):
    """Options of the solver; `stiffness` is k_t [N/m], k_r and k_θ [N·m/rad]."""

    qp: str = option(
        "QP solver: active-set (hhsim's own); for coupled also one that qpsolvers finds, such as clarabel.",
        "NAME",
        default="active-set",
    )
    force: Literal["kkt", "paper"] | None = option(
        "Forces from the multipliers (kkt) or from Eq. 14 (paper). Default: kkt; paper with --method paper."
    )
    stiffness: Annotated[tuple[float, ...], READ_STIFFNESS] | None = option(
        "Virtual coupling of palm position [N/m], palm rotation and joints [N·m/rad]. Default: 1000,5,0.5.",
        "K_T,K_R,K_THETA",
    )
    penalty_stiffness: Annotated[float, options.ranged("stiffness penalty")] | None = option(
        "Stiffness of each contact with --method penalty [N/m]. Default: 100000.", "K"
    )
    tolerance: Annotated[float, options.ranged("tolerance")] | None = option(
        "Largest violation of a contact's row, as a share of the margin. Default: 1e-8.", "SHARE"
    )
    self_contact: Literal["on", "off"] = option(
        "Keep the fingers and the palm out of each other (on), or let them through (off); with --method coupled.",
        default="off",
    )
    frustum_ends: Literal["spheres", "flat"] | None = option(
        "Ends of a frustum with --method paper: spheres (Eq. 13) or flat (Eq. 7). Default: spheres."
    )
    threads: Annotated[int, options.ranged("threads")] = option(
        "Threads that solve the fingers with --method progressive; the result is the same with any number.",
        "N",
        default=1,
    )

    def options(self) -> "SolverOptions":
        """Return the options; UsageError, HhsimError for another method's, no such solver or engine, a bad number."""
        from hhsim.errors import InputError, UnknownNameError
        from hhsim.solver.method import find_method
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


class HandAndMotion(scene_options.Sampling, heading="Hand and motion"):
    """Hand and its motion, by the names of `hhsim.scene.described_scene.SceneWords`."""

    place_object: Place | None = option(
        "Object of a recording: where it was recorded (recorded), or where the closing fingers meet it (auto)."
    )
    object_pose: Literal["recorded", "fixed"] = option(
        "An object that a recording moves: it moves as recorded, or stays fixed where it was at first.",
        default="recorded",
    )
    hand: options.Sides | None = options.WHICH_HANDS
    hand_file: Path | None = options.HAND_FILE
    tremor_mm_deg: Annotated[tuple[float, float], READ_TREMOR] | None = option(
        "Add seeded tremor of 10 Hz of this amplitude: palm position [mm] and rotation [°], such as 0.1,0.2.",
        "MM,DEG",
        "--tremor",
    )
    seed: options.AnySeed = options.SEED
    ticks: options.Count | None = option("Run only the first N ticks. Default: the whole motion.", "N")


class ReplayOutput(options.Output):
    """Path of the result, and amount of output."""

    whole: bool = option("Print every figure; without it those that matter, and what is over its limit.", None, "--all")
    repeat: options.Count = option(
        "Run the ticks N times, and print and store mean and standard deviation of their times.", "N", default=1
    )
    trust: bool = scene_options.TRUST


@make_command
def command(
    *,
    object_: str = object_options.OBJECT,
    trajectory: str = scene_options.TRAJECTORY,
    solver: SolverSettings,
    tree: object_options.TreeOrFile,
    moving: HandAndMotion,
    data: HandData,
    free: scene_options.FreeChoice,
    mesh_file: object_options.MeshFile,
    output: ReplayOutput,
    rerun: options.Rerun | None = option(
        "Show the replay in rerun: open a viewer, write a file, or send to an open viewer at HOST:PORT.", options.RERUN
    ),
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
    if scene_options.names_a_result(object_):
        return _run_again(Path(object_), output)
    from hhsim.replay.replay import Replay, replay_scene
    from hhsim.replay.summary import repeated_document, stored_times
    from hhsim.result.reader import check_result_path
    from hhsim.result.writer import add_document
    from hhsim.scene.described_scene import load_words
    from hhsim.scene.motion_catalogue import import_remarks
    from hhsim.solver.options import FREE, require_options
    from hhsim.solver.solver import SceneSolver

    if moving.hand == "both" and output.repeat > 1:
        raise click.UsageError("--repeat is of one hand")
    solver_options = solver.options()
    reading = {name: str(of) if isinstance(of, Path) else of for name, of in data.given().items()} or None
    more = {"reading": reading, **mesh_file.words(tree)}
    loaded = load_words(scene_options.scene_words(object_, trajectory, free, moving, **more), surface=solver.surface)
    motion, bodies = loaded.motions[0], loaded.bodies
    free.check_motion(motion)
    remarks = import_remarks(motion, trajectory)
    if free.free or any(body.is_free for body in bodies.settings):
        require_options(solver_options, FREE)
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
            both = Replay(SceneSolver(scene, solver_options))
            hands.update(zip(options.HANDS, both.into(output_path, **about)))
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
            from hhsim.result.reader import load_result
            from hhsim.view.sink import parse_target
            from hhsim.view.viewer import view_result

            view_result(load_result(output_path), parse_target(rerun), progress=report)
    stuck = [summary.verdict.line for summary in hands.values() if summary.verdict.mostly_stuck]
    if output.quiet and not output.as_json:
        print_notes(stuck, prefix="missed")
    columns = words("", "row.label"), number("mean ± σ", "shown"), words("unit", "row.unit")
    repeated = stored_times(document["repeated"], runs[-1].rows) if output.repeat > 1 else []
    times = [Table(columns, repeated, f"times of {len(runs)} runs")] if output.repeat > 1 else []
    of_hands = [note for summary in hands.values() for note in summary.notes]
    told = dict.fromkeys(note for note in (*remarks, *notes, *of_hands) if note not in bodies.mesh.warnings)
    output.show(
        {**document, "notes": [*remarks, *document.get("notes", ())]},
        *_figures(hands, whole=output.whole),
        *([""] if times else []),
        *times,
        *(f"note: {note}" for note in told),
        f"every tick is in {output_path}",
    )
    return int(bool(stuck))


def _figures(hands: "Mapping[str, ReplaySummary]", *, whole: bool) -> "Iterator[options.Part]":
    """Yield the verdict on each hand and the table of all."""
    from hhsim.replay.summary_table import figure_table, hands_table, short_table, whole_table

    summary, several = next(iter(hands.values())), len(hands) > 1
    touched = "" if summary.surface == "spheres" else f", {summary.surface}"
    yield f"{summary.object_name}, {summary.motion_name}, {summary.method}{touched}: {counted(summary.ticks, 'tick')}"
    for name, of in hands.items():
        yield f"{name} hand: {of.verdict.line}" if several else of.verdict.line
    yield ""
    missed = [figure for of in hands.values() for figure in of.verdict.missed]
    tables = {name: whole_table(of.rows) if whole else short_table(of.rows, missed) for name, of in hands.items()}
    rows = next(iter(tables.values()))
    table = hands_table(tables, summary.promises) if several else figure_table(rows, promises=summary.promises)
    yield replace(table, optional=("paper",))
    if not whole:
        yield "the main figures: --all prints all"


AGAIN = (
    words("array", "name"),
    words("is", "word"),
    number("ticks that differ", lambda array: "" if array.identical else array.ticks),
    number("first", lambda array: "" if array.identical else array.first_tick),
    number("largest difference", lambda array: "" if array.identical else f"{array.largest:.3g}"),
    number("bound", lambda array: "none" if math.isinf(array.bound) else f"{array.bound:g}"),
    words("unit", "units"),
)


def _run_again(path: Path, output: ReplayOutput) -> int:
    """Run the ticks of a result again and print the comparison; return 1 where something differs beyond rounding."""
    refuse_typed(
        f"has no place beside {path}, whose ticks run again as they were: hhsim replay OBJECT {path} takes its "
        f"motion, hhsim view {path} shows it",
        but=("object_", "as_json", "quiet", "trust"),
    )
    from hhsim.replay.repeat import run_again
    from hhsim.result.reader import load_result

    with progress(quiet=output.quiet) as report:
        again = run_again(load_result(path), trust=output.trust, progress=report)
    same = sum(array.identical for array in again.arrays)
    title = f"{again.path}: {again.ticks:,} ticks run again, {same} of {len(again.arrays)} arrays identical"
    notes = (f"note: {note}" for note in again.notes)
    output.show(again.to_json(), Table(AGAIN, again.arrays, title), *notes, again.sentence)
    if output.quiet and not output.as_json and not again.identical:
        print_notes([f"{again.path} is run again: {again.sentence}"], prefix="note" if again.same else "missed")
    return 0 if again.same else 1

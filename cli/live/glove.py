"""`hhsim live glove`."""

import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from hhsim.live.gloves import GLOVES, POSES, USUAL_POSE_PORT, PoseConfig
from hhsim.result.safety import AFTER_STALL
from hhsim.solver.method import METHODS

from ..arguments import object_options, options, scene_options
from ..arguments.command import Number, OptionGroup, make_command, option
from ..console import print_error, print_json, print_notes, progress
from .glove_settings import GloveChoice, own_options
from .session import run_session
from .summary import print_summary, session_json

if TYPE_CHECKING:
    from hhsim.live.gloves import GloveConfig, Hand
    from hhsim.scene.motion_catalogue import Motion

    Inputs = tuple[GloveConfig, PoseConfig, Motion | None]

USUAL_MOTION, USUAL_FREE_MOTION = "grasp", "lift"
"""Motions of a glove that plays one, beside a fixed object and a free one."""
ABOUT_POSES = "; ".join(f"{name}: {pose.about}" for name, pose in POSES.items())
Place = Annotated[
    tuple[float, ...], options.number_list("x [mm]", "y [mm]", "z [mm]", ranges=[(-100_000.0, 100_000.0)] * 3)
]
Turn = Annotated[tuple[float, ...], options.number_list("w", "x", "y", "z", ranges=[(-1000.0, 1000.0)] * 4)]


class HandChoice(OptionGroup, heading="Hand"):
    """Hand, its motion if nobody moves it, and the source of the palm's pose."""

    side: options.Side | None = option("Which hand's glove. Default: right, or the recording's.", None, "--hand")
    hand_file: Path | None = options.HAND_FILE
    trajectory: str | None = option(
        "Motion of --device replay or sim, or of --pose replay: a name (hhsim trajectories), or a file as hhsim "
        "replay takes it. Default: grasp; with --free lift.",
        "TRAJECTORY",
        shell_complete=scene_options.complete_trajectory,
    )
    pose: Annotated[str, click.Choice(list(POSES))] | None = option(
        f"Where the palm is, which few gloves say. {ABOUT_POSES}. "
        "Default: replay where the glove plays a motion, glove where it knows; else keyboard in a terminal, and fixed "
        "elsewhere."
    )
    palm: Place | None = option("Where the palm is or begins [mm]. Default: where it can grasp the object.", "X,Y,Z")
    palm_turn: Turn | None = option(
        "How the palm is turned there, a quaternion. Default: as it is, 1,0,0,0.", "W,X,Y,Z"
    )
    pose_host: str = option("Where the packets of --pose udp come from.", "HOST", default="127.0.0.1")
    pose_port: Annotated[int, click.IntRange(1, 65535)] = option(
        "Port that these packets arrive at.", "PORT", default=USUAL_POSE_PORT
    )

    def of_both(self, glove: GloveChoice, seed: int, usual_motion: str) -> "list[tuple[HandChoice, Inputs]]":
        """Return the options and the `inputs` of the hand, or of the right and the left one where there are two gloves.

        Raises click.UsageError for options that contradict each other.
        """
        if not glove.two:
            return [(self, self.inputs(glove, glove.device, glove.settings(glove.device), seed, usual_motion))]
        if self.side is not None:
            raise click.UsageError(f"--hand {self.side} is for one glove: two name their hands")
        found = []
        for side in options.HANDS:
            device, text = glove.device[side]
            own = own_options(device, text, {each.name for each in fields(self)} - {"side"})
            mine = {name: own.pop(name) for name in list(own) if name in vars(self)}
            hand = replace(self, side=side, **mine)
            if hand.pose == "keyboard":
                raise click.UsageError("--pose keyboard moves one palm: with two gloves choose another")
            inputs = hand.inputs(glove, device, glove.settings(device, own), seed, usual_motion)
            found.append((hand, inputs))
        return found

    def inputs(
        self, glove: GloveChoice, device: str, settings: dict[str, Any], seed: int, usual_motion: str
    ) -> "Inputs":
        """Return a glove, the source of the palm's pose, and the motion that either of them plays, or None.

        `seed` is of the glove's noise, `usual_motion` played if none is named. Raises click.UsageError for options that
        contradict each other.
        """
        from hhsim.live.gloves import configure

        plays = GLOVES[device].plays
        has_palm = GLOVES[device].palm
        by_keys = sys.stdin.isatty() and not glove.two
        usual = "replay" if plays else "glove" if has_palm else "keyboard" if by_keys else "fixed"
        pose = self.pose or usual
        source = POSES[pose]
        plays = plays or source.plays
        tellers = " or ".join(name for name in GLOVES if GLOVES[name].palm)
        players = " or ".join(name for name in GLOVES if GLOVES[name].plays)
        placed = " or ".join(name for name, known in POSES.items() if known.placed)
        for wrong, message in (
            (
                source.by_glove and not has_palm,
                f"--pose {pose} is for --device {tellers}: others do not know where the palm is",
            ),
            (
                not source.placed and (self.palm or self.palm_turn),
                f"--palm and --palm-turn are for --pose {placed}, not {pose}",
            ),
            (
                source.by_glove and self.palm_turn,
                f"--palm-turn is for --pose fixed and keyboard: with {pose} the hand turns the palm",
            ),
            (self.palm_turn is not None and self.palm is None, "--palm-turn needs --palm, where the palm is"),
            (
                self.trajectory is not None and not plays,
                f"--trajectory is for --device {players}, and for --pose replay",
            ),
        ):
            if wrong:
                raise click.UsageError(message)
        motion: Motion | None = None
        if plays:
            from hhsim.scene.described_scene import motion_of_side
            from hhsim.scene.script import Script

            # For one of two gloves its hand's, where a file holds both.
            motion = motion_of_side(self.trajectory or usual_motion, (self.side or "right") if glove.two else "")
            motion = motion.of_two() if glove.two and isinstance(motion, Script) else motion
        side: Hand = "left" if (self.side or getattr(motion, "hand", None)) == "left" else "right"
        x, y, z = [1e-3 * value for value in self.palm] if self.palm else (0.0, 0.0, 0.0)
        a, b, c, d = self.palm_turn or (1.0, 0.0, 0.0, 0.0)
        config = PoseConfig(pose, (x, y, z), (a, b, c, d), host=self.pose_host, port=self.pose_port)
        return configure(device, hand=side, seed=seed, **settings), config, motion


class Feedback(OptionGroup, heading="Forces"):
    """Commands to the fingers; `stale` in [ms]."""

    stiffness: Annotated[tuple[float, ...], options.one_or_five] | None = option(
        "How hard the glove stops a finger that touches, 0 (free) to 1; one number or five. Default: 0.3.", "K"
    )
    stale: Annotated[float, Number(1.0, 1000.0)] = option(
        "Input older than this frees the fingers [ms].", "MS", default=25.0
    )
    after_stall: Annotated[str, click.Choice(list(AFTER_STALL))] = option(
        "What becomes of a finger's stiffness when 10 periods were missed in a row. "
        f"{'; '.join(f'{name}: {what}' for name, what in AFTER_STALL.items())}. A stall of 20 ms "
        "frees all of them in any case.",
        default="release",
    )
    dry_run: bool = option("Read the glove, and send nothing to it.")


class SessionSolver(scene_options.SolverChoice):
    """Solver of a session, whose loop is compiled with hhsim's own methods alone."""

    method: Annotated[str, click.Choice(METHODS.names())] = option(f"{scene_options.OWN_METHODS}.", default="coupled")


class SessionSettings(options.Printing, heading="Session"):
    """Rate [Hz], duration [s], display and recording of the session."""

    rate: Annotated[float, Number(10.0, 10_000.0)] = option("Ticks a second [Hz].", "HZ", default=1000.0)
    duration: Annotated[float, Number(0.001, 1e7)] | None = option(
        "End by itself after so long [s]. Default: when told to; with --device replay, at the end of the motion.", "S"
    )
    record: options.OutPath | None = option(
        "Where the recording goes, some 2 MB a second, 3 of a free object. Default: a dated name in results/ "
        "under the current folder.",
        "FILE",
        "--record",
        "--out",
    )
    no_record: bool = option("Record nothing.")
    rerun: options.Rerun | None = option(
        "Show the hand live in the rerun viewer: open one, write a file for one, or send to one that is open, at "
        "HOST:PORT.",
        options.RERUN,
    )
    cpu: Annotated[int, click.IntRange(-1, 4095)] | None = option(
        "Processor that the loop stays on; -1: any. Default: the last one.", "N"
    )
    no_realtime: bool = option("Ask the system for no real-time scheduling, locked memory or own processor.")
    seed: options.AnySeed = options.SEED


@make_command
def command(
    *,
    object_: str = object_options.OBJECT,
    glove: GloveChoice,
    hand: HandChoice,
    feedback: Feedback,
    solver: SessionSolver,
    tree: object_options.TreeChoice,
    free: scene_options.FreeChoice,
    session: SessionSettings,
    mesh_file: object_options.MeshFile,
) -> int:
    """Put a glove in the loop: its fingers move the hand, and are stopped where the shown hand is.

    OBJECT is a name (hhsim objects), a mesh, URDF or MJCF file, or the TOML of several bodies, of which the driven ones
    stay where they begin. A finger that touches nothing is free. All fingers are freed, at
    once, when the input is old or no number, when the solver fails or is late again and again, and when the session
    ends, by whatever cause, a killed process included. Ctrl-C, q, the space bar or --duration end it. The exit code is
    2 where the glove could not be reached, the loop died, or the recording is not whole, and 1 where the end had a
    fault: the glove could not be told to free the fingers, or a process had to be killed.

    In a terminal, keys move the palm: a d, s w, f r along the axes of the world, i k, u o, j l about those of the palm,
    - and + for the size of a step, h back to where it began.

    \b
    Examples:
      hhsim live glove
      hhsim live glove cube --device dexmo --host 127.0.0.1 --calibration me.toml
      hhsim live glove bunny --device udp --pose udp --rerun spawn
      hhsim live glove cube --free --mass 0.1 --friction 0.8 --torsion 5
      hhsim live glove --device replay --trajectory session.h5 --duration 10
      hhsim live glove cube --device left=dexmo,right=dexmo --pose udp
    """
    from hhsim.hand.model import HandModel
    from hhsim.live.doctor import quick_warning
    from hhsim.live.gloves import open_device
    from hhsim.live.real_time import RealTimeWishes
    from hhsim.live.session.setup import LiveSetup, OutputLimits, SafetyLimits, grasping_hand, make_live_scene
    from hhsim.result.reader import check_result_path
    from hhsim.scene.described_scene import SceneWords, load_words
    from hhsim.scene.motion_catalogue import import_remarks
    from hhsim.solver.options import FREE, SolverOptions, require_options
    from hhsim.solver.solver import warm_up
    from hhsim.system.output_path import dated_output_path

    if session.no_record and session.record is not None:
        raise click.UsageError(f"--no-record and --record {session.record} exclude each other")
    usual = USUAL_FREE_MOTION if free.free else USUAL_MOTION
    worn = hand.of_both(glove, session.seed, usual)
    two = len(worn) > 1
    if two and session.rerun is not None:
        raise click.UsageError("--rerun shows one hand: leave it out with two gloves, and see hhsim view")
    motions = [motion for _, (_, _, motion) in worn]
    for (own, _), motion in zip(worn, motions):
        print_notes(import_remarks(motion, own.trajectory or ""))
    solver_options = SolverOptions(period=1.0 / session.rate, **solver.given())
    for motion in motions:
        free.check_motion(motion)
    models = [
        HandModel.default(device.hand) if own.hand_file is None else HandModel.from_toml(own.hand_file, device.hand)
        for own, (device, _, _) in worn
    ]
    words = SceneWords(object=object_, trajectory=hand.trajectory or usual, free=free.words(), **mesh_file.words(tree))
    loaded = load_words(words, surface=solver.surface, motions=[one for one in motions if one is not None])
    bodies, mesh = loaded.bodies, loaded.bodies.mesh
    if free.free or any(body.is_free for body in bodies.settings):
        require_options(solver_options, FREE)
    kinds = "-".join(device.kind for _, (device, _, _) in worn)
    record = None
    if not session.no_record:
        record = session.record or dated_output_path(f"{mesh.name}-live-{kinds}")
        check_result_path(record)
    print_notes(mesh.warnings, prefix="warning")
    with progress(quiet=session.quiet) as report:
        bodies, notes = loaded.with_trees(report)
        other = grasping_hand(models[0], bodies.tree, motions[0]) if two else None
        scenes = []
        for i, (own, (device, palm, motion)) in enumerate(worn):
            about: dict[str, Any] = {"placed": own.palm is not None, "other": other if i else None}
            about |= {"rate": session.rate, "seed": session.seed, "freed": loaded.freed}
            scenes.append(make_live_scene(bodies, models[i], device, palm, motion, **about))
    print_notes(notes)
    given = scenes[0].both(scenes[1]) if two else scenes[0]
    duration, gloves = session.duration, []
    for (own, (_, _, motion)), glove_ in zip(worn, given.worn):
        if GLOVES[glove_.device.kind].ends and session.duration is None and glove_.device.playback is not None:
            duration = max(duration or 0.0, glove_.device.playback.duration)
        # An error of the settings comes before any process is started.
        open_device(glove_.device)
        described = {
            **glove_.description,
            "object": object_,
            "object_mesh": mesh.sha256,
            "level": bodies.tree.depth,
            "hand_file": str(own.hand_file) if own.hand_file else None,
            "device": glove_.device.kind,
            "trajectory": None if motion is None else own.trajectory or usual,
            "seed": session.seed,
        }
        gloves.append(replace(glove_, description=described))
    setup = LiveSetup(
        scene=given.scene,
        worn=tuple(gloves),
        options=solver_options,
        rate=session.rate,
        output=OutputLimits() if feedback.stiffness is None else OutputLimits(stiffness=feedback.stiffness),
        safety=SafetyLimits(stale=1e-3 * feedback.stale, after_stall=feedback.after_stall),
        real_time=RealTimeWishes.none() if session.no_realtime else RealTimeWishes(cpu=session.cpu),
        rerun=session.rerun,
        dry_run=feedback.dry_run,
        command=("hhsim", *sys.argv[1:]),
        record=record,
        duration=duration,
    )
    warm_up(models[0], setup.options, None if two else setup.seen.free)
    warning = quick_warning(session.rate, setup.real_time)
    print_notes([warning] if warning else [], prefix="warning")
    heading = f"{mesh.name}, {solver.method}, {' and '.join(device.kind for _, (device, _, _) in worn)}"
    outcome = run_session(setup, heading, quiet=session.quiet)
    if session.as_json:
        print_json(session_json(outcome))
    elif not session.quiet:
        for of_hand in outcome.hands:
            if of_hand.ticks:
                whose = f"{of_hand.side} hand, " if two else ""
                print_summary(of_hand, f"{whose}{heading}: {of_hand.seconds:,.1f} s, {of_hand.reason}")
    if outcome.error:
        print_error(f"hhsim: error: {outcome.error}")
    return 2 if outcome.error else int(bool(outcome.fault_at_end))

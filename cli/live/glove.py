"""`hhsim live glove`."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hhsim.live.devices.registry import find_glove, glove_names
from hhsim.live.pose.registry import POSES, USUAL_POSE_PORT, PoseConfig

from .. import options, tree_level
from ..console import announce_compilation, print_json, print_notes, progress
from ..number_list import number_list
from ..object_argument import complete_object, read_object
from ..replay import complete_trajectory
from ..rerun_option import METAVAR, read_target
from .glove_settings import given_settings, glove_options
from .session import run_session
from .summary import print_summary, summary_json

if TYPE_CHECKING:
    from hhsim.hand.model import HandModel
    from hhsim.live.devices.registry import GloveConfig, Hand
    from hhsim.live.ipc.config import LiveSetup
    from hhsim.live.session.scene import LiveScene


def read_stiffness(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[float, ...] | None:
    """Read one number from 0 to 1 for all fingers, or five."""
    if value is None:
        return None
    try:
        numbers = tuple(float(part) for part in value.split(","))
    except ValueError:
        numbers = ()
    numbers = numbers * 5 if len(numbers) == 1 else numbers
    if len(numbers) != 5 or not all(0.0 <= number <= 1.0 for number in numbers):
        raise click.BadParameter(f"'{value}', expected 0 (free) to 1, or five of that", context, parameter)
    return numbers


def check_rerun(context: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    """Look at once for what would keep a viewer or its file from working; its process reads the words again."""
    read_target(context, parameter, value)
    return value


@click.command()
@click.argument("object_", metavar="[OBJECT]", default="bunny", shell_complete=complete_object)
@glove_options
@click.option(
    "--hand", type=click.Choice(["right", "left"]), help="Which hand's glove. Default: right, or the recording's."
)
@click.option(
    "--trajectory",
    metavar="TRAJECTORY",
    shell_complete=complete_trajectory,
    help="Motion of --device replay or sim, or of --pose replay: a name (hhsim trajectories), or a file as hhsim "
    "replay takes it. Default: grasp.",
)
@click.option(
    "--pose",
    type=click.Choice(list(POSES)),
    help="Where the palm is, which no glove says. "
    f"{'; '.join(f'{name}: {pose.about}' for name, pose in POSES.items())}. "
    "Default: replay where the glove plays a motion; else keyboard in a terminal, and fixed elsewhere.",
)
@click.option(
    "--palm",
    callback=number_list("x [mm]", "y [mm]", "z [mm]", signed=True),
    metavar="X,Y,Z",
    help="Where the palm is or begins [mm]. Default: where it can grasp the object.",
)
@click.option(
    "--palm-turn",
    callback=number_list("w", "x", "y", "z", signed=True),
    metavar="W,X,Y,Z",
    help="How the palm is turned there, a quaternion. Default: as it is, 1,0,0,0.",
)
@click.option(
    "--pose-host",
    metavar="HOST",
    default="127.0.0.1",
    show_default=True,
    help="Where the packets of --pose udp come from.",
)
@click.option(
    "--pose-port",
    type=click.IntRange(1, 65535),
    metavar="PORT",
    default=USUAL_POSE_PORT,
    show_default=True,
    help="Port that these packets arrive at.",
)
@click.option(
    "--stiffness",
    callback=read_stiffness,
    metavar="K",
    help="How hard the glove stops a finger that touches, 0 (free) to 1; one number or five. Default: 0.3.",
)
@click.option(
    "--stale",
    type=click.FloatRange(1.0, 1000.0),
    default=25.0,
    show_default=True,
    metavar="MS",
    help="Input older than this frees the fingers [ms].",
)
@options.method
@tree_level.level
@tree_level.max_error
@options.fingers
@options.budget
@click.option(
    "--rate",
    type=click.FloatRange(10.0, 4000.0),
    default=1000.0,
    show_default=True,
    metavar="HZ",
    help="Ticks a second [Hz].",
)
@click.option(
    "--duration",
    type=click.FloatRange(0.0, min_open=True),
    metavar="S",
    help="End by itself after so long [s]. Default: when told to; with --device replay, at the end of the motion.",
)
@click.option(
    "--record",
    "--out",
    "record",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Where the recording goes, some 2 MB a second. Default: a dated name in results/ under the current folder.",
)
@click.option("--no-record", is_flag=True, help="Record nothing.")
@click.option(
    "--rerun",
    callback=check_rerun,
    metavar=METAVAR,
    help="Show the hand live in the rerun viewer: open one, write a file for one, or send to one that is open, at "
    "HOST:PORT.",
)
@click.option("--dry-run", is_flag=True, help="Read the glove, and send nothing to it.")
@click.option(
    "--cpu",
    type=click.IntRange(-1),
    metavar="N",
    help="Processor that the loop stays on; -1: any. Default: the last one.",
)
@click.option(
    "--no-realtime", is_flag=True, help="Ask the system for no real-time scheduling, locked memory or own processor."
)
@options.unit
@options.size
@options.thickness
@options.seed
@options.json
@options.quiet
@click.pass_context
def command(context: click.Context, /, object_: str, as_json: bool, quiet: bool, **given: Any) -> int:
    """Put a glove in the loop: its fingers move the hand, and are stopped where the shown hand is.

    OBJECT is a name (hhsim objects) or a mesh file. A finger that touches nothing is free. All fingers are freed, at
    once, when the input is old or no number, when the solver fails or is late again and again, and when the session
    ends, by whatever cause, a killed process included. Ctrl-C, q, the space bar or --duration end it. The exit code is
    2 where the glove could not be reached, the loop died, or the recording is not whole.

    In a terminal, keys move the palm: a d, s w, f r along the axes of the world, i k, u o, j l about those of the palm,
    - and + for the size of a step, h back to where it began.

    \b
    Examples:
      hhsim live glove
      hhsim live glove cube --device dexmo --host 127.0.0.1 --calibration me.toml
      hhsim live glove cup --device opengloves --serial /dev/ttyUSB0 --dry-run
      hhsim live glove bunny --device udp --pose udp --rerun spawn
      hhsim live glove --device replay --trajectory session.h5 --duration 10
    """
    from hhsim.hand.model import HandModel
    from hhsim.live.devices.registry import open_device
    from hhsim.live.session.scene import make_live_scene
    from hhsim.result.reader import check_result_path
    from hhsim.solver.compile import warm_up
    from hhsim.system.output_path import dated_output_path

    glove, palm, motion = chosen_input(context, given)
    record, duration = given["record"], given["duration"]
    announce_compilation(quiet=quiet)
    mesh, usual_level = read_object(object_, *(given[name] for name in ("unit", "size", "thickness")))
    if record is None and not given["no_record"]:
        record = dated_output_path(f"{mesh.name}-live-{glove.kind}")
    if record is not None:
        check_result_path(record)
    print_notes(mesh.warnings, prefix="warning")
    model = HandModel.default(glove.hand)
    with progress(quiet=quiet) as report:
        chosen = tree_level.choose_tree(mesh, given["level"], usual_level, given["max_error"], report)
        placed = given["palm"] is not None
        scene = make_live_scene(mesh, chosen.tree, model, glove, palm, motion, placed=placed, seed=given["seed"])
    print_notes(chosen.notes)
    if find_glove(glove.kind).ends and duration is None and scene.device.playback is not None:
        duration = scene.device.playback.duration
    # What the driver cannot use is reported before any process is started.
    open_device(scene.device)
    description = {
        **scene.description,
        "object": object_,
        "object_mesh": mesh.sha256,
        "level": chosen.level,
        "device": glove.kind,
        "trajectory": None if motion is None else given["trajectory"] or "grasp",
        "seed": given["seed"],
    }
    setup = make_setup(scene, model, given, record=record, duration=duration, description=description)
    warm_up(model, setup.options)
    heading = f"{mesh.name}, {given['method']}, {glove.kind}"
    outcome, error = run_session(setup, heading, quiet=quiet)
    if as_json:
        print_json(summary_json(outcome, error))
    elif not quiet and outcome.ticks:
        print_summary(outcome, f"{heading}: {outcome.seconds:,.1f} s, {outcome.reason}")
    if error:
        print(f"hhsim: error: {error}", file=sys.stderr)
    return 2 if error else 0


def chosen_input(context: click.Context, given: dict[str, Any]) -> "tuple[GloveConfig, PoseConfig, Any]":
    """The glove, where the palm is, and the motion that either of them makes, or None.

    Raises:
        click.UsageError: Options that contradict each other.
    """
    from hhsim.live.devices.registry import configure
    from hhsim.scene.motion_catalogue import resolve_trajectory

    device, palm, turn = given["device"], given["palm"], given["palm_turn"]
    if given["no_record"] and given["record"] is not None:
        raise click.UsageError(f"--no-record and --record {given['record']} exclude each other")
    settings = given_settings(context, device)
    plays = find_glove(device).plays
    pose = given["pose"] or ("replay" if plays else "keyboard" if sys.stdin.isatty() else "fixed")
    if not POSES[pose].placed and (palm or turn):
        raise click.UsageError(f"--palm and --palm-turn are for --pose fixed and keyboard, not {pose}")
    if turn is not None and palm is None:
        raise click.UsageError("--palm-turn needs --palm, where the palm is")
    plays = plays or POSES[pose].plays
    if given["trajectory"] is not None and not plays:
        playing = " or ".join(name for name in glove_names() if find_glove(name).plays)
        raise click.UsageError(f"--trajectory is for --device {playing}, and for --pose replay")
    motion = resolve_trajectory(given["trajectory"] or "grasp") if plays else None
    hand: Hand = "left" if (given["hand"] or getattr(motion, "hand", "")) == "left" else "right"
    glove = configure(device, hand=hand, seed=given["seed"], **settings)
    x, y, z = [1e-3 * value for value in palm] if palm else (0.0, 0.0, 0.0)
    a, b, c, d = turn or (1.0, 0.0, 0.0, 0.0)
    source = PoseConfig(pose, (x, y, z), (a, b, c, d), host=given["pose_host"], port=given["pose_port"])
    return glove, source, motion


def make_setup(scene: "LiveScene", hand: "HandModel", given: dict[str, Any], **more: Any) -> "LiveSetup":
    """The session that the options mean."""
    from hhsim.live.ipc.config import LiveSetup, OutputLimits, SafetyLimits
    from hhsim.live.real_time import RealTimeWishes
    from hhsim.solver.options import SolverOptions

    solver = {name: given[name] for name in ("method", "fingers", "budget") if given[name] is not None}
    stiffness, ordinary = given["stiffness"], given["no_realtime"]
    return LiveSetup(
        mesh=scene.mesh,
        tree=scene.tree,
        hand=hand,
        options=SolverOptions(period=1.0 / given["rate"], **solver),
        device=scene.device,
        pose=scene.pose,
        rate=given["rate"],
        output=OutputLimits() if stiffness is None else OutputLimits(stiffness=stiffness),
        safety=SafetyLimits(stale=1e-3 * given["stale"]),
        real_time=RealTimeWishes.none() if ordinary else RealTimeWishes(cpu=given["cpu"]),
        rerun=given["rerun"],
        dry_run=given["dry_run"],
        command=("hhsim", *sys.argv[1:]),
        **more,
    )

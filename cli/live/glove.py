"""`hhsim live glove`."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from .. import options, tree_level
from ..console import announce_compilation, print_json, print_notes, progress
from ..number_list import number_list
from ..object_argument import complete_object, read_object
from ..replay import complete_trajectory
from ..rerun_option import METAVAR, read_target
from .session import run_session
from .summary import print_summary, summary_json

if TYPE_CHECKING:
    from hhsim.live.devices.registry import DeviceConfig
    from hhsim.recordings.dexmo_regression import DexmoRegression

GLOVES = ("dexmo", "opengloves", "udp", "replay", "sim")
POSES = ("keyboard", "fixed", "replay", "udp")


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
@click.option(
    "--device",
    type=click.Choice(GLOVES),
    default="sim",
    show_default=True,
    help="dexmo: a Dexmo at its vendor's server; opengloves: an OpenGloves or LucidGloves, by serial line or TCP; udp: "
    "any other, by an open packet; replay: a recording in its place; sim: a simulated one, which needs no hardware.",
)
@click.option("--host", metavar="HOST", default="127.0.0.1", show_default=True, help="Where the glove's server is.")
@click.option(
    "--port",
    type=click.IntRange(1, 65535),
    metavar="PORT",
    help="Port of the glove's server. Default: 55555 for dexmo, 65432 for opengloves, 24170 for udp.",
)
@click.option(
    "--serial",
    "--path",
    "path",
    metavar="LINE",
    help="Serial line of opengloves, such as /dev/ttyUSB0, instead of TCP.",
)
@click.option(
    "--baud",
    type=click.IntRange(1),
    default=115_200,
    show_default=True,
    metavar="BAUD",
    help="Bits a second of the serial line.",
)
@click.option(
    "--full-scale",
    type=click.FloatRange(1.0),
    metavar="COUNTS",
    help="Largest reading of opengloves; 1023 for boards with 10 bits. Default: 4095.",
)
@click.option(
    "--hand", type=click.Choice(["right", "left"]), help="Which hand's glove. Default: right, or the recording's."
)
@click.option(
    "--device-id",
    type=click.IntRange(0),
    metavar="ID",
    help="The glove's number at its server. Default: the hand's first.",
)
@click.option(
    "--calibration",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Calibration of the glove: our TOML, or the vendor's JSON of profiles.",
)
@click.option("--profile", metavar="NAME", help="Profile of a calibration file that holds several.")
@click.option(
    "--trajectory",
    metavar="TRAJECTORY",
    shell_complete=complete_trajectory,
    help="Motion of --device sim or replay, or of --pose replay: a name (hhsim trajectories), or a file as hhsim "
    "replay takes it. Default: grasp.",
)
@click.option(
    "--pose",
    type=click.Choice(POSES),
    help="Where the palm is, which no glove says. keyboard: moved with keys; fixed: at one place; replay: as in "
    "--trajectory; udp: by packets of a tracker. Default: replay where the glove plays a motion; else keyboard in a "
    "terminal, and fixed elsewhere.",
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
    help="Port that these packets arrive at. Default: 24172.",
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
def command(
    object_: str,
    device: str,
    host: str,
    port: int | None,
    path: str | None,
    baud: int,
    full_scale: float | None,
    hand: str | None,
    device_id: int | None,
    calibration: Path | None,
    profile: str | None,
    trajectory: str | None,
    pose: str | None,
    palm: tuple[float, ...] | None,
    palm_turn: tuple[float, ...] | None,
    pose_host: str,
    pose_port: int | None,
    stiffness: tuple[float, ...] | None,
    stale: float,
    method: str,
    level: int | None,
    max_error: float | None,
    fingers: tuple[str, ...] | None,
    budget: int | None,
    rate: float,
    duration: float | None,
    record: Path | None,
    no_record: bool,
    rerun: str | None,
    dry_run: bool,
    cpu: int | None,
    no_realtime: bool,
    unit: str | None,
    size: float | None,
    thickness: float | None,
    seed: int,
    as_json: bool,
    quiet: bool,
) -> int:
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
    from hhsim.live.devices.registry import DeviceConfig, open_device
    from hhsim.live.ipc.config import LiveSetup, OutputLimits, RealTimeWishes, SafetyLimits
    from hhsim.live.pose.config import PoseConfig
    from hhsim.live.session.scene import PLAYED, make_live_scene
    from hhsim.result.reader import check_result_path
    from hhsim.scene.motion_catalogue import resolve_trajectory
    from hhsim.solver.compile import warm_up
    from hhsim.solver.options import SolverOptions
    from hhsim.system.output_path import dated_output_path

    if no_record and record is not None:
        raise click.UsageError(f"--no-record and --record {record} exclude each other")
    if path is not None and device != "opengloves":
        raise click.UsageError(f"--serial is for --device opengloves, not {device}")
    pose = pose or ("replay" if device in PLAYED else "keyboard" if sys.stdin.isatty() else "fixed")
    if pose in ("replay", "udp") and (palm or palm_turn):
        raise click.UsageError(f"--palm and --palm-turn are for --pose fixed and keyboard, not {pose}")
    if palm_turn is not None and palm is None:
        raise click.UsageError("--palm-turn needs --palm, where the palm is")
    plays = device in PLAYED or pose == "replay"
    if trajectory is not None and not plays:
        raise click.UsageError("--trajectory is for --device sim or replay, and for --pose replay")
    motion = resolve_trajectory(trajectory or "grasp") if plays else None
    side: Literal["right", "left"] = "left" if (hand or getattr(motion, "hand", "")) == "left" else "right"
    glove = DeviceConfig(
        kind=device,
        host=host,
        port=port or 0,
        path=path or "",
        baud=baud,
        full_scale=full_scale or 0.0,
        hand=side,
        calibration=str(calibration) if calibration else "",
        profile=profile or "",
        device_id=-1 if device_id is None else device_id,
        seed=seed,
    )
    x, y, z = [1e-3 * value for value in palm] if palm else (0.0, 0.0, 0.0)
    a, b, c, d = palm_turn or (1.0, 0.0, 0.0, 0.0)
    source = PoseConfig(pose, (x, y, z), (a, b, c, d), host=pose_host, port=pose_port or 0)
    changed: dict[str, Any] = {"fingers": fingers, "budget": budget}
    solver = SolverOptions(
        method=method, period=1.0 / rate, **{name: value for name, value in changed.items() if value is not None}
    )
    announce_compilation(quiet=quiet)
    mesh, usual_level = read_object(object_, unit, size, thickness)
    output_path = None if no_record else record or dated_output_path(f"{mesh.name}-live-{device}")
    if output_path is not None:
        check_result_path(output_path)
    print_notes(mesh.warnings, prefix="warning")
    with progress(quiet=quiet) as report:
        model = HandModel.default(side)
        chosen = tree_level.choose_tree(mesh, level, usual_level, max_error, report)
        scene = make_live_scene(mesh, chosen.tree, model, glove, source, motion, placed=palm is not None, seed=seed)
    print_notes(chosen.notes)
    if device == "replay" and duration is None and scene.device.playback is not None:
        duration = scene.device.playback.duration
    # What the driver cannot use is told before any process is started.
    open_device(scene.device)
    setup = LiveSetup(
        mesh=scene.mesh,
        tree=scene.tree,
        hand=model,
        options=solver,
        device=scene.device,
        pose=scene.pose,
        regression=_regression(glove),
        rate=rate,
        duration=duration,
        output=OutputLimits() if stiffness is None else OutputLimits(stiffness=stiffness),
        safety=SafetyLimits(stale=1e-3 * stale),
        real_time=RealTimeWishes(False, lock_memory=False, timer_slack=False, cpu=-1, freeze_gc=False)
        if no_realtime
        else RealTimeWishes(cpu=cpu),
        record=output_path,
        rerun=rerun,
        dry_run=dry_run,
        command=("hhsim", *sys.argv[1:]),
        description={
            **scene.description,
            "object": object_,
            "object_mesh": mesh.sha256,
            "level": chosen.level,
            "device": device,
            "trajectory": trajectory or ("grasp" if plays else None),
            "seed": seed,
        },
    )
    warm_up(model, solver)
    outcome, error = run_session(setup, f"{mesh.name}, {method}, {device}", quiet=quiet)
    if as_json:
        print_json(summary_json(outcome, error))
    elif not quiet and outcome.ticks:
        print_summary(outcome, f"{mesh.name}, {method}, {device}: {outcome.seconds:,.1f} s, {outcome.reason}")
    if error:
        print(f"hhsim: error: {error}", file=sys.stderr)
    return 2 if error else 0


def _regression(glove: "DeviceConfig") -> "DexmoRegression":
    """What a bend of this glove is in angles."""
    from hhsim.recordings.dexmo_regression import DexmoRegression

    if glove.kind != "dexmo" or not glove.calibration:
        return DexmoRegression.default()
    from hhsim.live.devices.calibration import load_calibration

    return load_calibration(Path(glove.calibration), glove.hand, glove.profile).regression

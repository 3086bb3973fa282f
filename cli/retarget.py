"""`hhsim retarget`."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from hhsim.table.table import Table, number, words

from .arguments import options
from .console import print_json, print_line, print_table, progress

if TYPE_CHECKING:
    from hhsim.repair.retarget import RobotMotion


def read_map(context: click.Context, parameter: click.Parameter, value: str | None) -> dict[str, str] | None:
    """Read finger=link, with commas between."""
    from hhsim.hand.fingers import FINGERS

    if value is None:
        return None
    pairs = [part.partition("=") for part in value.split(",")]
    found = {finger.strip(): link.strip() for finger, _, link in pairs}
    if not all(found.values()) or not found.keys() <= set(FINGERS) or len(found) < len(pairs):
        expected = f"finger=link with commas between, each of {', '.join(FINGERS)} once at most"
        raise click.BadParameter(f"'{value}', expected {expected}", context, parameter)
    return found


@click.command(cls=options.Command)
@click.argument("result", type=options.FILE)
@click.option("--robot", required=True, metavar="FILE|allegro|shadow", help="URDF or MJCF of the robot's hand.")
@click.option(
    "--map",
    "fingers",
    callback=read_map,
    metavar="FINGER=LINK,...",
    help="Link or site of each fingertip. Default: the last links, where their names tell the finger.",
)
@options.one_hand
@options.Output.argument("output")
def command(result: Path, robot: str, fingers: dict[str, str] | None, side: str | None, output: options.Output) -> None:
    """Write joint angles of a robot's hand for a result.

    RESULT is a file that hhsim replay or hhsim live wrote; each of its ticks is a row of the output, .npz or .csv. The
    robot's fingertips go where those of the shown hand are, its wrist is free, and its joints stay in their ranges;
    fingers that the robot lacks are left out. Printed are the distances of its fingertips from the hand's, and how deep
    its links are in the object: retargeting does not keep them out. It needs MuJoCo, which pip install
    'hhsim[retarget]' brings; allegro and shadow are public descriptions, which the package robot_descriptions gets.

    \b
    Examples:
      hhsim retarget results/grasp.h5 --robot hand.urdf --out angles.npz
      hhsim retarget grasp.h5 --robot shadow --out shadow.csv
      hhsim retarget grasp.h5 --robot hand.urdf --map thumb=link_15_tip,index=link_3_tip --out angles.csv
    """
    from hhsim.repair.retarget import check_motion_path, motion_bytes, robot_motion
    from hhsim.repair.robot_hand import RobotHand, find_robot
    from hhsim.result.reader import load_hand
    from hhsim.system.atomic_write import write_atomically

    loaded = load_hand(result, side or "")
    out = output.path(f"{result.stem}-{Path(robot).stem}", ".npz")
    check_motion_path(out)
    hand = RobotHand(find_robot(robot, loaded.scene["hand"]["side"]), fingers)
    with progress(quiet=output.quiet) as report:
        found = robot_motion(loaded, hand, report)
        write_atomically(out, motion_bytes(found, out.suffix))
    errors = [
        (finger, link, float(error.mean()), float(error.max()))
        for finger, link, error in zip(found.fingers, hand.links, found.motion.error.T)
    ]
    if output.as_json:
        depth = found.depth
        print_json(
            {
                "result": str(result),
                "robot": hand.name,
                "out": str(out),
                "ticks": len(found.time),
                "joints": found.joints,
                "fingertip_error": [dict(zip(("finger", "link", "mean", "max"), error)) for error in errors],
                "link_depth": None
                if depth is None
                else {
                    "max": float(depth.depth.max()),
                    "mean": float(depth.depth.mean()),
                    "link": depth.link[int(depth.depth.argmax())],
                    "tick": int(depth.frames[depth.depth.argmax()]),
                    "ticks": len(depth.frames),
                },
            }
        )
    elif not output.quiet:
        columns = words("finger", 0), words("link", 1), number("mean error", 2, "mm", 2), number("max", 3, "mm", 2)
        print_table(Table(columns, errors, f"{len(hand.joints)} joints of {hand.name} at {len(found.time):,} ticks"))
        print_line(_depth_line(found))
        print_line(f"written: {out}")


def _depth_line(found: "RobotMotion") -> str:
    depth = found.depth
    if depth is None:
        return "the object encloses nothing: no depth of the links in it"
    worst = int(depth.depth.argmax())
    if not depth.depth[worst] > 0.0:
        return f"no link is in the object at any of {len(depth.frames):,} ticks"
    return (
        f"links up to {1e3 * depth.depth[worst]:.2f} mm in the object ({depth.link[worst]}, tick "
        f"{depth.frames[worst]:,}), {1e3 * depth.depth.mean():.2f} mm in the mean of {len(depth.frames):,} ticks"
    )

"""Scene as a folder that any software reads: mesh, spheres, motion, hand, and an example of a submission."""

import json
import os
import shutil
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import OutputError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.motion.csv_file import POSE_COLUMNS, format_csv
from hhsim.motion.trajectory import ObjectMotion
from hhsim.scene.scene import Scene
from hhsim.solver.scene_solver import seen_scene
from hhsim.submissions.hand_mjcf import STEP, hand_mjcf
from hhsim.submissions.pose_file import Submission, format_poses
from hhsim.submissions.scene_file import (
    free_bodies,
    hand_prefixes,
    recorded_poses,
    scene_bodies,
    scene_digest,
    scene_mjcf,
    scene_names,
    scene_title,
    tick_trajectory,
)
from hhsim.table.table import Table

SCENE_FILE = "scene.json"
"""File of a folder that has the words that its scene is made by."""
EXAMPLE = "example-submission.csv"
DRIVEN_FILE = "driven.csv"


def check_scene_folder(folder: Path) -> None:
    """Raise OutputError if the folder exists and is not empty, or if its parent does not exist."""
    if folder.is_dir() and not any(folder.iterdir()):
        return
    if os.path.lexists(folder):
        what = "is not empty" if folder.is_dir() else "is a file"
        raise OutputError(f"{folder} exists and {what}, so it is not replaced: name a new folder with --out")
    if not folder.absolute().parent.is_dir():
        raise OutputError(f"there is no folder {folder.parent} for {folder.name}: make it first")


def write_scene_folder(scene: Scene, folder: Path) -> str:
    """Make the folder of a scene in one step, and return the scene's digest, which submissions state.

    Raises OutputError as `check_scene_folder`, or if it cannot be written; InputError as `scene_mjcf`.
    """
    check_scene_folder(folder)
    digest, prefixes = scene_digest(scene), hand_prefixes(scene)
    ticks = scene.ticks
    bodies, parts = scene_bodies(scene), seen_scene(scene).parts
    description = {
        "format": "hhsim-scene",
        "scene": digest,
        "made_by": scene_names(scene),
        "rate": ticks.rate,
        "ticks": ticks.tick_count,
        "hand": scene_names(scene)["hand"],
        "phases": [phase._asdict() for phase in ticks.phases],
        "units": "m, rad, s, N; world right-handed, z up; quaternions w x y z",
        **({} if parts is None else {"bodies": [body.to_json() for body in bodies]}),
    }
    heading = ("x [m]", "y [m]", "z [m]", "radius [m]", *([] if parts is None else ["body"]))
    leaves = [np.column_stack([body.tree.leaf_center, body.tree.leaf_radius]).tolist() for body in bodies]
    spheres = [(*leaf, body.name) for body, its in zip(bodies, leaves) for leaf in its]
    names = ("object_position", "object_orientation", "name", "source")
    about = [{name: getattr(hand.trajectory, name) for name in names} for hand in scene.hands]
    files = {
        SCENE_FILE: json.dumps(description, indent=2) + "\n",
        **{f"{body.name}.obj": body.mesh.obj() for body in bodies},
        "spheres.csv": Table.of_cells(heading, spheres).csv(),
        "scene.xml": scene_mjcf(scene),
        EXAMPLE: format_poses(example_submission(scene)),
    }
    for prefix, hand, of in zip(prefixes, scene.hands, about, strict=True):
        moved, model = tick_trajectory(hand.ticks.seen_from_object(), hand=hand.model.side, **of), hand.model
        files |= {
            f"{prefix}motion.csv": format_csv(moved),
            f"{prefix}hand.json": json.dumps(_numbers(model), indent=1) + "\n",
            f"{prefix}hand.xml": hand_mjcf(model, prefix),
        }
    if parts is not None and recorded_poses(scene):
        files[DRIVEN_FILE] = _driven_poses(scene, parts.values)
    files["README.md"] = _readme(scene, digest, files)
    target = folder.absolute()
    partial = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        partial.mkdir()
        for name, content in files.items():
            (partial / name).write_text(content, encoding="utf-8", newline="")
        partial.replace(target)
    except OSError as error:
        raise OutputError(f"cannot write {folder}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return digest


def _driven_poses(scene: Scene, joints: Mapping[str, FloatArray]) -> str:
    """Return poses of driven bodies and values of their joints at each tick as CSV, in s, m and rad."""
    columns = {"time": scene.ticks.time}
    for name, poses in recorded_poses(scene).items():
        columns |= {f"{name}_{column}": values for column, values in zip(POSE_COLUMNS[1:], poses.T)}
        columns |= {f"{name}_joint": joints[name]} if name in joints else {}
    return Table.of_cells([*columns], np.column_stack([*columns.values()]).tolist()).csv()


def example_submission(scene: Scene) -> Submission:
    """Return the users' own hands, which penetrate the bodies, as a submission in which free bodies stay."""
    seen, count = seen_scene(scene), scene.ticks.tick_count
    still = ObjectMotion(np.zeros((count, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)))
    made = None
    for hand, haptic in zip(reversed(scene.hands), reversed(seen.haptic), strict=True):
        made = Submission(
            method="the user's own hand" if len(scene.hands) == 1 else "the user's own hands",
            scene=scene_digest(scene),
            time=scene.ticks.time,
            poses=haptic,
            made_by=scene_names(scene),
            hand=hand.model.side,
            left=made,
            bodies=dict.fromkeys(free_bodies(scene), still),
        )
    assert made is not None
    return made


def _numbers(hand: HandModel) -> dict[str, Any]:
    """Return the hand as plain values; the names are those of `HandModel`."""
    fingers = {}
    for f, finger in enumerate(FINGERS):
        names = ("base", "distal", "dorsal", "length", "radius", "flexion_min", "flexion_max")
        sizes = {name: getattr(hand, name)[f].tolist() for name in names}
        limits = {name: float(getattr(hand, name)[f]) for name in ("abduction_min", "abduction_max")}
        fingers[finger] = sizes | limits
    return {
        "units": "m, rad; palm frame",
        "side": hand.side,
        "hand_length": hand.hand_length,
        "hand_breadth": hand.hand_breadth,
        "fingers": fingers,
        "palm_spheres": np.column_stack([hand.palm_tree.leaf_center, hand.palm_tree.leaf_radius]).tolist(),
    }


def _readme(scene: Scene, digest: str, files: Collection[str]) -> str:
    ticks = scene.ticks
    sides, prefixes = [hand.model.side for hand in scene.hands], hand_prefixes(scene)
    sign = {"right": "", "left": "minus "}
    signs = " and ".join(f"{sign[side]}w" if len(sides) == 1 else f"{sign[side]}w ({side})" for side in sides)
    meshes = ", ".join(f"`{body.name}.obj`" for body in scene_bodies(scene))
    motion, numbered = (", ".join(f"`{prefix}{name}`" for prefix in prefixes) for name in ("motion.csv", "hand.json"))
    models = ", ".join(f"`{prefix}hand.xml`" for prefix in prefixes)
    last = f"| `{DRIVEN_FILE}` | poses and joint values of driven bodies |\n" if DRIVEN_FILE in files else ""
    free = ", ".join(f"`{name}.obj`" for name in free_bodies(scene))
    moved = (
        f" Columns of\n{free} are its pose, which begins at 0 0 0, 1 0 0 0: forces move it, and you say where to."
        if free
        else ""
    )
    return f"""# A scene of hhsim: {scene_title(scene_names(scene))}

Show a hand for each of the {ticks.tick_count:,} ticks, {ticks.rate:g} a second: as near to the user's as it can be and
not in the bodies. Write a line a tick, and measure it:

    hhsim score my-submission.csv

Its columns are those of `{EXAMPLE}` with its first lines, which say by its digest what scene it is; your method's name
instead of the one there. Forces on each phalanx and on the palm [N, world] and the time that each tick took [s] may
follow: docs/submissions.md of hhsim lists the columns.{moved}

| file | holds |
|---|---|
| {meshes} | the mesh [m], world; of bodies of which none is free, in their own frames |
| `spheres.csv` | the leaf spheres that cover it [m]: what hhsim's own methods touch by default |
| {motion} | the user's hand at every tick, with the phases of the motion |
| {numbered} | the hand as numbers [m, rad], palm frame |
| {models} | the same as MJCF; joints are called as the columns |
| `scene.xml` | hand and object as MJCF: the mesh is seen, its spheres collide; keyframe `start` is the first tick |
| `{EXAMPLE}` | the user's own hand as a submission, which goes through everything |
{last}\
| `{SCENE_FILE}` | digest, rate, phases, bodies, and the words that hhsim makes the scene by |

## Frames and units

SI units: m, rad, s, N. The world is right-handed with z up; quaternions are w x y z and turn the palm's frame to the
world. Palm frame of a hand ({" and ".join(sides)} here): y to the fingers, z out of the back, x = y × z: to the right
as the hand lies before you, fingers away from you, back up.

A finger begins at `base`. With u = `distal` and w = `dorsal`, abduction turns u about {signs}; then each flexion turns
what is beyond its joint about w × u, which has been turned by abduction too, positive to the palm. Phalanx k is the
hull of two spheres, of `radius` k and k + 1, whose centres are `length` k apart: a round cone. The palm is its spheres.

The MJCF has these joints exactly. Its shapes are capsules where both radii are equal; a tapering phalanx is a
sphere and capsules inside of it, no part of whose surface is more than {1e3 * STEP:g} mm too low. What is measured is
the round cones. Masses are those of water; hhsim has none.

    scene: {digest}
"""

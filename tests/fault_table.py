"""Faults planted in results of all kinds, each with the check that names it: in every dataset, figure and label."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from body_tables import TABLE, body, body_file
from file_faults import Fault, at, attribute, forge_properties, forge_scene, of_properties, of_scene, with_name
from free_scenes import free_result
from planted_faults import HOLD, UNMARKED
from short_grasp import result_of

from hhsim.scene.scene import open_scene

MESH, SLOW = ("--surface", "mesh"), ("--rate", "25", "--level", "3")
WORDS: dict[str, tuple[str, ...]] = {
    "one hand": ("cylinder", "grasp", "--rate", "100", "--level", "2"),
    "fixed": ("cube", "grasp", *SLOW),
    "driven": ("cube", "carry", *SLOW),
    "free": ("cube", "lift", "--free", *MESH, *SLOW),
    "laptop": ("laptop", "open", *MESH, *SLOW),
    "door": ("door", "swing", *MESH, *SLOW),
    "chest": ("chest", "lift", *MESH, *SLOW),
    "two": ("cube", "lift-both", "--hands", "both", "--free", *MESH, *SLOW),
    "two at a laptop": ("laptop", "close", "--hands", "both", *MESH, *SLOW),
    "tremor": ("cube", "pinch", "--tremor", "0.1,0.2", "--self-contact", "on", "--rate", "50"),
    "recording": ("cylinder", "{one hand}", "--rate", "250", "--level", "2"),
    "paper": ("cube", "grasp", "--method", "paper", *SLOW),
    "progressive": ("cube", "grasp", "--method", "progressive", *SLOW),
}
"""Arguments of `hhsim replay`; a kind in braces is the path of its result."""
LATE = 55
"""A tick in which hands hold, in runs at 25 ticks a second."""
AIR = 20
"""A tick of the approach."""
FREE_TICK = 200
"""A tick of the hold of a free body."""
TICKS, AT_REST, HELD = 1600, 300, 1590
"""Ticks of the run with two halves, one in which no hand is near, and one in which the hand bears on both."""
AGAIN = "second run"
HALVES = [
    body(name, [0.019999, 0.04, 0.04], position=[x, 0.0, 0.02], mass=0.05)
    for name, x in (("one", -0.01), ("two", 0.01))
]
"""A block in two halves, which the fingers press on each other."""
ONE, TWO = (f"bodies/{name}/tick" for name in ("one", "two"))


def halves(path: Path) -> None:
    scene = open_scene(body_file(path.parent, *HALVES, TABLE), "stack", solid=False, level=2)
    result_of(scene.first(TICKS), path, surface="mesh")


PROGRAMS: dict[str, Callable[[Path], object]] = {"free on a table": free_result, "halves": halves}
"""Results of programs that call the library."""


# Each fault: what is done to the file, what may be said of it, and whether the file's seal is made to fit again.


def moved_hand(file: h5py.File) -> None:
    """The whole hand a little deeper, joints and all: only the distances can tell."""
    direction = -file["hands/right/tick/force/total"][HOLD] / np.linalg.norm(file["hands/right/tick/force/total"][HOLD])
    file["hands/right/tick/graphic/position"][HOLD] += 5e-6 * direction
    file["hands/right/tick/graphic/joints"][HOLD] += 5e-6 * direction
    file["hands/right/tick/force/palm_wrench"][HOLD, :3] += 1000.0 * 5e-6 * direction


def rotated(file: h5py.File) -> None:
    w, x, y, z = file["hands/right/tick/graphic/orientation"][HOLD]
    half = 0.5e-4
    file["hands/right/tick/graphic/orientation"][HOLD] = np.array(
        [w - half * z, x - half * y, y + half * x, z + half * w]
    ) / (np.sqrt(1.0 + half * half))


def scaled_force(file: h5py.File) -> None:
    for name in ("phalanx", "total"):
        file[f"hands/right/tick/force/{name}"][...] *= 1.001


def force_in_the_air(file: h5py.File) -> None:
    file["hands/right/tick/force/phalanx"][0, 1, 2] = (0.0, 0.0, 0.5)
    file["hands/right/tick/force/total"][0] += (0.0, 0.0, 0.5)


def not_the_optimum(file: h5py.File) -> None:
    """The user's hand was elsewhere than the file says, and the wrench is made to fit."""
    file["hands/right/tick/haptic/position"][HOLD] += (0.0, 0.0, 1e-4)
    file["hands/right/tick/force/palm_wrench"][HOLD, 2] -= 1000.0 * 1e-4


def wrong_parent(file: h5py.File) -> None:
    """A leaf becomes the child of the sphere that is farthest from it: a walk would miss it."""
    tree = file["bodies/cylinder/tree"]
    away = np.linalg.norm(tree["center"][...] - tree["center"][-1], axis=1)
    above = np.flatnonzero(tree["level"][...] == tree["level"][-1] - 1)
    tree["parent"][-1] = above[away[above].argmax()]


def edited_mesh(file: h5py.File) -> None:
    vertices = file["bodies/cylinder/mesh/vertices"]
    outward = vertices[0] - vertices[...].mean(axis=0)
    vertices[0] = vertices[0] + 0.005 * outward / np.linalg.norm(outward)


def over_the_limit(file: h5py.File) -> None:
    """An angle beyond its limit, and the joints that belong to it."""
    file["hands/right/tick/graphic/flexion"][HOLD, 1, 2] = file["hands/right/flexion_max"][1, 2] + 1e-3


def repeated_tick(file: h5py.File) -> None:
    def repeat(_: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            item[120] = item[119]

    for group in ("tick", "hands/right/tick"):
        file[group].visititems(repeat)


def short_whole(file: h5py.File) -> None:
    file["hands/right/tick/duration/total"][120] = file["hands/right/tick/duration/detect"][120] - 1


def frozen_hand(file: h5py.File) -> None:
    """A tick of the grasp shows the hand of the tick before, and all that follows from it."""
    for name in ("position", "orientation", "flexion", "abduction", "joints"):
        file[f"hands/right/tick/graphic/{name}"][120] = file[f"hands/right/tick/graphic/{name}"][119]


def tangential_force(file: h5py.File) -> None:
    """Friction, which nobody modelled, on the phalanx that bears most."""
    row = file["hands/right/tick/force/phalanx"][HOLD]
    f, k = divmod(int(np.linalg.norm(row, axis=2).argmax()), 3)
    across = np.cross(row[f, k], [0.3, -0.5, 0.8])
    row[f, k] += 0.01 * across
    file["hands/right/tick/force/phalanx"][HOLD] = row
    file["hands/right/tick/force/total"][HOLD] += 0.01 * across


def dropped_palm_sphere(file: h5py.File) -> None:
    """From the palm that collides, and from its tree."""
    level = file["hands/right/palm_tree/level"][...]
    drop(file["hands/right"], ("palm_center", "palm_radius"), 0)
    drop(file["hands/right/palm_tree"], ("center", "radius", "level", "parent"), int(np.argmax(level == level.max())))
    forge_scene(file, lambda scene: scene["hand"].update(palm_spheres=scene["hand"]["palm_spheres"] - 1))


def deleted_figure(file: h5py.File) -> None:
    del file["summary/right"].attrs["tracking_excess"]


def drop(group: h5py.Group, names: tuple[str, ...], row: int) -> None:
    for name in names:
        kept, attributes = np.delete(group[name][...], row, axis=0), dict(group[name].attrs)
        del group[name]
        group[name] = kept
        group[name].attrs.update(attributes)


def deep_between_samples(file: h5py.File) -> None:
    """Both hands 2 mm deeper at a tick that nothing marks."""
    direction = -file["hands/right/tick/force/total"][HOLD] / np.linalg.norm(file["hands/right/tick/force/total"][HOLD])
    for name in ("graphic/position", "graphic/joints", "haptic/position"):
        file[f"hands/right/tick/{name}"][UNMARKED] += 2e-3 * direction


def busy_clock(file: h5py.File) -> None:
    """More time of one thread than went by."""
    file["hands/right/tick/duration/total_cpu"][UNMARKED] = (
        file["hands/right/tick/duration/total"][UNMARKED] + 5_000_000
    )


def excused_forces(file: h5py.File) -> None:
    """A tenth more force in ticks that claim full arrays, or a way left, so that no claim of forces is of them."""
    for ticks, flag in ((slice(HOLD - 30, HOLD), 16), (slice(HOLD, HOLD + 30), 2)):
        file["hands/right/tick/status"][ticks] |= flag
        file["hands/right/tick/lag"][ticks] = 1e-6 * (flag == 2)
        for name in ("phalanx", "total"):
            file[f"hands/right/tick/force/{name}"][ticks] *= 1.1


def invented_dataset(file: h5py.File) -> None:
    file["hands/right/tick/graphic/comfort"] = file["hands/right/tick/lag"][...]


def of_body(name: str, body: str, change: Callable[[dict[str, Any]], object]) -> Fault:
    """Change the physical properties, or the joint, of a body."""
    return with_name(name, lambda file: forge_properties(file, change, body))


def frozen(name: str, body: str, *columns: str) -> Fault:
    def fault(file: h5py.File) -> None:
        for column in columns:
            file[f"bodies/{body}/tick/{column}"][...] = file[f"bodies/{body}/tick/{column}"][0]

    return with_name(name, fault)


def of_left_contact(name: str, column: str, change: Callable[[Any], Any]) -> Fault:
    """Change the contact of the left hand that bears most, or slips most."""

    def fault(file: h5py.File) -> None:
        a, most = file["contact/a"][...], file["contact/slip" if column == "slip" else "contact/normal_force"][...]
        row = int(np.where((a >= 16) & (a < 32), most, -1.0).argmax())
        file[f"contact/{column}"][row] = change(file[f"contact/{column}"][row])

    return with_name(name, fault)


def first_contact(file: h5py.File, of_table: bool) -> int:
    """The row of a contact that bears something at the tick."""
    chosen = (file["contact/tick"][...] == FREE_TICK) & ((file["contact/a"][...] >= 16) == of_table)
    return int(np.flatnonzero(chosen)[file["contact/normal_force"][...][chosen].argmax()])


def of_contact(name: str, column: str, change: Callable[[Any], Any], of_table: bool = False) -> Fault:
    """Change what a contact with the hand, or the table, says."""

    def fault(file: h5py.File) -> None:
        row = first_contact(file, of_table)
        file[f"contact/{column}"][row] = change(file[f"contact/{column}"][row])

    return with_name(name, fault)


def too_much_torsion(file: h5py.File) -> None:
    row = first_contact(file, of_table=False)
    file["contact/torsional_moment"][row] = 0.02 * file["contact/normal_force"][row]


def halved_slip(file: h5py.File) -> None:
    """In a tick of several programs."""
    slip = file["contact/slip"][...]
    several = file["hands/right/tick/work/linearisations"][...][file["contact/tick"][...]] > 1
    file["contact/slip"][int(np.where(several, slip, 0.0).argmax())] *= 0.5


def split_contact(file: h5py.File) -> None:
    """One contact as two of half its force at one place."""
    row = first_contact(file, of_table=False)
    for name in ("normal_force", "friction_force", "torsional_moment"):
        file[f"contact/{name}"][row] = 0.5 * file[f"contact/{name}"][row]
    for name in file["contact"]:
        values, attributes = file[f"contact/{name}"][...], dict(file[f"contact/{name}"].attrs)
        del file[f"contact/{name}"]
        file[f"contact/{name}"] = np.insert(values, row, values[row], axis=0)
        file[f"contact/{name}"].attrs.update(attributes)


def given_to_another(file: h5py.File) -> None:
    """What one body bears is given to the next one that bears something: the sum is the same."""
    phalanx = file["hands/right/tick/force/phalanx"][HELD].reshape(15, 3)
    one, other = np.flatnonzero(np.abs(phalanx).any(axis=1))[:2]
    phalanx[[one, other]] = phalanx[[other, one]]
    file["hands/right/tick/force/phalanx"][HELD] = phalanx.reshape(5, 3, 3)


def of_second(name: str, column: str, tick: int, change: Callable[[Any], Any]) -> Fault:
    return at(name, f"{TWO}/{column}", tick, change)


def into_the_hand(file: h5py.File) -> None:
    """The second thing, where its hand's force has it, half a millimetre on."""
    push = file[f"{TWO}/hand_wrench"][HELD, :3]
    file[f"{TWO}/position"][HELD] -= 5e-4 * push / np.linalg.norm(push)


def nudged_together(file: h5py.File) -> None:
    """Both hands by a micrometre, where nothing touches."""
    for name in ("graphic/position", "graphic/joints", "haptic/position"):
        file[f"hands/right/tick/{name}"][AIR] += 1e-6


FAULTS: dict[str, dict[Fault, str]] = {
    "one hand": {
        invented_dataset: AGAIN,
        of_scene("more_ticks", lambda scene: scene.update(ticks=10**400)): "complete",
        excused_forces: AGAIN,
        at("shifted", "hands/right/tick/graphic/position", (HOLD, 0), lambda x: x + 1e-6): "kinematics",
        moved_hand: "non-penetration",
        at("swapped_finger", "hands/right/tick/graphic/flexion", HOLD, lambda row: row[[0, 2, 1, 3, 4]]): "kinematics",
        rotated: "kinematics",
        scaled_force: "force balance",
        force_in_the_air: "complementarity",
        at("wrong_wrench", "hands/right/tick/force/palm_wrench", (HOLD, 4), lambda x: x + 1e-3): "palm wrench",
        not_the_optimum: "force balance",
        wrong_parent: "tree encloses",
        edited_mesh: "cover",
        at("unsealed_mesh", "bodies/cylinder/mesh/vertices", (0, 0), lambda x: x + 1e-9): "checksums",
        attribute("stale_percentile", "summary/right", "tick_cpu_p99", lambda x: x * 0.5): "times",
        over_the_limit: "joint limits",
        repeated_tick: "time",
        short_whole: "times",
        at("spread_finger", "hands/right/tick/graphic/abduction", (HOLD, 1), lambda x: x + 1e-4): "kinematics",
        at("longer_finger", "hands/right/phalanx_length", (1, 2), lambda x: x + 1e-6): "kinematics",
        at("thicker_finger", "hands/right/phalanx_radius", 1, lambda x: x + 1e-6): "non-penetration",
        at("shrunk_sphere", "bodies/cylinder/tree/radius", -1, lambda x: x * 0.9): "cover",
        frozen_hand: "palm wrench",
        tangential_force: "force balance",
        at("claimed_depth", "hands/right/tick/penetration_finger", (HOLD, 1), lambda x: 1e-6): "depth",
        at("shifted_time", "tick/time", ..., lambda x: x + 1.0): "time",
        dropped_palm_sphere: "palm",
        of_scene("wider_margin", lambda scene: scene["solver"].update(margin=2e-3)): AGAIN,
        of_scene("softer_coupling", lambda scene: scene["solver"]["stiffness"].update(rotation=4.0)): "palm wrench",
        of_scene("fewer_fingers", lambda scene: scene["solver"].update(fingers=["thumb", "index"])): "depth",
        deleted_figure: AGAIN,
        attribute("invented_figure", "summary/right", "comfort", lambda x: 0.97): AGAIN,
        deep_between_samples: "non-penetration",
        at(
            "swapped_user_fingers", "hands/right/tick/haptic/flexion", UNMARKED, lambda row: row[[0, 4, 2, 3, 1]]
        ): "force balance",
        at("depth_of_no_number", "hands/right/tick/penetration_finger", (UNMARKED, 3), lambda x: np.nan): "depth",
        at("stamp_of_no_number", "tick/time", UNMARKED, lambda x: np.nan): "time",
        busy_clock: "times",
        at("negative_time", "hands/right/tick/duration/force", UNMARKED, lambda x: -5): "times",
    },
    "two": {
        attribute("stopped", "/", "complete", lambda _: 0): "complete",
        of_left_contact("forged point", "point", lambda x: x + 1e-3): "hand on object",
        of_left_contact("forged force", "normal_force", lambda x: 1.1 * x + 0.01): "hand on object",
        of_left_contact("turned friction", "friction_force", lambda x: -x): "hand on object",
        at("left hand eased", "hands/left/tick/force/total", LATE, lambda x: 0.9 * x): "equal and opposite",
        of_body("lighter", "cube", lambda of: of.update(mass=0.98 * of["mass"])): "Newton",
        of_body("other table", "cube", lambda of: of.update(table=of["table"] - 1e-5)): "table",
        at("thrown", "bodies/cube/tick/velocity", LATE, lambda x: x + 1e-4): "object velocity",
        at("spun", "bodies/cube/tick/angular_velocity", LATE, lambda x: x + 1e-4): "object angular",
        at("floating", "bodies/cube/tick/table_distance", LATE, lambda x: x + 1e-6): "table",
    },
    "door": {
        at("leaf off its hinge", "bodies/leaf/tick/position", ..., lambda x: x + 5e-3): "hinge",
        at("leaf that jumps", "bodies/leaf/tick/position", LATE, lambda x: x + 5e-3): "object velocity",
        of_body("smooth hinge", "leaf", lambda of: of["hinge"].update(friction=0.01)): "hinge",
        of_body("other axis", "leaf", lambda of: of["hinge"].update(axis=[0.0, 0.1, 1.0])): "hinge",
        of_body("other origin", "leaf", lambda of: of["hinge"].update(origin=[0.0, 0.0, 0.0])): "hinge",
        at("helped", "bodies/leaf/tick/hand_wrench", LATE, lambda x: x + 1e-2): "hand on object",
    },
    "laptop": {
        at("other value", "bodies/lid/tick/joint", LATE, lambda x: x + 1e-3): "joints",
        at("lid that jumps", "bodies/lid/tick/position", LATE, lambda x: x + 5e-3): "joints",
        frozen("frozen lid", "lid", "position", "orientation"): "joints",
        at("base that jumps", "bodies/base/tick/position", LATE, lambda x: x + 0.02): "joints",
        of_body("lid beyond its limits", "lid", lambda of: of["joint"].update(limits=[2.2, 2.4])): "joints",
        of_body("lid the other way", "lid", lambda of: of["joint"].update(axis=[1.0, 0.0, 0.0])): "joints",
        of_body("hinge elsewhere", "lid", lambda of: of["joint"].update(origin=[0.0, 0.0, 0.0])): "joints",
        of_body("lid that slides", "lid", lambda of: of["joint"].update(type="slider")): "joints",
    },
    "driven": {at("nudged", "bodies/cube/tick/position", LATE, lambda x: x + 1e-6): AGAIN},
    "fixed": {of_scene("larger_budget", lambda scene: scene["solver"].update(budget=1)): AGAIN},
    "chest": {
        at("lid off the chest", "bodies/lid/tick/position", 5, lambda x: x + 1e-4): "joint",
        at("unequal", "bodies/lid/tick/body_wrench", LATE, lambda x: x + 1e-2): "between bodies",
        at("chest in the tray", "bodies/chest/tick/position", 2, lambda x: x - [0.0, 0.0, 1e-4]): "bodies apart",
    },
    "two at a laptop": {at("lid for nobody", "bodies/lid/tick/orientation", LATE, lambda x: x[[0, 2, 1, 3]]): "joints"},
    "recording": {nudged_together: AGAIN},
    "free on a table": {
        at(
            "pushed_object", "bodies/cylinder/tick/position", FREE_TICK, lambda x: x + (1e-6, 0.0, 0.0)
        ): "object velocity",
        at(
            "faster_object", "bodies/cylinder/tick/velocity", FREE_TICK, lambda x: x + (0.0, 1e-4, 0.0)
        ): "object velocity",
        of_properties("lighter_object", lambda free: free.update(mass=49.0)): "Newton",
        of_properties("stronger_gravity", lambda free: free.update(gravity=[0.0, 0.0, -9.82])): "Newton",
        at("wrong_moment", "bodies/cylinder/tick/table_wrench", (FREE_TICK, 4), lambda x: x + 1e-3): "table on object",
        at("helped_hand", "bodies/cylinder/tick/hand_wrench", (FREE_TICK, 2), lambda x: x + 1e-2): "hand on object",
        of_contact("pushed_harder", "normal_force", lambda x: x * 1.01): "equal and opposite",
        of_properties("smoother_object", lambda free: free.update(friction=0.2)): "friction cones",
        too_much_torsion: "torsion",
        of_contact("pulling_table", "normal_force", lambda x: x * -1.0, of_table=True): "friction cones",
        halved_slip: AGAIN,
        at("friction_along", "contact/friction_force", ..., lambda x: x * -1.0): "hand's balance",
        at("higher_object", "bodies/cylinder/tick/table_distance", FREE_TICK, lambda x: x + 1e-6): "table",
        of_properties("sunken_table", lambda free: free.update(table=free["table"] + 1e-5)): "table",
        of_properties("other_start", lambda free: free.update(velocity=[0.0, 0.0, 1e-3])): "Newton",
        split_contact: AGAIN,
    },
    "halves": {
        of_second("faster", "velocity", AT_REST, lambda x: x + (0.0, 1e-4, 0.0)): "object velocity",
        of_second("spinning", "angular_velocity", AT_REST, lambda x: x + (0.0, 0.0, 1e-4)): "object angular",
        of_second("pulled", "table_wrench", AT_REST, lambda x: x + (1e-3, 0.0, 0.0, 0.0, 0.0, 0.0)): "Newton",
        of_second("twisted", "table_wrench", AT_REST, lambda x: x + (0.0, 0.0, 0.0, 0.0, 0.0, 1e-3)): "Euler",
        of_second("twisted by the hand", "hand_wrench", HELD, lambda x: x + (0.0, 0.0, 0.0, 0.01, 0.0, 0.0)): "Euler",
        of_second("sunken", "position", AT_REST, lambda x: x - (0.0, 0.0, 1e-6)): "table",
        of_second(
            "turned in itself", "body_wrench", AT_REST, lambda x: x + (0.0, 0.0, 0.0, 0.0, 0.0, 1e-3)
        ): "between bodies",
        of_second("helped", "hand_wrench", HELD, lambda x: x + (0.0, 0.0, 1e-3, 0.0, 0.0, 0.0)): "hands on bodies",
        at("of another object", f"{ONE}/hand_wrench", (HELD, 2), lambda x: x + 1e-3): "hand on object",
        given_to_another: AGAIN,
        into_the_hand: "non-penetration",
        with_name("deep_in_the_hand", lambda file: into_the_hand(file)): "depth",
        of_second("overlapping", "position", AT_REST, lambda x: x - (1e-5, 0.0, 0.0)): "bodies apart",
    },
}
"""The check that names each fault, by kinds of results; a walk finds that the second run sees each item changed."""

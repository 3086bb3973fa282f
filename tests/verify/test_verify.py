"""The referee: honest results pass, planted faults are found under their own name, and its own geometry has oracles."""

import json
import os
import shutil
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from short_grasp import short_grasp, short_scene
from stress_motion import random_targets
from verify_document import documented_faults

from hhsim.bench.robustness.random_targets import StressOptions
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel, Side
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.metrics.brute_force_distance import round_cone_distance
from hhsim.metrics.run.force import TREMBLING
from hhsim.motion.trajectory import Trajectory
from hhsim.replay.replay import replay
from hhsim.replay.stored_scene import checksums
from hhsim.replay.verdict import verdict as report_verdict
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import STATIC_COLUMNS
from hhsim.scene.open_scene import open_scene
from hhsim.scene.scene import make_scene
from hhsim.solver.options import SolverOptions
from hhsim.system.checksummed_file import seal_file
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.verify.again import again_claims
from hhsim.verify.claim import FAILS, HOLDS, NOT_CLAIMED, NOT_JUDGED, Claim, judged
from hhsim.verify.contacts import axis_places
from hhsim.verify.force_checks import force_claims
from hhsim.verify.kinematics import own_hand, pose
from hhsim.verify.posture_checks import posture_claims
from hhsim.verify.tick_data import JudgedTicks
from hhsim.verify.verify import Verification, verify

pytest.importorskip("coal", reason="the referee measures with coal: pip install 'hhsim[verify]'")

ALL = os.environ.get("HHSIM_VERIFY_ALL") == "1"
"""All ten objects by both safe methods; without it, the two that differ most."""

HOLD = 200
"""A tick of the hold."""
BEYOND_A_FILE = {"times", "machine and versions", "names"}
"""What no file can show, and every verdict says so."""


def run(folder: Path, name: str = "cylinder", level: int = 2, side: Side = "right", **options: Any) -> Result:
    """A short grasp, described as the command line does."""
    scene = short_scene(short_grasp(hold=0.09), name, level, side)
    path = folder / f"{name}.h5"
    description = {
        "hand_file": None,
        "object": name,
        "object_mesh": load_object(name).mesh.sha256,
        "tree": None,
        "tree_options": asdict(TreeOptions(level=level)),
    }
    replay(scene, SolverOptions(**options), path, description=description)
    return load_result(path)


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return run(tmp_path_factory.mktemp("honest"))


def failing(found: Verification) -> set[str]:
    return {claim.name for claim in found.claims if claim.failed}


def verdict(found: Verification, name: str) -> str:
    return next(claim.verdict for claim in found.claims if claim.name == name)


def test_an_honest_result_holds_in_every_claim(honest: Result) -> None:
    found = verify(honest, every=5)
    assert failing(found) == set()
    assert {claim.name for claim in found.claims if claim.verdict != HOLDS} == {"summary, rest", *BEYOND_A_FILE}
    claims = {claim.name: claim for claim in found.claims}
    assert claims["depth"].worst <= 1e-9
    assert claims["kinematics"].checked == honest.ticks
    assert claims["force balance"].checked >= honest.ticks // 5
    assert all(claim.why for claim in found.claims if claim.verdict == HOLDS and claim.name != "complete")


# Each fault: what is done to the file, what may be said of it, and whether the file's seal is made to fit again.


def shifted(file: h5py.File) -> None:
    file["tick/graphic/position"][HOLD, 0] += 1e-6


def moved_hand(file: h5py.File) -> None:
    """The whole hand a little deeper, joints and all: only the distances can tell."""
    direction = -file["tick/force/total"][HOLD] / np.linalg.norm(file["tick/force/total"][HOLD])
    file["tick/graphic/position"][HOLD] += 5e-6 * direction
    file["tick/graphic/joints"][HOLD] += 5e-6 * direction
    file["tick/force/palm_wrench"][HOLD, :3] += 1000.0 * 5e-6 * direction


def swapped_finger(file: h5py.File) -> None:
    flexion = file["tick/graphic/flexion"]
    row = flexion[HOLD]
    row[[1, 2]] = row[[2, 1]]
    flexion[HOLD] = row


def rotated(file: h5py.File) -> None:
    w, x, y, z = file["tick/graphic/orientation"][HOLD]
    half = 0.5e-4
    file["tick/graphic/orientation"][HOLD] = np.array([w - half * z, x - half * y, y + half * x, z + half * w]) / (
        np.sqrt(1.0 + half * half)
    )


def stretched_quaternion(file: h5py.File) -> None:
    file["tick/graphic/orientation"][HOLD] *= 1.001


def scaled_force(file: h5py.File) -> None:
    for name in ("phalanx", "total"):
        file[f"tick/force/{name}"][...] *= 1.001


def pulling_force(file: h5py.File) -> None:
    file["tick/force/phalanx"][HOLD] *= -1.0
    file["tick/force/total"][HOLD] *= -1.0


def force_in_the_air(file: h5py.File) -> None:
    file["tick/force/phalanx"][0, 1, 2] = (0.0, 0.0, 0.5)
    file["tick/force/total"][0] += (0.0, 0.0, 0.5)


def wrong_wrench(file: h5py.File) -> None:
    file["tick/force/palm_wrench"][HOLD, 4] += 1e-3


def wrong_fingertip(file: h5py.File) -> None:
    file["tick/force/fingertip_normal"][HOLD] *= 1.01


def not_the_optimum(file: h5py.File) -> None:
    """The user's hand was elsewhere than the file says, and the wrench is made to fit."""
    file["tick/haptic/position"][HOLD] += (0.0, 0.0, 1e-4)
    file["tick/force/palm_wrench"][HOLD, 2] -= 1000.0 * 1e-4


def missing_sphere(file: h5py.File) -> None:
    tree = file["object/tree"]
    last = tree["level"][...].max()
    leaf = int(np.flatnonzero(tree["level"][...] == last)[0])
    for name in ("center", "radius", "level", "parent"):
        kept = np.delete(tree[name][...], leaf, axis=0)
        attributes = dict(tree[name].attrs)
        del tree[name]
        tree[name] = kept
        tree[name].attrs.update(attributes)


def wrong_parent(file: h5py.File) -> None:
    """A leaf becomes the child of the sphere that is farthest from it: a walk would miss it."""
    tree = file["object/tree"]
    away = np.linalg.norm(tree["center"][...] - tree["center"][-1], axis=1)
    above = np.flatnonzero(tree["level"][...] == tree["level"][-1] - 1)
    tree["parent"][-1] = above[away[above].argmax()]


def edited_mesh(file: h5py.File) -> None:
    vertices = file["object/vertices"]
    outward = vertices[0] - vertices[...].mean(axis=0)
    vertices[0] = vertices[0] + 0.005 * outward / np.linalg.norm(outward)


def unsealed_mesh(file: h5py.File) -> None:
    file["object/vertices"][0, 0] += 1e-9


def stale_metric(file: h5py.File) -> None:
    file["summary"].attrs["force_hold_mean"] *= 1.01


def stale_percentile(file: h5py.File) -> None:
    file["summary"].attrs["tick_cpu_p99"] *= 0.5


def stale_variation(file: h5py.File) -> None:
    file["tick/force_variation_rate"][120] *= 1.1


def over_the_limit(file: h5py.File) -> None:
    """An angle beyond its limit, and the joints that belong to it."""
    file["tick/graphic/flexion"][HOLD, 1, 2] = file["hand/flexion_max"][1, 2] + 1e-3


def wrong_phase(file: h5py.File) -> None:
    file["phase/first_tick"][2] -= 40
    file["phase/last_tick"][1] -= 40


def overlapping_phase(file: h5py.File) -> None:
    file["phase/first_tick"][2] -= 10


def repeated_tick(file: h5py.File) -> None:
    def repeat(_: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            item[120] = item[119]

    file["tick"].visititems(repeat)


def older_sample(file: h5py.File) -> None:
    file["tick/input_seq"][120] = 3


def short_whole(file: h5py.File) -> None:
    file["tick/duration/total"][120] = file["tick/duration/detect"][120] - 1


def less_work(file: h5py.File) -> None:
    file["tick/work/units"][HOLD] //= 2


def silent_lag(file: h5py.File) -> None:
    file["tick/lag"][HOLD] = 1e-4


def uncounted_pair(file: h5py.File) -> None:
    file["tick/contacts/touching"][HOLD] -= 1


def false_stuck(file: h5py.File) -> None:
    """A tick that moved says that it was stuck, and so excuses itself from being an optimum."""
    file["tick/status"][120] = 1


def strange_status(file: h5py.File) -> None:
    file["tick/status"][120] = 64


def spread_finger(file: h5py.File) -> None:
    file["tick/graphic/abduction"][HOLD, 1] += 1e-4


def longer_finger(file: h5py.File) -> None:
    file["hand/phalanx_length"][1, 2] += 1e-6


def thicker_finger(file: h5py.File) -> None:
    file["hand/phalanx_radius"][1] += 1e-6


def moved_sphere(file: h5py.File) -> None:
    """The leaf that the hand touches, a micrometre nearer to it."""
    tree = file["object/tree"]
    leaf = np.flatnonzero(tree["level"][...] == tree["level"][...].max())
    tip = file["tick/graphic/joints"][HOLD, 1, 3]
    away = np.linalg.norm(tree["center"][...][leaf] - tip, axis=1) - tree["radius"][...][leaf]
    chosen = leaf[away.argmin()]
    toward = tip - tree["center"][chosen]
    tree["center"][chosen] += 1e-6 * toward / np.linalg.norm(toward)


def shrunk_sphere(file: h5py.File) -> None:
    file["object/tree/radius"][-1] *= 0.9


def slower_clock(file: h5py.File) -> None:
    file["tick/time"][...] *= 1.001


def frozen_hand(file: h5py.File) -> None:
    """A tick of the grasp shows the hand of the tick before, and all that follows from it."""
    for name in ("position", "orientation", "flexion", "abduction", "joints"):
        file[f"tick/graphic/{name}"][120] = file[f"tick/graphic/{name}"][119]


def swapped_forces(file: h5py.File) -> None:
    """What the index finger felt is given to the middle finger."""
    phalanx = file["tick/force/phalanx"]
    row = phalanx[HOLD]
    row[[1, 2]] = row[[2, 1]]
    phalanx[HOLD] = row


def tangential_force(file: h5py.File) -> None:
    """Friction, which nobody modelled, on the phalanx that bears most."""
    row = file["tick/force/phalanx"][HOLD]
    f, k = divmod(int(np.linalg.norm(row, axis=2).argmax()), 3)
    across = np.cross(row[f, k], [0.3, -0.5, 0.8])
    row[f, k] += 0.01 * across
    file["tick/force/phalanx"][HOLD] = row
    file["tick/force/total"][HOLD] += 0.01 * across


def claimed_depth(file: h5py.File) -> None:
    file["tick/penetration_finger"][HOLD, 1] = 1e-6


def not_a_number(file: h5py.File) -> None:
    file["tick/haptic/flexion"][HOLD, 1, 1] = np.nan


def vanished_figure(file: h5py.File) -> None:
    file["summary"].attrs["penetration_max"] = 1e-6


def smoothed_variation(file: h5py.File) -> None:
    file["tick/force_variation_finger"][120:125] = 0.0


def halved_candidates(file: h5py.File) -> None:
    file["tick/contacts/candidates"][...] //= 2
    file["summary"].attrs["candidates_max"] = float(file["tick/contacts/candidates"][...].max())


def fewer_bodies(file: h5py.File) -> None:
    file["tick/work/bodies"][HOLD + 1] -= 1


def shifted_time(file: h5py.File) -> None:
    file["tick/time"][...] += 1.0


def stretched_time(file: h5py.File) -> None:
    file["tick/time"][...] *= 2.0
    forge_scene(file, lambda scene: scene.update(rate=500.0))


def slightly_shrunk_sphere(file: h5py.File) -> None:
    file["object/tree/radius"][-1] -= 1e-6


def pushed_vertex(file: h5py.File) -> None:
    vertices = file["object/vertices"]
    inward = vertices[...].mean(axis=0) - vertices[0]
    vertices[0] = vertices[0] + 0.001 * inward / np.linalg.norm(inward)


def dropped_palm_sphere(file: h5py.File) -> None:
    """From the palm that collides, and from its tree."""
    level = file["hand/palm_tree/level"][...]
    drop(file["hand"], ("palm_center", "palm_radius"), 0)
    drop(file["hand/palm_tree"], ("center", "radius", "level", "parent"), int(np.argmax(level == level.max())))
    forge_scene(file, lambda scene: scene["hand"].update(palm_spheres=scene["hand"]["palm_spheres"] - 1))


def loose_palm_sphere(file: h5py.File) -> None:
    drop(file["hand"], ("palm_center", "palm_radius"), 0)


def wider_margin(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"].update(margin=2e-3))


def narrower_margin(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"].update(margin=5e-4))


def fewer_linearisations(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"].update(linearisations=1))


def softer_coupling(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"]["stiffness"].update(rotation=4.0))


def wider_touch(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"].update(touch=1e-3))


def other_force_model(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"].update(force="paper"))


def fewer_fingers(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene["solver"].update(fingers=["thumb", "index"]))


def deleted_figure(file: h5py.File) -> None:
    del file["summary"].attrs["tracking_excess"]


def deleted_tremor(file: h5py.File) -> None:
    del file["summary"].attrs[TREMBLING]


def moved_in_the_air(file: h5py.File) -> None:
    """A user's hand that was elsewhere in the approach, and the wrench that follows."""
    file["tick/haptic/position"][5, 0] += 1e-6
    file["tick/force/palm_wrench"][5, 0] -= 1e-3


def forge_scene(file: h5py.File, change: Callable[[dict[str, Any]], object]) -> None:
    scene = json.loads(file.attrs["scene"])
    change(scene)
    file.attrs["scene"] = json.dumps(scene)


def drop(group: h5py.Group, names: tuple[str, ...], row: int) -> None:
    for name in names:
        kept, attributes = np.delete(group[name][...], row, axis=0), dict(group[name].attrs)
        del group[name]
        group[name] = kept
        group[name].attrs.update(attributes)


def renamed_method(file: h5py.File) -> None:
    """A coupled run that says it is of another method, of which less is claimed."""
    forge_scene(file, lambda scene: scene["solver"].update(method="progressive"))


FAULTS: dict[Callable[[h5py.File], None], str] = {
    shifted: "kinematics",
    moved_hand: "non-penetration",
    swapped_finger: "kinematics",
    rotated: "kinematics",
    stretched_quaternion: "unit quaternions",
    scaled_force: "force balance",
    pulling_force: "force balance",
    force_in_the_air: "complementarity",
    wrong_wrench: "palm wrench",
    wrong_fingertip: "fingertips",
    not_the_optimum: "stationarity",
    missing_sphere: "cover",
    wrong_parent: "tree encloses",
    edited_mesh: "cover",
    unsealed_mesh: "checksums",
    stale_metric: "summary",
    stale_percentile: "summary",
    stale_variation: "force variation",
    over_the_limit: "joint limits",
    wrong_phase: "summary",
    overlapping_phase: "phases",
    repeated_tick: "time",
    older_sample: "input",
    short_whole: "durations",
    less_work: "work",
    silent_lag: "lag",
    uncounted_pair: "touching pairs",
    false_stuck: "stuck ticks",
    strange_status: "status",
    spread_finger: "kinematics",
    longer_finger: "kinematics",
    thicker_finger: "non-penetration",
    moved_sphere: "non-penetration",
    shrunk_sphere: "cover",
    slower_clock: "time",
    frozen_hand: "palm wrench",
    swapped_forces: "force balance",
    tangential_force: "force balance",
    claimed_depth: "depth",
    not_a_number: "input",
    vanished_figure: "summary",
    smoothed_variation: "finger variation",
    halved_candidates: "candidates",
    fewer_bodies: "candidates",
    shifted_time: "time",
    stretched_time: "time",
    slightly_shrunk_sphere: "tree",
    pushed_vertex: "object",
    dropped_palm_sphere: "palm",
    loose_palm_sphere: "palm",
    wider_margin: "candidates",
    narrower_margin: "candidates",
    fewer_linearisations: "work",
    softer_coupling: "palm wrench",
    wider_touch: "touching pairs",
    other_force_model: "Eq. 14",
    fewer_fingers: "depth",
    deleted_figure: "summary",
    deleted_tremor: "summary",
    moved_in_the_air: "free hand",
    renamed_method: "durations",
}
SEALED = {missing_sphere, wrong_parent, edited_mesh, longer_finger, thicker_finger, moved_sphere, shrunk_sphere}
SEALED |= {slightly_shrunk_sphere, pushed_vertex, dropped_palm_sphere, loose_palm_sphere}
"""Faults whose forger also made the checksums fit."""
EVERYWHERE = {scaled_force, longer_finger, thicker_finger, slower_clock, smoothed_variation}
EVERYWHERE |= {moved_sphere, halved_candidates, shifted_time, stretched_time, wider_margin, narrower_margin}
EVERYWHERE |= {fewer_linearisations, softer_coupling, wider_touch, other_force_model, fewer_fingers, moved_in_the_air}
EVERYWHERE |= {fewer_bodies, renamed_method}
"""Faults of more than one tick."""


def planted(source: Path, folder: Path, fault: Callable[[h5py.File], None]) -> Result:
    path = folder / "planted.h5"
    shutil.copy(source, path)
    with h5py.File(path, "r+") as file:
        fault(file)
        if fault in SEALED:
            static = {column.name: file[column.name][...] for column in STATIC_COLUMNS}
            forge_scene(file, lambda scene: scene.update(checksums=checksums(static)))
    # A forger seals the file anew.
    seal_file(path, path.stat().st_size)
    return load_result(path)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_a_planted_fault_is_found_by_name(honest: Result, tmp_path: Path, fault: Callable[[h5py.File], None]) -> None:
    found = verify(planted(honest.path, tmp_path, fault), every=40)
    assert FAULTS[fault] in failing(found)
    claim = next(claim for claim in found.claims if claim.name == FAULTS[fault])
    assert claim.worst > claim.tolerance
    if claim.tick is not None and fault not in EVERYWHERE:
        assert claim.tick in (0, 119, 120, 121, HOLD)
    if fault in SEALED:
        assert "checksums" not in failing(found)


@pytest.fixture(scope="module")
def on_mesh(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return run(tmp_path_factory.mktemp("mesh"), surface="mesh")


def test_a_hand_that_is_on_its_way_on_the_mesh(tmp_path: Path) -> None:
    hand = HandModel.default()
    moved = random_targets(hand, 900, 5)
    names = ("position", "orientation", "flexion", "abduction")
    motion = Trajectory(time=np.arange(900) / 1000.0, **{name: getattr(moved, name) for name in names})
    base = open_scene("cube", "touch", level=3)
    scene = make_scene(base.mesh, base.tree, hand, motion)
    for method in ("coupled", "progressive"):
        replay(scene, SolverOptions(method=method, surface="mesh"), tmp_path / "way.h5")
        result = load_result(tmp_path / "way.h5")
        assert (np.asarray(result["status"]) & 2 > 0).sum() > 300
        assert failing(verify(result, every=9)) == set()

        def aside(file: h5py.File) -> None:
            force, late = file["tick/force/phalanx"], np.flatnonzero(file["tick/status"][...] & 2)
            size = np.abs(force[...]).sum(axis=(1, 2, 3))
            looked_at = late[late % 9 == 0]
            tick = looked_at[size[looked_at].argmax()]
            finger, phalanx = divmod(int(np.linalg.norm(force[tick], axis=2).argmax()), 3)
            force[tick, finger, phalanx] = np.roll(force[tick, finger, phalanx], 1)

        assert "force balance" in failing(verify(planted(result.path, tmp_path, aside), every=9))


def touched_spheres(file: h5py.File) -> None:
    """The run is said to have touched spheres."""
    forge_scene(file, lambda scene: scene["solver"].update(surface="spheres"))


ON_MESH = [moved_hand, scaled_force, force_in_the_air, not_the_optimum, uncounted_pair, thicker_finger, swapped_forces]
ON_MESH += [tangential_force, claimed_depth, fewer_bodies, wider_margin, wider_touch, renamed_method]
"""Faults that geometry finds: of a run on the mesh by distances to its triangles, under the same names."""


def test_an_honest_result_on_the_mesh_holds_in_every_claim(on_mesh: Result) -> None:
    found = verify(on_mesh, every=10, again=True)
    assert failing(found) == set()
    for name in (
        "depth",
        "non-penetration",
        "touching pairs",
        "candidates",
        "distance by coal",
        "mesh",
        "stationarity",
    ):
        assert verdict(found, name) == HOLDS
    assert np.isnan(found.sphere_penetration) and found.mesh_penetration == 0.0
    # A force is borne within a micrometre of the mesh, or what bears it does not touch.
    assert on_mesh.scene["solver"]["touch"] == 1e-6 >= on_mesh.summary["contact_error_max"]
    bears = next(claim for claim in found.claims if claim.name == "complementarity")
    assert bears.verdict == HOLDS and bears.checked > 0
    assert on_mesh.summary["force_contact_max"] > 1.0


@pytest.mark.parametrize("fault", [*ON_MESH, touched_spheres], ids=lambda fault: fault.__name__)
def test_a_planted_fault_of_a_run_on_the_mesh(
    on_mesh: Result, tmp_path: Path, fault: Callable[[h5py.File], None]
) -> None:
    found = verify(planted(on_mesh.path, tmp_path, fault), every=40)
    assert FAULTS.get(fault, "non-penetration") in failing(found)


def test_the_documentation_lists_what_is_planted(repository: Path) -> None:
    assert documented_faults(repository, 0) == {fault.__name__: claim for fault, claim in FAULTS.items()}


# Faults that no cheap claim can know of: what the input gives when it is run again.


def reversed_approach(file: h5py.File) -> None:
    """All that ticks 5 to 24 hold is there, the other way round, but for their times and their samples' numbers."""

    def turn(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and name not in ("time", "input_seq"):
            item[5:25] = item[5:25][::-1]

    file["tick"].visititems(turn)


def swapped_ticks(file: h5py.File) -> None:
    def swap(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and name not in ("time", "input_seq"):
            item[10:12] = item[10:12][::-1]

    file["tick"].visititems(swap)


def wholly_stretched_time(file: h5py.File) -> None:
    """Half the rate, in all that says so."""
    file["tick/time"][...] *= 2.0
    forge_scene(file, lambda scene: (scene.update(rate=500.0), scene["solver"].update(period=2e-3)))


def edited_tremor(file: h5py.File) -> None:
    file["summary"].attrs[TREMBLING] *= 0.5


def edited_tracking(file: h5py.File) -> None:
    file["summary"].attrs["tracking_excess"] = 0.01


def option(name: str, value: float) -> Callable[[h5py.File], None]:
    def changed(file: h5py.File) -> None:
        forge_scene(file, lambda scene: scene["solver"].update({name: value}))

    changed.__name__ = f"changed_{name}"
    return changed


def another_motion(file: h5py.File) -> None:
    forge_scene(file, lambda scene: scene.update(trajectory="pinch"))


AGAIN: dict[Callable[[h5py.File], None], str] = {
    reversed_approach: "again: motion",
    swapped_ticks: "again: motion",
    wholly_stretched_time: "again: motion",
    another_motion: "again: motion",
    edited_tremor: "again: figures",
    edited_tracking: "again: figures",
    less_work: "again: ticks",
    renamed_method: "again: ticks",
    option("skin", 1e-3): "again: ticks",
    option("offset", 1e-6): "again: ticks",
    option("step_tolerance", 1e-5): "again: ticks",
}
"""By the claim of a second run that finds it."""


@pytest.fixture(scope="module")
def named(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A run whose object and motion are in the catalogue."""
    path = tmp_path_factory.mktemp("named") / "touch.h5"
    scene = open_scene("cylinder", "touch", level=2)
    replay(scene, SolverOptions(), path, description={**scene.description, "hand_file": None})
    return load_result(path)


def run_anew(result: Result) -> dict[str, Claim]:
    return {claim.name: claim for claim in again_claims(result, lambda what, done, total: None)}


def test_an_honest_input_gives_the_same_again(named: Result) -> None:
    found = verify(named, every=500, again=True)
    assert failing(found) == set()
    assert {name: verdict(found, name) for name in ("again: motion", "again: ticks", "again: figures", "object")} == {
        "again: motion": HOLDS, "again: ticks": HOLDS, "again: figures": HOLDS, "object": HOLDS
    }  # fmt: skip


@pytest.mark.parametrize("fault", AGAIN, ids=lambda fault: fault.__name__)
def test_what_the_input_does_not_give_again_is_found(
    named: Result, tmp_path: Path, fault: Callable[[h5py.File], None]
) -> None:
    assert run_anew(planted(named.path, tmp_path, fault))[AGAIN[fault]].failed


def test_a_result_of_another_machine_is_not_judged_by_its_bits(named: Result, tmp_path: Path) -> None:
    def elsewhere(file: h5py.File) -> None:
        less_work(file)
        file.attrs["machine"] = json.dumps({**named.machine, "cpu": "another processor"})

    claim = run_anew(planted(named.path, tmp_path, elsewhere))["again: ticks"]
    assert claim.verdict == NOT_JUDGED
    assert "work/units differ, from tick 200 on" in claim.note and "another processor" in claim.note


@pytest.fixture(scope="module")
def lagging(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A run whose ticks may make one step."""
    result = run(tmp_path_factory.mktemp("lagging"), budget=1)
    assert (result["status"] & 2 > 0).sum() > 10, "nothing lags: the test shows nothing"
    return result


def test_a_lag_that_is_left_out_is_found(lagging: Result, tmp_path: Path) -> None:
    def unflagged(file: h5py.File) -> None:
        status = file["tick/status"]
        status[...] = status[...] & ~2
        file["tick/lag"][...] = 0.0
        file["summary"].attrs.update(lag_ticks=0.0, lag_max=0.0)

    def understated(file: h5py.File) -> None:
        file["tick/lag"][...] *= 0.5
        file["summary"].attrs["lag_max"] *= 0.5

    assert {"palm balance", "free hand"} & failing(verify(planted(lagging.path, tmp_path, unflagged), every=40))
    assert run_anew(planted(lagging.path, tmp_path, understated))["again: ticks"].failed


def test_an_assumed_solid_is_named_with_what_is_outside_of_it(honest: Result, tmp_path: Path) -> None:
    said = "the guarantee is of the assumed solid: 3 % of the surface, up to 0.4 mm, lies outside it"

    def assumed(file: h5py.File) -> None:
        forge_scene(file, lambda scene: scene.update(object_repairs=["turned 1 triangle to face outward", said]))

    result = planted(honest.path, tmp_path, assumed)
    mesh = next(claim for claim in verify(result, every=100).claims if claim.name == "mesh")
    assert (mesh.verdict, mesh.note) == (HOLDS, said)
    assert f"T{said[1:]}." in report_verdict(result, ()).sentences


def test_a_depth_set_to_zero_where_the_hand_penetrates_is_found(tmp_path: Path) -> None:
    """Method paper goes in, and says so: its depth is right, until it is set to zero."""
    deep = run(tmp_path, level=3, method="paper")
    assert deep["penetration_depth"].max() > 1e-8
    found = verify(deep, every=5)
    assert failing(found) == set()
    assert verdict(found, "depth") == HOLDS
    assert verdict(found, "Eq. 14") == HOLDS
    assert next(claim.checked for claim in found.claims if claim.name == "Eq. 14") > 10
    assert verdict(found, "non-penetration") == NOT_CLAIMED
    assert found.sphere_penetration == pytest.approx(deep["penetration_depth"].max(), rel=1e-6)
    assert "µm" in next(claim.note for claim in found.claims if claim.name == "non-penetration")

    def zeroed(file: h5py.File) -> None:
        for name in ("depth", "palm", "finger"):
            file[f"tick/penetration_{name}"][...] = 0.0
        file["summary"].attrs["penetration_max"] = 0.0

    assert failing(verify(planted(deep.path, tmp_path, zeroed), every=5)) == {"depth"}


@pytest.mark.parametrize(
    "options",
    [
        {"method": "progressive"},
        {"force": "paper"},
        {"method": "penalty"},
        {"fingers": ("thumb", "index")},
        {"budget": 1},
        {"side": "left"},
    ],
    ids=str,
)
def test_other_options_hold_too(tmp_path: Path, options: dict[str, Any]) -> None:
    result = run(tmp_path, **options)
    found = verify(result, every=5)
    assert failing(found) == set()
    if "budget" in options:
        assert (result["status"] & 2).any(), "nothing lags: the test shows nothing"
    if options.get("method") == "penalty":
        assert verdict(found, "forces") == NOT_JUDGED


@pytest.fixture(scope="module", params=["coupled", "progressive"])
def stuck(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Result:
    """Hands that jump through a ball, one linearisation a tick: some ticks find no step that stays outside."""
    hand, mesh, options = HandModel.default(), load_object("sphere").mesh, TreeOptions(level=2)
    motion = random_targets(hand, 400, 1, StressOptions(hold=20, bound="none", position_spread=0.04))
    trajectory = Trajectory(np.linspace(0.0, 0.399, 400), *motion, name="jumps")
    scene = make_scene(mesh, cached_sphere_tree(mesh, options), hand, trajectory)
    path = tmp_path_factory.mktemp("stuck") / "stuck.h5"
    description = {"hand_file": None, "tree": None, "tree_options": asdict(options)}
    replay(scene, SolverOptions(method=request.param, linearisations=1), path, description=description)
    return load_result(path)


def test_a_run_that_really_gets_stuck_holds(stuck: Result) -> None:
    ticks = np.flatnonzero(stuck["status"] & 1)
    assert len(ticks) >= 5, "nothing is stuck: the test shows nothing"
    assert np.abs(stuck["force/total"][ticks]).max() > 0.1, "a stuck hand bears nothing: the test shows little"
    found = verify(stuck, every=20)
    assert failing(found) == set()
    claims = {claim.name: claim for claim in found.claims}
    for name in ("stuck ticks", "stuck forces"):
        assert (claims[name].verdict, claims[name].checked) == (HOLDS, len(ticks[ticks > 0]))


@pytest.mark.parametrize(
    ("column", "claim"), [("graphic/joints", "stuck ticks"), ("force/phalanx", "stuck forces"), ("lag", "lag")]
)
def test_a_stuck_tick_that_moved_or_felt_otherwise_is_found(
    stuck: Result, tmp_path: Path, column: str, claim: str
) -> None:
    tick = int(np.flatnonzero(stuck["status"] & 1)[-1])

    def forged(file: h5py.File) -> None:
        if column == "graphic/joints":
            file["tick/graphic/position"][tick, 0] += 1e-6
            file["tick/graphic/joints"][tick, ..., 0] += 1e-6
        elif column == "force/phalanx":
            file["tick/force/phalanx"][tick, 1, 2] += (0.0, 0.0, 1e-3)
        else:
            file["tick/lag"][tick] += 1.0

    judge = JudgedTicks(planted(stuck.path, tmp_path, forged), np.array([0]))
    claims = {item.name: item for item in [*posture_claims(judge), *force_claims(judge)]}
    assert claims[claim].failed
    assert claims[claim].tick in (tick, tick + 1)


CASES = [
    (name, method)
    for name in (object_names() if ALL else ("sphere", "cup"))
    for method in ("coupled", "progressive")
    if ALL or (name, method) != ("sphere", "progressive")
]


@pytest.mark.parametrize(("name", "method"), CASES)
def test_verify_agrees_with_the_replay(tmp_path: Path, name: str, method: str) -> None:
    found = verify(run(tmp_path, name, level=3, method=method), every=2 if ALL else 10)
    assert failing(found) == set()
    depth = next(claim for claim in found.claims if claim.name == "depth")
    assert depth.worst <= 1e-9
    assert verdict(found, "mesh") == HOLDS
    assert found.mesh_penetration == 0.0


@given(st.integers(0, 2**32 - 1))
def test_a_place_on_the_axis_is_the_nearest(seed: int) -> None:
    """Against the case table of the round cone, another derivation."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 3))
    big = float(rng.uniform(0.05, 0.4))
    small = float(rng.uniform(max(0.01, big - 0.9 * float(np.linalg.norm(b - a))), big))
    points = rng.normal(size=(20, 3)) * 2.0
    ends = np.tile(a, (20, 1)), np.tile(b, (20, 1))
    place, radius = axis_places(*ends, np.full(20, big), np.full(20, small), points)
    found = np.linalg.norm(place - points, axis=1) - radius
    assert np.allclose(found, round_cone_distance(points, a, b, big, small), atol=1e-12)


def test_own_kinematics_are_those_of_the_hand_for_any_angles(honest: Result) -> None:
    rng = np.random.default_rng(3)
    orientation = rng.normal(size=(50, 4))
    orientation /= np.linalg.norm(orientation, axis=1, keepdims=True)
    at = HandConfiguration(rng.normal(size=(50, 3)), orientation, rng.normal(size=(50, 5, 3)), rng.normal(size=(50, 5)))
    joints = pose(own_hand(honest), at).joints
    hand = HandModel.default()
    expected = np.array([hand.joints(*(values[i] for values in at)) for i in range(50)])
    assert np.abs(joints - expected).max() < 1e-12


def test_a_verdict_counts_what_is_not_a_number_as_wrong() -> None:
    assert judged("a", "b", [0.0, np.nan], 1.0, "m", "w").verdict == FAILS
    assert judged("a", "b", [0.0, 1.0], 1.0, "m", "w").verdict == HOLDS
    found = judged("a", "b", [2.0, 3.0], [1.0, 10.0], "m", "w", ticks=[7, 9])
    assert (found.verdict, found.tick, found.worst) == (FAILS, 7, 2.0)
    assert judged("a", "b", [], 1.0, "m", "w").verdict == NOT_JUDGED


def test_without_coal_it_says_what_to_install(honest: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "coal", None)
    with pytest.raises(InputError, match=r"pip install 'hhsim\[verify\]'"):
        verify(honest)


def test_the_command_tells_its_verdict_and_exit_code(honest: Result, tmp_path: Path, run: Callable[..., Any]) -> None:
    answer = run("verify", str(honest.path), "--every", "40")
    assert answer.code == 0
    assert "every claim that could be judged holds" in answer.out
    bad = planted(honest.path, tmp_path, wrong_wrench).path
    answer = run("verify", str(bad), "--every", "40", "--json")
    assert answer.code == 1
    document = json.loads(answer.out)
    assert not document["passed"]
    claim = next(claim for claim in document["claims"] if claim["name"] == "palm wrench")
    assert (claim["verdict"], claim["tick"]) == (FAILS, HOLD)
    assert "FALSE: palm wrench" in run("verify", str(bad), "--every", "40").out
    assert run("verify", str(tmp_path / "none.h5")).code == 2
    assert run("verify", str(bad), "--quiet") == (1, "", "")


def test_a_run_that_was_stopped_is_judged_by_its_ticks(honest: Result, tmp_path: Path) -> None:
    def stopped(file: h5py.File) -> None:
        file.attrs["complete"] = 0

    found = verify(planted(honest.path, tmp_path, stopped), every=40)
    assert failing(found) == set()
    assert verdict(found, "complete") == NOT_CLAIMED

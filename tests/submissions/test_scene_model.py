"""MJCF of a scene of several bodies: MuJoCo has masses, joints, meshes and poses where hhsim has them."""

import csv
import json
import math
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
from body_tables import TABLE, body, body_file, joint
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel, Side
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.round_cone import cone_slope
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.engine_scene import engine_scene
from hhsim.scene.scene import Scene, open_scene
from hhsim.solver.options import SolverOptions
from hhsim.submissions.hand_mjcf import BODIES, JOINTS, STEP, capsules, hand_mjcf, joint_angles
from hhsim.submissions.scene_folder import scene_digest, write_scene_folder

needs_mujoco = pytest.mark.skipif(find_spec("mujoco") is None, reason="pip install 'hhsim[mjcf]' brings mujoco")
SINGLE = 1e-6
"""Bound of distances [m] of vertices, of which MuJoCo keeps 32 bits."""


def flap(name: str = "flap", friction: float = 2.0) -> str:
    slider = joint("slider", [0.0, 0.0, 1.0], friction=friction)
    return body(name, [0.02, 0.02, 0.02], position=[0.6, 0.0, 0.2], joint=slider)


def tray(end: float) -> str:
    """A driven body that goes so far [m]."""
    slider = joint("slider", [1.0, 0.0, 0.0], limits=[0.0, 0.1], motion=[[0.0, 0.0], [1.0, end]])
    return body("tray", [0.02, 0.02, 0.02], position=[1.0, 0.0, 0.2], joint=slider)


def wall(x: float) -> str:
    return body("wall", mesh="cup", position=[x, 0.0, 0.1], fixed=True)


STILL = joint("hinge", [0.0, 0.0, 1.0], limits=[0.0, 0.0])
STUCK = body("stuck", [0.02, 0.02, 0.02], position=[0.8, 0.0, 0.2], joint=STILL)
HINGE = joint("hinge", [0.0, 3.0, 4.0], origin=[0.02, 0.0, 0.0], on="base")
SLIDER = joint("slider", [-1.0, 0.0, 0.0], limits=[-0.02, 0.0], on="link")
OWN = (
    TABLE,
    body("link", [0.03, 0.02, 0.02], position=[0.04, 0.0, 0.0], mass=0.2, torsion=0.002, joint=HINGE),
    body("base", [0.03, 0.04, 0.05], position=[0.0, 0.0, 0.1], density=2000.0, friction=0.3),
    body("tip", [0.01, 0.01, 0.02], position=[0.03, 0.0, 0.0], orientation=[0.8, 0.0, 0.6, 0.0], joint=SLIDER),
    wall(0.4),
    flap(),
    STUCK,
)
"""Bodies on joints of each other, in no order, and one whose joint lets it go nowhere."""


def own_scene(folder: Path, *tables: str) -> Scene:
    return open_scene(body_file(folder, *(tables or OWN)), "never", solid=False, level=1, rate=200.0)


class Model:
    """Model and data of MuJoCo, at the first tick."""

    def __init__(self, folder: Path) -> None:
        self.mujoco = pytest.importorskip("mujoco")
        self.model = self.mujoco.MjModel.from_xml_path(str(folder / "scene.xml"))
        self.data = self.mujoco.MjData(self.model)
        self.mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self.forward()

    def forward(self) -> None:
        self.mujoco.mj_forward(self.model, self.data)

    def vertices(self, name: str) -> FloatArray:
        """Vertices of a body's mesh [m], world."""
        model, geom = self.model, self.data.geom(name)
        mesh = model.geom_dataid[geom.id]
        first = model.mesh_vertadr[mesh]
        own = model.mesh_vert[first : first + model.mesh_vertnum[mesh]].astype(np.float64)
        return np.asarray(own @ geom.xmat.reshape(3, 3).T + geom.xpos)

    def inertia(self, name: str) -> FloatArray:
        """Inertia about the centre of mass [kg·m²], axes of the body, in which all frames are the world's at first."""
        turn = self.data.body(name).ximat.reshape(3, 3)
        return np.asarray(turn @ np.diag(self.model.body(name).inertia) @ turn.T)


def same_points(found: FloatArray, wanted: FloatArray) -> None:
    """Every point has one of the others at its place."""
    for one, other in ((found, wanted), (wanted, found)):
        assert np.max(cKDTree(one).query(other)[0]) < SINGLE


def rotation(orientation: FloatArray) -> Rotation:
    w, *xyz = orientation
    return Rotation.from_quat([*xyz, w])


def turned(points: FloatArray, position: FloatArray, orientation: FloatArray) -> FloatArray:
    return np.asarray(rotation(orientation).apply(points) + position)


@pytest.fixture(
    scope="module", params=[("drawer", "shut"), ("door", "swing"), ("chest", "lift")], ids=lambda names: names[0]
)
def replayed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Scene, Path, Result]:
    """A scene, its folder, and the result of its run."""
    folder = tmp_path_factory.mktemp("bodies")
    scene = open_scene(*request.param, level=1, rate=250.0)
    digest = write_scene_folder(scene, folder / "s")
    replay_scene(scene, SolverOptions(surface="mesh"), folder / "r.h5")
    # A run sets the poses of bodies, which are no part of the scene.
    assert scene_digest(scene) == digest
    return scene, folder / "s", load_result(folder / "r.h5")


@pytest.mark.quick("drawer")
def test_a_joint_of_the_model_moves_a_body_as_a_run_of_hhsim_does(replayed: tuple[Scene, Path, Result]) -> None:
    scene, folder, result = replayed
    at, parts = Model(folder), engine_scene(scene).parts
    joints = {body.name: body.free_joint for body in scene.solids if body.free_joint}
    ((moving, joint),) = joints.items()
    moved = []
    recorded = part_poses(folder, tuple(parts.driven))[1] if parts.driven else np.zeros((result.ticks, 0, 7))
    for tick in (0, result.ticks // 2, int(0.75 * result.ticks), result.ticks - 1):
        poses = {
            name: [result.bodies[name][what][tick] for what in ("position", "orientation")] for name in parts.names
        }
        for name, pose in zip(parts.driven, recorded[tick]):
            which = at.model.body(name).mocapid[0]
            at.data.mocap_pos[which], at.data.mocap_quat[which] = pose[:3], pose[3:]
        for name, (position, orientation) in poses.items():
            if name == moving:
                place, turn = poses[joint.on]
                back = rotation(turn).inv()
                angle = (back * rotation(orientation)).as_rotvec() @ joint.direction
                way = back.apply(position - place) @ joint.direction
                moved.append(angle if joint.type == "hinge" else way)
                at.data.joint(name).qpos[0] = moved[-1]
            elif at.model.body(name).jntnum[0]:
                at.data.joint(name).qpos[:] = [*position, *orientation]
        at.forward()
        for name, mesh in zip(parts.names, parts.meshes):
            assert np.abs(at.data.body(name).xpos - poses[name][0]).max() < 1e-6
            assert 1.0 - abs(at.data.body(name).xquat @ poses[name][1]) < 1e-12
            same_points(at.vertices(name), turned(mesh.vertices, *poses[name]))
    # It is no comparison of bodies at rest: the joint did move, and under the chest, whose lid stays shut, the tray.
    assert abs(moved[0]) < 1e-6
    assert (np.ptp(recorded[:, 0, 1]) if parts.driven else np.ptp(moved)) > 0.05


@pytest.mark.quick("drawer")
def test_the_folder_states_the_bodies_as_a_result_does(replayed: tuple[Scene, Path, Result]) -> None:
    _, folder, result = replayed
    first, *others = json.loads((folder / "scene.json").read_text())["bodies"]
    names = list(result.bodies)
    stated = [{**body.properties, "fixed": body.kind == "fixed", "name": name} for name, body in result.bodies.items()]
    assert [first, *others] == stated
    with (folder / "spheres.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["body"] for row in rows} == set(names) and len(rows) > 8 * len(names) / 2


@needs_mujoco
@pytest.mark.soak
def test_masses_inertias_friction_and_joints_are_those_of_the_things(tmp_path: Path) -> None:
    scene = own_scene(tmp_path)
    write_scene_folder(scene, tmp_path / "s")
    at, bodies = Model(tmp_path / "s"), {body.name: body for body in scene.solids}
    model, kind = at.model, at.mujoco.mjtJoint
    for name, own in bodies.items():
        body, free = model.body(name), own.solid
        assert body.mass[0] == free.mass
        np.testing.assert_allclose(at.data.body(name).xipos, free.center, atol=1e-12)
        np.testing.assert_allclose(at.inertia(name), free.inertia, rtol=1e-9, atol=1e-12 * np.max(free.inertia))
        same_points(at.vertices(name), own.placed_mesh.vertices)
    found = {name: model.joint(name) for name in ("link", "base", "tip", "flap")}
    types = [joint.type[0] for joint in found.values()]
    assert types == [kind.mjJNT_HINGE, kind.mjJNT_FREE, kind.mjJNT_SLIDE, kind.mjJNT_SLIDE]
    assert [bool(model.jnt_limited[joint.id]) for joint in found.values()] == [False, False, True, False]
    assert found["tip"].range.tolist() == [-0.02, 0.0]
    assert [float(joint.frictionloss[0]) for joint in found.values()] == [0.0, 0.0, 0.0, 2.0]
    for name in ("link", "tip", "flap"):
        joint = bodies[name].joint
        np.testing.assert_allclose(at.data.joint(name).xaxis, joint.direction, atol=1e-12)
    np.testing.assert_allclose(at.data.joint("link").xanchor, bodies["link"].joint.origin, atol=1e-12)
    assert model.opt.gravity.tolist() == list(bodies["link"].solid.gravity) and model.opt.timestep == 1.0 / 200.0
    for name, own in bodies.items():
        geom = model.geom(name)
        if geom.contype[0]:
            assert geom.friction.tolist() == [own.friction, own.torsion, 0.0] and geom.priority[0] == 1
            assert geom.condim[0] == (4 if own.torsion else 3)


@needs_mujoco
def test_bodies_rest_on_table_and_bodies_and_pass_through_what_bears_them(tmp_path: Path) -> None:
    scene = open_scene("drawer", "shut", level=1)
    write_scene_folder(scene, tmp_path / "drawer")
    blocks = open_scene("blocks", "stack", level=1)
    write_scene_folder(blocks, tmp_path / "blocks")
    for folder, bodies, touching in (
        ("drawer", ["drawer", "box"], [{"drawer", "box"}]),
        ("blocks", ["red", "green", "blue"], [{"world", "red"}, {"world", "green"}, {"green", "blue"}]),
    ):
        at = Model(tmp_path / folder)
        names = [*bodies, "palm"]
        before = np.array([at.data.body(name).xipos for name in names])
        at.mujoco.mj_step(at.model, at.data, 300)
        moved = np.abs(np.array([at.data.body(name).xipos for name in names]) - before).max()
        # MuJoCo's contacts give by hundredths of a millimetre; in free fall it would be 0.44 m.
        assert moved < 2e-4
        pairs = {
            frozenset(at.model.body(at.model.geom_bodyid[g]).name for g in geoms) for geoms in at.data.contact.geom
        }
        assert pairs == {frozenset(pair) for pair in touching}
        # As in hhsim, the hand goes through a table.
        table = at.model.geom("table plane") if folder == "blocks" else None
        hand = at.model.geom_bodyid == at.model.body("index_3").id
        if table is not None:
            assert table.pos[2] == pytest.approx(blocks.plane.height if blocks.plane else None)
            assert not (at.model.geom_contype[hand] & table.conaffinity[0]).any() and table.contype[0] == 0


def part_poses(folder: Path, names: tuple[str, ...]) -> tuple[list[dict[str, str]], FloatArray]:
    """Rows of driven.csv, and the poses in them, (T, P, 7)."""
    with (folder / "driven.csv").open() as file:
        rows = list(csv.DictReader(file))
    columns = [f"_{name}" for name in ("px", "py", "pz", "qw", "qx", "qy", "qz")]
    return rows, np.array([[[float(row[part + name]) for name in columns] for part in names] for row in rows])


@needs_mujoco
def test_parts_that_move_as_recorded_follow_their_file(tmp_path: Path) -> None:
    scene = open_scene("laptop", "open", level=1, rate=200.0)
    write_scene_folder(scene, tmp_path / "s")
    parts = engine_scene(scene).parts
    rows, poses = part_poses(tmp_path / "s", parts.names)
    assert len(rows) == scene.ticks.tick_count
    # Bit for bit what a result of the same scene holds.
    np.testing.assert_array_equal(poses, parts.world)
    lid = np.array([float(row["lid_joint"]) for row in rows])
    np.testing.assert_array_equal(lid, parts.values["lid"])
    assert np.ptp(lid) > 0.15 and [name for name in rows[0] if "joint" in name] == ["lid_joint"]
    at = Model(tmp_path / "s")
    assert at.model.nmocap == 2 and at.model.njnt == 21
    for tick in (0, int(lid.argmax())):
        if tick:
            for part, pose in zip(parts.names, poses[tick]):
                which = at.model.body(part).mocapid[0]
                at.data.mocap_pos[which], at.data.mocap_quat[which] = pose[:3], pose[3:]
            at.forward()
        for part, mesh, pose in zip(parts.names, parts.meshes, poses[tick]):
            same_points(at.vertices(part), turned(mesh.vertices, pose[:3], pose[3:]))


@needs_mujoco
def test_the_model_starts_with_the_first_hand_whatever_hangs_where(tmp_path: Path) -> None:
    scene = own_scene(tmp_path)
    write_scene_folder(scene, tmp_path / "s")
    at, hand = Model(tmp_path / "s"), HandConfiguration.of(scene.hands[0].ticks).at(0)
    np.testing.assert_allclose(at.data.joint("palm").qpos, [*hand.position, *hand.orientation], atol=1e-15)
    np.testing.assert_allclose(at.data.joint("little_flex3").qpos[0], hand.flexion[4, 2], atol=1e-15)
    assert at.data.joint("base").qpos.tolist() == [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    assert [at.data.joint(name).qpos[0] for name in ("link", "tip", "flap")] == [0.0, 0.0, 0.0]


def test_the_text_nests_bodies_on_joints_and_keeps_them_from_touching_their_bearers(tmp_path: Path) -> None:
    """What can be said without MuJoCo."""
    write_scene_folder(own_scene(tmp_path), tmp_path / "s")
    model = Xml.parse(tmp_path / "s" / "scene.xml").getroot()
    tip = model.find("worldbody/body[@name='base']/body[@name='link']/body[@name='tip']")
    (joint,) = tip.findall("joint")
    assert (joint.get("type"), joint.get("axis"), joint.get("range")) == ("slide", "-1.0 0.0 0.0", "-0.02 0.0")
    assert [element.get("name") for element in model.iter("freejoint")] == ["base"]
    excluded = {(one.get("body1"), one.get("body2")) for one in model.iter("exclude")}
    assert excluded == {("base", "link"), ("link", "tip")}
    files = {element.get("file", "") for element in model.iter() if element.get("file")}
    assert files == {"hand.xml", *(f"{name}.obj" for name in ("link", "base", "tip", "wall", "flap", "stuck"))}
    assert all((tmp_path / "s" / file).is_file() for file in files)
    assert not any((tmp_path / "s" / name).exists() for name in ("object.obj", "driven.csv"))


def test_a_name_of_the_hands_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    scene = own_scene(tmp_path, *OWN[:-2], flap("palm"), STUCK)
    with pytest.raises(InputError, match=r"'palm' is a body or a joint of the hand, too; expected another name"):
        write_scene_folder(scene, tmp_path / "s")
    assert [path.name for path in tmp_path.iterdir()] == ["bodies.toml"]


@pytest.mark.soak
def test_the_digest_is_of_all_bodies_and_parts(tmp_path: Path) -> None:
    # A file has up to six bodies.
    less = OWN[:-1]
    rough, moved = (*OWN[:-2], flap(friction=2.5), STUCK), (*OWN[:-3], wall(0.41), *OWN[-2:])
    files = (OWN, less, (*less, tray(0.1)), (*less, tray(0.09)), rough, moved)
    bodies = [own_scene(tmp_path, *tables) for tables in files]
    laptop = open_scene("laptop", "open", level=1, rate=100.0)
    base, lid = laptop.solids
    later = lid.motion.poses.position.copy()
    later[-1, 0] += 1e-3
    poses = lid.motion.poses._replace(position=later)
    later_lid = replace(laptop, bodies=(base, replace(lid, motion=replace(lid.motion, poses=poses))))
    scenes = [*bodies, laptop, later_lid]
    assert len({scene_digest(scene) for scene in scenes}) == len(scenes)
    assert scene_digest(own_scene(tmp_path)) == scene_digest(bodies[0])


SIDES = ("right", "left")


def _vector(text: str) -> FloatArray:
    return np.array([float(word) for word in text.split()])


@pytest.mark.parametrize("side", SIDES)
def test_mjcf_has_the_joints_where_hhsim_has_them(side: Side) -> None:
    hand = HandModel.default(side)
    palm = Xml.fromstring(hand_mjcf(hand)).find("worldbody/body")
    assert palm.find("freejoint") is not None
    random = np.random.default_rng(5)
    for _ in range(20):
        orientation, position = random.normal(size=4), random.normal(size=3)
        orientation /= np.linalg.norm(orientation)
        flexion = random.uniform(hand.flexion_min, hand.flexion_max)
        abduction = random.uniform(hand.abduction_min, hand.abduction_max)
        angles, turn = dict(zip(JOINTS, joint_angles(flexion, abduction))), rotation_matrix(orientation)
        frames = _mjcf_frames(palm, angles, turn, position)
        found = [[frames[f"{finger}_{end}"] for end in (1, 2, 3, "tip")] for finger in FINGERS]
        assert np.abs(found - hand.joints(position, orientation, flexion, abduction)).max() < 1e-12


def _mjcf_frames(
    body: Xml.Element, angles: dict[str, float], turn: FloatArray, place: FloatArray
) -> dict[str, FloatArray]:
    for hinge in body.findall("joint"):
        bend = angles[hinge.get("name", "")] * _vector(hinge.get("axis", ""))
        turn = turn @ Rotation.from_rotvec(bend).as_matrix()
    found = {body.get("name", ""): place}
    for site in body.findall("site"):
        found[site.get("name", "")] = place + turn @ _vector(site.get("pos", ""))
    for child in body.findall("body"):
        found |= _mjcf_frames(child, angles, turn, place + turn @ _vector(child.get("pos", "")))
    return found


def test_every_degree_of_freedom_is_a_joint_with_its_limits_and_masses_are_those_of_a_hand() -> None:
    hand = HandModel.default()
    model = Xml.fromstring(hand_mjcf(hand))
    assert tuple(body.get("name") for body in model.iter("body")) == BODIES
    limits = {joint.get("name", ""): _vector(joint.get("range", "")) for joint in model.iter("joint")}
    assert tuple(limits) == JOINTS
    for f, finger in enumerate(FINGERS):
        assert limits[f"{finger}_abd"].tolist() == [hand.abduction_min[f], hand.abduction_max[f]]
        for k in range(3):
            assert limits[f"{finger}_flex{k + 1}"].tolist() == [hand.flexion_min[f, k], hand.flexion_max[f, k]]
    inertials = list(model.iter("inertial"))
    assert len(inertials) == 16 and 0.2 < sum(float(one.get("mass", "")) for one in inertials) < 0.8
    for one in inertials:
        xx, yy, zz, xy, xz, yz = _vector(one.get("fullinertia", ""))
        a, b, c = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert a > 0.0 and c <= (a + b) * (1.0 + 1e-12)


def test_capsules_stand_for_a_tapering_phalanx_from_inside() -> None:
    end, thick, thin = np.array([0.0, 0.0, 0.04]), 0.0187, 0.0098
    tan, _ = cone_slope(0.04, thick, thin)
    for z, x in np.random.default_rng(3).uniform([-0.03, 0.0], [0.06, 0.03], (2000, 2)):
        share = min(max((z - x * tan) / 0.04, 0.0), 1.0)
        exact = math.hypot(x, z - 0.04 * share) - (thick - share * (thick - thin))
        parts = capsules(end, thick, thin)
        near = min(math.hypot(x, z - min(max(z, start[2]), stop[2])) - radius for start, stop, radius in parts)
        # Exact inside is not the same distance: points deep inside tell nothing of the surface.
        if exact > -1e-4:
            assert exact - 1e-12 <= near <= exact + STEP
    ((start, stop, _),) = capsules(end, 0.01, 0.01)
    assert (start != stop).any()

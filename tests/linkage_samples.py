"""Small linkages, written by the tests, and the places of their links by plain matrices."""

from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from hhsim.linkage.linkage import Robot
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.shapes import box

BOX = '<collision><geometry><box size="{}"/></geometry></collision>'


def urdf(*content: str, name: str = "thing") -> str:
    return f'<?xml version="1.0"?><robot name="{name}">{"".join(content)}</robot>'


def link(name: str, content: str = BOX.format("0.1 0.06 0.02")) -> str:
    return f'<link name="{name}">{content}</link>'


def joint(
    parent: str,
    child: str,
    type_: str = "revolute",
    *,
    name: str = "",
    origin: str = "",
    axis: str = "0 0 1",
    limit: str = 'lower="-1" upper="2"',
    more: str = "",
) -> str:
    limits = f"<limit {limit}/>" if limit and type_ in ("revolute", "prismatic") else ""
    place = f"<origin {origin}/>" if origin else ""
    turned = f'<axis xyz="{axis}"/>' if axis and type_ != "fixed" else ""
    return (
        f'<joint name="{name or child + "_joint"}" type="{type_}"><parent link="{parent}"/><child link="{child}"/>'
        f"{place}{turned}{limits}{more}</joint>"
    )


def random_urdf(seed: int, links: int = 9) -> str:
    """A tree of links on joints of all types, each at a random place, with a box at a random place in it."""
    rng = np.random.default_rng(seed)

    def row(values: np.ndarray) -> str:
        return " ".join(f"{value:.17g}" for value in values)

    content = []
    for k in range(links):
        place = f'<origin xyz="{row(rng.uniform(-0.2, 0.2, 3))}" rpy="{row(rng.uniform(-3, 3, 3))}"/>'
        shape = f'<geometry><box size="{row(rng.uniform(0.02, 0.1, 3))}"/></geometry>'
        inertia = 'ixx="1e-3" iyy="1.2e-3" izz="0.9e-3" ixy="1e-4" ixz="-2e-5" iyz="0"'
        inertial = f'<inertial>{place}<mass value="{rng.uniform(0.1, 2.0)}"/><inertia {inertia}/></inertial>'
        content.append(link(f"l{k}", f"<collision>{place}{shape}</collision>{inertial}"))
        if k:
            type_ = str(rng.choice(["revolute", "continuous", "prismatic", "fixed"]))
            origin = f'xyz="{row(rng.uniform(-0.3, 0.3, 3))}" rpy="{row(rng.uniform(-3, 3, 3))}"'
            # yourdfpy takes a slider's axis by its length, which the format wants to be 1.
            axis = rng.normal(size=3)
            content.append(
                joint(f"l{rng.integers(k)}", f"l{k}", type_, origin=origin, axis=row(axis / np.linalg.norm(axis)))
            )
    return urdf(*content)


def places(linkage: Robot, values: dict[str, float]) -> dict[str, np.ndarray]:
    """Place of each link in the file's frame as a 4 × 4 matrix, at values by the names of the joints."""
    found: dict[str, np.ndarray] = {}
    for each in linkage.links:
        here = np.eye(4)
        moving = linkage.joint_of.get(each.name)
        if moving is not None:
            here[:3, :3], here[:3, 3] = moving.frame
            move, value = np.eye(4), values.get(moving.name, 0.0)
            if moving.type == "hinge":
                move[:3, :3] = Rotation.from_rotvec(value * moving.axis).as_matrix()
                move[:3, 3] = moving.origin - move[:3, :3] @ moving.origin
            elif moving.type == "slider":
                move[:3, 3] = value * moving.axis
            here = (found[moving.parent] if moving.parent else np.eye(4)) @ move @ here
        found[each.name] = here
    return found


CUBE = np.array(np.meshgrid(*([-0.5, 0.5] for _ in range(3)))).reshape(3, -1).T
"""Corners of a cube of edges of 1 about the origin."""


def assert_corners(linkage: Robot, found: dict[str, np.ndarray], wanted: list[np.ndarray]) -> None:
    """Hold the corners of all shapes, in the file's frame, against those wanted, in any order."""
    places = [
        vertices @ found[each.name][:3, :3].T + found[each.name][:3, 3]
        for each in linkage.links
        for vertices, _ in each.shapes
    ]
    corners, others = np.concatenate(places), np.concatenate(wanted)
    apart = np.linalg.norm(corners[:, None] - others[None], axis=2)
    assert len(corners) == len(others)
    assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-9


def assert_volume(triangles: tuple[np.ndarray, np.ndarray], volume: float, shape: str) -> None:
    """Hold a closed mesh against the volume of its shape, which chords are inside of."""
    solid = trimesh.Trimesh(*triangles)
    assert solid.is_watertight and 0.99 * volume <= solid.volume <= volume * (1.0 + 1e-6), shape


def write_box(
    path: Path,
    edges: tuple[float, float, float] = (100.0, 60.0, 20.0),
    place: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Path:
    """Write a box as an OBJ of these edges at a place, which has no unit."""
    vertices, faces = box(edges)
    path.write_text(Mesh(vertices + place, faces).obj())
    return path


SHAPES = {
    "base": '<box size="0.2 0.2 0.1"/>',
    "turret": '<cylinder radius="0.06" length="0.2"/>',
    "upper": '<mesh filename="package://arm/box.obj" scale="0.001 0.001 -0.003"/>',
    "lower": '<capsule radius="0.04" length="0.2"/>',
    "ball": '<sphere radius="0.05"/>',
}
"""Geometry of each link, by its name."""


def collision(shape: str, origin: str = "") -> str:
    place = f"<origin {origin}/>" if origin else ""
    return f"\n    <collision>\n      {place}<geometry>{shape}</geometry>\n    </collision>"


def write_arm(folder: Path, links: int = 8) -> Path:
    """Write `arm.urdf` and its mesh: base, turret, upper, lower, a ball, a frame without shapes, and two fingers.

    Of these so many, from the base on.
    """
    write_box(folder / "box.obj")
    places = {"turret": 'xyz="0 0 0.1"', "upper": 'xyz="0 0 0.1" rpy="0.1 0.2 0.3"', "lower": 'xyz="0 0 0.12"'}
    made = [link(name, collision(shape, places.get(name, ""))) for name, shape in SHAPES.items()]
    finger = collision('<box size="0.02 0.01 0.06"/>') + collision('<sphere radius="0.012"/>', 'xyz="0 0 0.03"')
    seen = "<!-- > </link> --><visual><geometry><box size='1 1 1'/></geometry></visual>"
    made += [link("frame", seen), link("left", finger), link("right", finger)]
    follow = '<mimic joint="left_joint" multiplier="-1"/>'
    joints = [
        joint("base", "turret", "continuous", origin='xyz="0 0 0.05"'),
        joint("turret", "upper", origin='xyz="0 0 0.2"', axis="0 1 0", limit='lower="0.5" upper="2"'),
        joint("upper", "lower", origin='xyz="0 0 0.3"', axis="0 1 0"),
        joint("lower", "frame", "fixed", origin='xyz="0 0 0.25"'),
        joint("frame", "ball", "fixed"),
        joint("ball", "left", "prismatic", origin='xyz="0 0 0.1"', axis="0 1 0", limit='lower="0.02" upper="0.05"'),
        joint("ball", "right", "prismatic", origin='xyz="0 0 0.1"', axis="0 1 0", more=follow),
    ]
    path = folder / "arm.urdf"
    path.write_text(
        "\n  ".join([urdf(*made[:links], name="arm").replace("</robot>", ""), *joints[: links - 1], "</robot>"])
    )
    return path

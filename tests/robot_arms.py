"""A small arm, written by the tests: links of every kind of shape, on joints of several types."""

from pathlib import Path

from linkage_samples import joint, link, urdf, write_box

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

"""Semantic Robot Description Format of MoveIt: `link_sphere_approximation`, and links whose collisions are disabled."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

from hhsim.linkage.file import read_xml
from hhsim.robots.formats.registry import RobotFormat, Spheres
from hhsim.robots.numbers import checked_spheres, digits, row
from hhsim.robots.robot_spheres import RobotSpheres


def write_srdf(found: RobotSpheres) -> bytes:
    """Return the file."""
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(found.robot.name)}>"]
    for name, spheres in found.spheres.items():
        lines.append(f"  <link_sphere_approximation link={quoteattr(name)}>")
        lines += [
            f'    <sphere center="{row(center)}" radius="{digits(radius)}"/>' for *center, radius in spheres.tolist()
        ]
        lines.append("  </link_sphere_approximation>")
    for one, others in found.ignored.items():
        for other, reason in others.items():
            lines.append(f'  <disable_collisions link1={quoteattr(one)} link2={quoteattr(other)} reason="{reason}"/>')
    return "\n".join([*lines, "</robot>", ""]).encode()


def read_srdf(path: Path) -> Spheres:
    """Read the spheres of each `link_sphere_approximation`."""
    found = {}
    for link in read_xml(path).findall("link_sphere_approximation"):
        name = link.get("link", "")
        rows = [(each.get("center", "").split(), each.get("radius")) for each in link.findall("sphere")]
        spheres = checked_spheres(rows, name)
        if len(spheres):
            found[name] = spheres
    return found


FORMAT = RobotFormat((".srdf",), b"link_sphere_approximation", write_srdf, read_srdf)

"""Semantic Robot Description Format of MoveIt: `link_sphere_approximation`, and links whose collisions are disabled."""

from xml.sax.saxutils import quoteattr

from hhsim.robots.formats.registry import RobotFormat
from hhsim.robots.numbers import digits, row
from hhsim.robots.robot_spheres import RobotSpheres
from hhsim.robots.touching_pairs import adjacent_links


def write_srdf(found: RobotSpheres) -> bytes:
    """Return the file."""
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(found.robot.name)}>"]
    for name, spheres in found.spheres.items():
        lines.append(f"  <link_sphere_approximation link={quoteattr(name)}>")
        lines += [
            f'    <sphere center="{row(center)}" radius="{digits(radius)}"/>' for *center, radius in spheres.tolist()
        ]
        lines.append("  </link_sphere_approximation>")
    adjacent = adjacent_links(found.robot, found.spheres)
    for one, others in found.ignored.items():
        for other in others:
            reason = "Adjacent" if frozenset((one, other)) in adjacent else "Always"
            lines.append(f'  <disable_collisions link1={quoteattr(one)} link2={quoteattr(other)} reason="{reason}"/>')
    return "\n".join([*lines, "</robot>", ""]).encode()


FORMAT = RobotFormat((".srdf",), b"link_sphere_approximation", write_srdf)

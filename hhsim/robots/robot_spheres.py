"""Spheres of a robot as its writers take them."""

from dataclasses import dataclass
from pathlib import Path

from hhsim.arrays import FloatArray
from hhsim.linkage.linkage import Robot
from hhsim.robots.link_spheres import LinkSpheres
from hhsim.robots.touching_pairs import Ignored


@dataclass(frozen=True, eq=False)
class RobotSpheres:
    """A robot, its file, the spheres of its links, and the pairs of links that a planner has to ignore."""

    robot: Robot
    source: Path  # the URDF or MJCF
    links: tuple[LinkSpheres, ...]
    ignored: Ignored

    @property
    def spheres(self) -> dict[str, FloatArray]:
        """Centres and radii [m], shape (n, 4), of each link in its frame, by its name."""
        return {link.name: link.spheres for link in self.links}

    @property
    def moving(self) -> list[str]:
        """Names of the joints that move by themselves."""
        kinds = ("hinge", "slider")
        return [joint.name for joint in self.robot.joints if joint.type in kinds and joint.mimic is None]

    @property
    def ends(self) -> list[str]:
        """Names of the links at the ends of chains: what a robot's tool hangs on."""
        parents = {joint.parent for joint in self.robot.joints}
        return [link.name for link in self.robot.links if link.name not in parents]

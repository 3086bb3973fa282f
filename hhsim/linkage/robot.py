"""A robot: every link of a URDF or MJCF by its own name, with what collides, and every joint, of whatever type."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from hhsim.errors import InputError
from hhsim.linkage.linkage import Link, LinkJoint, parents_first, require_tree


@dataclass(frozen=True, eq=False)
class Robot:
    """Links in an order in which parents come first, and joints in the file's order; nothing is merged."""

    name: str
    links: tuple[Link, ...]  # some have no shapes
    joints: tuple[LinkJoint, ...]
    notes: tuple[str, ...] = ()  # what was left out, one plain sentence each

    @property
    def solid(self) -> tuple[Link, ...]:
        """Links that have shapes."""
        return tuple(link for link in self.links if link.shapes)

    @property
    def moves(self) -> bool:
        """True if a link can move on another one."""
        return any(joint.type not in ("fixed", "free") or joint.mimic is not None for joint in self.joints)

    def link(self, name: str) -> Link:
        """Return a link that has shapes, by its name; InputError lists them."""
        for link in self.solid:
            if link.name == name:
                return link
        raise InputError(f"no link '{name}'; it has {', '.join(link.name for link in self.solid)}")


def robot_of(
    name: str, links: Sequence[Link], joints: Sequence[LinkJoint], notes: Iterable[str] = (), seen: Sequence[str] = ()
) -> Robot:
    """Return the robot of links and joints; InputError where they are no tree, or no joint leads a mimic.

    `seen` are links that only look: they have no shapes, and a note names them.
    """
    require_tree(links, joints)
    known = {joint.name: joint for joint in joints}
    for joint in joints:
        chain = [joint]
        while (follows := chain[-1].mimic) is not None:
            if follows.leader not in known:
                raise InputError(f"joint '{joint.name}': it mimics '{follows.leader}', which is no joint of the file")
            if known[follows.leader] in chain:
                raise InputError(f"joint '{joint.name}': it mimics itself; expected a joint that moves by itself")
            chain.append(known[follows.leader])
    order = parents_first(links, {joint.child: joint for joint in joints})
    if seen:
        notes = [*notes, f"{', '.join(seen)}: nothing there collides, so without spheres; --visual takes what is seen"]
    return Robot(name, tuple(order), tuple(joints), tuple(notes))

"""URDF with spheres in place of the `<collision>` elements of its links; every other byte is as it was."""

import re
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from hhsim.errors import InputError
from hhsim.linkage.file import MOST_BYTES, read_xml
from hhsim.robots.formats.curobo import require_urdf
from hhsim.robots.formats.registry import RobotFormat, Spheres
from hhsim.robots.numbers import checked_spheres, digits, row
from hhsim.robots.robot_spheres import RobotSpheres
from hhsim.system.input_file import read_input


class _Place(NamedTuple):
    """Bytes of a `<collision>` or `<visual>` element, and the link that it is of."""

    link: str
    tag: str
    begin: int
    end: int


def write_urdf(found: RobotSpheres) -> bytes:
    """Return the robot's file with the spheres; InputError for one that is no URDF, or in an encoding of wide letters.

    The first collision of a link becomes its spheres; the others go, with the blank before them. The spheres of a link
    without one stand after its first `<visual>`.
    """
    require_urdf(found, "This format")
    text = read_input(found.source, MOST_BYTES)
    if text[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in text[:64]:
        raise InputError(f"{found.source}: expected UTF-8, or another encoding in which ASCII is one byte a letter")
    spheres, seen, parts, at = found.spheres, set[str](), [], 0
    places = _shapes(text)
    collide = {place.link for place in places if place.tag == "collision"}
    for place in places:
        is_collision = place.tag == "collision"
        if place.link not in spheres or (not is_collision and place.link in seen | collide):
            continue
        lead = re.search(rb"\s*\Z", text[at : place.begin])
        blank = lead.group() if lead else b""
        if place.link in seen:
            parts.append(text[at : place.begin - len(blank)])
        else:
            indent = b"\n" + blank.rpartition(b"\n")[2] if b"\n" in blank else b""
            elements = [
                f'<collision><origin xyz="{row(center)}" rpy="0 0 0"/>'
                f'<geometry><sphere radius="{digits(radius)}"/></geometry></collision>'.encode()
                for *center, radius in spheres[place.link].tolist()
            ]
            before = text[at : place.begin] if is_collision else text[at : place.end] + indent
            parts += [before, indent.join(elements)]
            seen.add(place.link)
        at = place.end
    return b"".join([*parts, text[at:]])


def _shapes(text: bytes) -> list[_Place]:
    """Return the places of the collisions and visuals of the links of a robot, in their order."""
    parser = expat.ParserCreate()
    path: list[str] = []
    found: list[_Place] = []
    link, tag, begin, ended = "", "", 0, False

    def close() -> None:
        # The end of an element is where the next thing of the file begins.
        nonlocal ended
        if ended:
            found.append(_Place(link, tag, begin, parser.CurrentByteIndex))
            ended = False

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal link, tag, begin
        close()
        path.append(name)
        if path == ["robot", "link"]:
            link = attributes.get("name", "")
        elif path[:-1] == ["robot", "link"]:
            tag, begin = name, parser.CurrentByteIndex

    def end(_: str) -> None:
        nonlocal ended
        close()
        ended = path[:-1] == ["robot", "link"] and path[-1] in ("collision", "visual")
        path.pop()

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.DefaultHandler = lambda _: close()
    parser.Parse(text, True)
    return found


def read_urdf_spheres(path: Path) -> Spheres:
    """Read the spheres of the collisions of each link; a link with other shapes too is an InputError."""
    found = {}
    for link in read_xml(path).findall("link"):
        name, rows, others = link.get("name", ""), [], 0
        for collision in link.findall("collision"):
            sphere, origin = collision.find("geometry/sphere"), collision.find("origin")
            place = "0 0 0" if origin is None else origin.get("xyz", "0 0 0")
            others += sphere is None
            if sphere is not None:
                rows.append((place.split(), sphere.get("radius")))
        if rows and others:
            raise InputError(f"link '{name}' has spheres and {others} other shapes; expected spheres alone")
        if rows:
            found[name] = checked_spheres(rows, name)
    return found


FORMAT = RobotFormat((".urdf",), b"<robot", write_urdf, read_urdf_spheres)

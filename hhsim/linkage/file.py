"""Linkage files: the words that mean one, their reading in a child process, and the mesh that any OBJECT means."""

import functools
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from hhsim.errors import DamagedFileError, InputError, named
from hhsim.linkage.linkage import Link, Robot, merged_linkage
from hhsim.linkage.mjcf import read_mjcf
from hhsim.linkage.urdf import mesh_file, read_urdf
from hhsim.mesh.catalogue import MESH_LEVEL, load_object, names_a_file
from hhsim.mesh.mesh import Mesh, load_mesh, with_inside
from hhsim.reproducible import sine_and_cosine
from hhsim.system.child_reader import read_in_child
from hhsim.system.input_file import check_ordinary, read_input

SUFFIXES = (".urdf", ".xml", ".mjcf")
"""Suffixes of URDF and MJCF."""
MOST_BYTES = 32 << 20
"""Largest URDF or MJCF [byte], without its meshes."""
MOST_MESH_BYTES = 1 << 29
"""Most bytes of meshes that a file may name."""
REFUSAL = "cannot be read: damaged, or too large"


def names_a_linkage(word: str | Path) -> bool:
    """Return True if a word means a URDF or MJCF file, by its suffix."""
    return Path(word).suffix.lower() in SUFFIXES


def read_linkage(path: Path) -> Robot:
    """Read a URDF or MJCF file and its meshes, links on fixed joints as one.

    InputError names the file, the element, and what would be right.
    """
    robot = read_robot(path, looks=True, of_scene=True)
    with named(path):
        return merged_linkage(robot)


def read_robot(path: Path, looks: bool = False, *, of_scene: bool = False) -> Robot:
    """Read every link of a URDF or MJCF file by its name, with what collides; errors as `read_linkage`.

    With `looks`, a link in which nothing collides is as it looks; `of_scene` is as for `read_urdf`.
    """
    with named(path):
        try:
            check_ordinary(path, MOST_BYTES)
            state = path.stat()
        except FileNotFoundError:
            raise InputError("no such file; expected a URDF or an MJCF file") from None
        except OSError as error:
            raise InputError(f"{error.strerror or error}; expected a URDF or an MJCF file") from None
        if path.is_dir():
            raise InputError("a folder; expected a URDF or an MJCF file")
        return _read(path, of_scene, looks, state.st_mtime_ns)


@functools.lru_cache(maxsize=2)
def _read(path: Path, of_scene: bool, looks: bool, _changed: int) -> Robot:
    """Read a file as it was when it was changed last [ns]."""
    try:
        kind, size = read_in_child(lambda: _look(path), REFUSAL)
        if kind == "mujoco":
            if find_spec("mujoco") is None:
                raise InputError("an MJCF is read by mujoco, which is not installed: pip install 'hhsim[mjcf]'")
            try:
                import_module("mujoco")
            except ImportError as error:
                raise InputError(f"mujoco cannot be loaded ({error}): pip install 'hhsim[mjcf]'") from None
        # Before the fork: what a child loads is lost with it.
        import_module("trimesh")
        sine_and_cosine(0.0)
        read = read_mjcf if kind == "mujoco" else read_urdf
        return read_in_child(lambda: read(_root(path), path, of_scene, looks), REFUSAL, size)
    except DamagedFileError as error:
        raise InputError(str(error)) from None


def read_xml(path: Path, comments: bool = False) -> ElementTree.Element:
    """Return the first element of a file, with the comments in it if they are wanted; InputError if it is no XML.

    Prefixes stay in the names, bound or not.
    """
    builder, parser = ElementTree.TreeBuilder(insert_comments=comments), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler, parser.CommentHandler = builder.data, builder.comment
    try:
        parser.Parse(read_input(path, MOST_BYTES), True)
    except (OSError, expat.ExpatError) as error:
        raise InputError(f"no XML: {error}; expected a URDF or an MJCF file") from None
    return builder.close()


def _root(path: Path) -> ElementTree.Element:
    root = read_xml(path)
    if root.tag not in ("robot", "mujoco"):
        raise InputError(f"its first element is <{root.tag}>; expected <robot> (URDF) or <mujoco> (MJCF)")
    return root


def _look(path: Path) -> tuple[str, int]:
    """Return the first element's name, and the bytes of all files that the others name; InputError for too many."""
    root = _root(path)
    folders = {path.parent, *(path.parent / (each.get("meshdir") or ".") for each in root.iter("compiler"))}
    size = path.stat().st_size
    for file in {name for element in root.iter() if (name := element.get("filename") or element.get("file"))}:
        tries = [mesh_file(file, path)] if root.tag == "robot" else [folder / file for folder in folders]
        size += next((each.stat().st_size for each in tries if each.is_file()), 0)
    if size > MOST_MESH_BYTES:
        raise InputError(f"{size:,} bytes with its meshes; expected {MOST_MESH_BYTES:,} at most")
    return root.tag, size


def resolve_object(
    name_or_path: str | Path,
    unit: str | None = None,
    size: float | None = None,
    solid: bool | None = True,
    link: str = "",
) -> tuple[Mesh, int]:
    """Return the mesh that a catalogue name, a mesh file, or a URDF or MJCF file means, and its usual tree level.

    Args:
        name_or_path: A word with a suffix or a folder is a file.
        unit, size: Of a mesh file [-, m], as for `hhsim.mesh.mesh.load_mesh`.
        solid: As for `load_mesh`.
        link: Link of a URDF or MJCF file, in its own frame; one without a name is the only one, in the file's.

    Raises:
        UnknownNameError: No such object, with the near names.
        InputError: No such file or link, or a unit or a size for an object that has its own.
        MeshError: A mesh that cannot be used.
    """
    word = str(name_or_path)
    has_own_size = "unit and size are for mesh files" if unit is not None or size is not None else ""
    if names_a_linkage(word):
        if has_own_size:
            raise InputError(f"{has_own_size}; {word} states its sizes")
        linkage = _linkage_or_robot(Path(word), link)
        with named(word):
            if not link and len(linkage.links) > 1:
                names = ", ".join(one.name for one in linkage.links)
                raise InputError(f"{len(linkage.links)} links, {names}; expected one, or the name of one (--link)")
            mesh = link_mesh(linkage.link(link or linkage.links[0].name), word, solid)
            if not link:
                # The only link is where the file has it.
                mesh = replace(mesh, name=Path(word).stem)
                for joint in linkage.joints:
                    mesh = mesh.transformed(*joint.start_frame)
        return replace(mesh, warnings=(*mesh.warnings, *linkage.notes)), MESH_LEVEL
    if link:
        raise InputError(f"a link is of a URDF or MJCF file; '{word}' is none")
    if not names_a_file(word):
        if has_own_size:
            raise InputError(f"{has_own_size}; '{word}' is an object that has its size")
        item = load_object(word)
        return item.mesh, item.level
    if unit is not None and size is not None:
        raise InputError("unit and size exclude each other: size scales whatever the unit is")
    return load_mesh(word, unit, size, solid), MESH_LEVEL


def solid_for(surface: str, asked: bool = False) -> bool | None:
    """Return the argument `solid` of `resolve_object` for a surface, spheres or mesh, or for a solid asked for."""
    return True if asked else None if surface == "spheres" else False


def _linkage_or_robot(path: Path, link: str) -> Robot:
    """Return the linkage of a file; where it has no such link, or no scene can have its joints, all of its links."""
    try:
        linkage = read_linkage(path)
        if not link or any(one.name == link for one in linkage.links):
            return linkage
    except InputError:
        if not link:
            raise
    robot = read_robot(path, looks=True)
    # Its notes are of a robot's spheres, and of joints.
    return replace(robot, notes=()) if any(one.name == link for one in robot.solid) else read_linkage(path)


def link_mesh(link: Link, source: str, solid: bool | None = True) -> Mesh:
    """Return the surface of a link [m] in its own frame, as `load_mesh` of a mesh file; errors name the link."""
    mesh = Mesh(*link.triangles, name=link.name, source=f"link '{link.name}'")
    return replace(with_inside(mesh, hint="is its scale wrong?", solid=solid), source=source)

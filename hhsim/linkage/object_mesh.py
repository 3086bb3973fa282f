"""The mesh that a word means: a name of the catalogue, a mesh file, or a link of a URDF or MJCF file."""

from dataclasses import replace
from pathlib import Path

from hhsim.errors import InputError, named
from hhsim.linkage.file import names_a_linkage, read_linkage, read_robot
from hhsim.linkage.linkage import Linkage
from hhsim.linkage.robot import Robot
from hhsim.mesh.catalogue import MESH_LEVEL, load_object, names_a_file
from hhsim.mesh.mesh import Mesh, load_mesh, with_inside


def resolve_object(
    name_or_path: str | Path,
    unit: str | None = None,
    size: float | None = None,
    thickness: float | None = None,
    solid: bool | None = True,
    link: str = "",
) -> tuple[Mesh, int]:
    """Return the mesh that a catalogue name, a mesh file, or a URDF or MJCF file means, and its usual tree level.

    Args:
        name_or_path: A word with a suffix or a folder is a file.
        unit, size, thickness: Of a mesh file [-, m, m], as for `hhsim.mesh.mesh.load_mesh`.
        solid: As for `load_mesh`; sheets of a thickness are solids.
        link: Link of a URDF or MJCF file, in its own frame; one without a name is the only one, in the file's.

    Raises:
        UnknownNameError: No such object, with the near names.
        InputError: No such file or link, or a unit, size or thickness for an object that has its own.
        MeshError: A mesh that cannot be used.
    """
    word = str(name_or_path)
    given = "unit and size are" if unit is not None or size is not None else ""
    given = "thickness is" if thickness is not None else given
    if names_a_linkage(word):
        if given:
            raise InputError(f"{given} for mesh files; {word} states its sizes")
        linkage = _read(Path(word), link)
        with named(word):
            if not link and len(linkage.links) > 1:
                names = ", ".join(one.name for one in linkage.links)
                raise InputError(f"{len(linkage.links)} links, {names}; expected one, or the name of one (--link)")
            mesh = link_mesh(linkage, link or linkage.links[0].name, word, solid)
            if not link:
                # The only link is where the file has it.
                mesh = replace(mesh, name=Path(word).stem)
                if isinstance(linkage, Linkage) and linkage.joints:
                    mesh = mesh.transformed(*linkage.start_frames()[linkage.links[0].name])
        notes = linkage.notes if isinstance(linkage, Linkage) else ()
        return replace(mesh, warnings=(*mesh.warnings, *notes)), MESH_LEVEL
    if link:
        raise InputError(f"a link is of a URDF or MJCF file; '{word}' is none")
    if not names_a_file(word):
        if given:
            raise InputError(f"{given} for mesh files; '{word}' is an object that has its size")
        item = load_object(word)
        return item.mesh, item.level
    if unit is not None and size is not None:
        raise InputError("unit and size exclude each other: size scales whatever the unit is")
    solid = True if thickness is not None else solid
    return load_mesh(word, unit, size, thickness=thickness, solid=solid), MESH_LEVEL


def solid_for(surface: str, asked: bool = False) -> bool | None:
    """Return the argument `solid` of `resolve_object` for a surface, spheres or mesh, or for a solid asked for."""
    return True if asked else None if surface == "spheres" else False


def _read(path: Path, link: str) -> Linkage | Robot:
    """Return the linkage of a file; where it has no such link, or no scene can have its joints, all of its links."""
    try:
        linkage = read_linkage(path)
        with named(path):
            if link:
                linkage.link(link)
    except InputError:
        if not link:
            raise
        robot = read_robot(path, looks=True)
        if any(one.name == link for one in robot.solid):
            return robot
        raise
    return linkage


def link_mesh(linkage: Linkage | Robot, name: str, source: str, solid: bool | None = True) -> Mesh:
    """Return the surface of a link [m] in its own frame, as `load_mesh` of a mesh file; InputError names the link."""
    vertices, faces = linkage.link(name).triangles
    about = f"link '{name}'"
    mesh = with_inside(Mesh(vertices, faces, name=name, source=about), hint="is its scale wrong?", solid=solid)
    return replace(mesh, source=source)

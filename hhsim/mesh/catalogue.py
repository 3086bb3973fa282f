"""Objects that ship with hhsim, and the mesh that a name or a path means."""

import functools
import tomllib
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hhsim.errors import MeshError, check_known

if TYPE_CHECKING:
    from hhsim.mesh.mesh import Mesh

SUFFIX = ".toml"
BODIES = "bodies"
"""Folder of the files of bodies."""
OF_BODIES = "bodies"
"""Option of a sphere tree that has the name of the bodies it is of, by which a script finds its placement."""
MESH_LEVEL = 4
"""Sphere-tree level of a mesh file, which may be as complex as the bunny."""


@dataclass(frozen=True)
class CatalogueObject:
    """A shipped object."""

    name: str
    title: str
    mesh: "Mesh"  # closed mesh [m], z up, centre of its bounding box at the origin
    stresses: str  # what it demands of a method
    source: str  # origin and terms of the shape
    licence: str
    notice: str  # file beside it with the terms in full; empty where the licence of the project holds
    level: int  # level of its sphere tree: the coarsest, 3 or 4, at which a hand touches within 1 mm of the mesh
    paper_level: int  # level that the paper uses for its kind: 3 for simple shapes, 4 for complex ones
    density: float  # of the free object [kg/m³]
    friction: float  # of hand and object


@functools.cache
def _descriptions() -> dict[str, dict[str, Any]]:
    entries = [entry for entry in files("hhsim.objects").iterdir() if entry.name.endswith(SUFFIX)]
    found = {entry.name.removesuffix(SUFFIX): tomllib.loads(entry.read_text(encoding="utf-8")) for entry in entries}
    return dict(sorted(found.items(), key=lambda item: (item[1]["order"], item[0])))


def object_names() -> list[str]:
    """Return the names of all objects, the simple ones first, both kinds in the paper's order."""
    return list(_descriptions())


def object_description(name: str) -> dict[str, Any]:
    """Return the content of an object's TOML file; UnknownNameError lists the near names."""
    check_known("object", [name], _descriptions())
    return _descriptions()[name]


@functools.cache
def body_file_names() -> list[str]:
    """Return the names of the files of bodies that ship with hhsim."""
    folder = files("hhsim.objects") / BODIES
    return sorted(entry.name.removesuffix(SUFFIX) for entry in folder.iterdir() if entry.name.endswith(SUFFIX))


def names_a_body_file(word: str) -> bool:
    """Return True if a word means a file of bodies: a name of the catalogue, or a TOML file."""
    return word.lower().endswith(SUFFIX) or (not names_a_file(word) and word in body_file_names())


def usual_level(word: str) -> int | None:
    """Return the default tree level of an object or a mesh file; None for an unknown name."""
    if names_a_file(word):
        return MESH_LEVEL
    return int(object_description(word)["level"]) if word in object_names() else None


def load_object(name: str) -> CatalogueObject:
    """Load an object of the catalogue; its content hash shows that its mesh is the checked one.

    UnknownNameError lists the near names; MeshError if the shipped mesh is not the one that its description states.
    """
    # Shell completion asks for names alone and must not wait for numpy.
    from hhsim.mesh.file import read_own_ply
    from hhsim.mesh.mesh import METRES_PER_UNIT, Mesh

    description = object_description(name)
    file = description["file"]
    vertices, faces = read_own_ply((files("hhsim.objects") / file).read_bytes(), file)
    mesh = Mesh(vertices * METRES_PER_UNIT[description["unit"]], faces, name=name, source=description["source"])
    if mesh.sha256 != description["sha256"]:
        raise MeshError(f"{file}: content hash {mesh.sha256[:12]}… differs from its description; install hhsim again")
    stated = ("title", "stresses", "source", "licence", "level", "paper_level", "density", "friction")
    return CatalogueObject(
        name=name,
        mesh=replace(mesh, repairs=tuple(description.get("repairs", ()))),
        notice=description.get("notice", ""),
        **{key: description[key] for key in stated},
    )


def names_a_file(word: str) -> bool:
    """Return True if a word means a file and no catalogue name: it has a suffix or a folder."""
    return bool(Path(word).suffix) or "/" in word or "\\" in word

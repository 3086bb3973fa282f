"""The objects that ship with hhsim: meshes in metres, z up, with their source and licence."""

import tomllib
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from hhsim.errors import MeshError, UnknownNameError

if TYPE_CHECKING:
    from hhsim.mesh import Mesh

SUFFIX = ".toml"


@dataclass(frozen=True)
class CatalogueObject:
    """A shipped object.

    Attributes:
        name: The name that commands take.
        title: What it is, in a few words.
        mesh: Closed mesh [m], z up, the centre of its bounding box at the origin.
        stresses: What it demands of a hand-rendering method.
        source: Where the shape comes from.
        licence: Terms of the shape.
        notice: File beside it that holds the terms in full; empty where the licence of the project holds.
        level: Sphere-tree level that the paper uses for it: 3 for simple shapes, 4 for complex ones.
    """

    name: str
    title: str
    mesh: "Mesh"
    stresses: str
    source: str
    licence: str
    notice: str
    level: int


def object_names() -> list[str]:
    """Names of all objects, the simple ones first, both kinds in the paper's order."""
    return sorted(_described(), key=lambda name: (object_description(name)["order"], name))


def _described() -> set[str]:
    folder = files("hhsim.objects")
    return {entry.name.removesuffix(SUFFIX) for entry in folder.iterdir() if entry.name.endswith(SUFFIX)}


def object_description(name: str) -> dict[str, Any]:
    """The content of an object's TOML file.

    Raises:
        UnknownNameError: No such object; the message lists the near names.
    """
    known = _described()
    if name not in known:
        raise UnknownNameError("object", name, known)
    return tomllib.loads((files("hhsim.objects") / f"{name}{SUFFIX}").read_text(encoding="utf-8"))


def load_object(name: str) -> CatalogueObject:
    """Load an object of the catalogue.

    The mesh passed `load_mesh`'s checks when it was added (a test repeats them); here its content hash shows that it is
    still that mesh.

    Raises:
        UnknownNameError: No such object; the message lists the near names.
        MeshError: The shipped mesh is not the one that its description states.
    """
    # Shell completion asks for names alone and must not wait for numpy.
    from hhsim.mesh import METRES_PER_UNIT, Mesh
    from hhsim.mesh_file import read_own_ply

    description = object_description(name)
    file = description["file"]
    vertices, faces = read_own_ply((files("hhsim.objects") / file).read_bytes(), file)
    mesh = Mesh(vertices * METRES_PER_UNIT[description["unit"]], faces, name=name, source=description["source"])
    if mesh.sha256 != description["sha256"]:
        raise MeshError(f"{file}: content hash {mesh.sha256[:12]}… differs from its description; install hhsim again")
    return CatalogueObject(
        name=name,
        title=description["title"],
        mesh=replace(mesh, repairs=tuple(description.get("repairs", ()))),
        stresses=description["stresses"],
        source=description["source"],
        licence=description["licence"],
        notice=description.get("notice", ""),
        level=description["level"],
    )

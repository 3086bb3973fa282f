"""JSON of foam (CoMMALab/foam) for each link: its spheres, and the mean, least and largest of their errors."""

import json
from pathlib import Path
from typing import Any

from hhsim.errors import InputError
from hhsim.mesh.signed_bvh import heights, signed_bvh
from hhsim.robots.formats.registry import RobotFormat, Spheres
from hhsim.robots.numbers import checked_spheres
from hhsim.robots.robot_spheres import RobotSpheres
from hhsim.system.input_file import read_input_text


def write_json(found: RobotSpheres) -> bytes:
    """Return the file; the error of a sphere is its proved bound [m]."""
    document = {}
    for link in found.links:
        bounds = link.tree.leaf_radius + heights(signed_bvh(link.mesh), link.tree.leaf_center)
        document[link.name] = {
            "mean": float(bounds.mean()),
            "best": float(bounds.min()),
            "worst": float(bounds.max()),
            "spheres": [{"origin": center, "radius": radius} for *center, radius in link.spheres.tolist()],
        }
    return (json.dumps(document, indent=1) + "\n").encode()


def read_json(path: Path) -> Spheres:
    """Read the spheres of each link, or of the one mesh of a file of foam's, by the file's name."""
    try:
        document = json.loads(read_input_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(f"no JSON: {error}") from None
    alone = isinstance(document, dict) and "spheres" in document
    return {name: _of_link(each, name) for name, each in ({path.stem: document} if alone else _links(document)).items()}


def _links(document: Any) -> dict[str, Any]:
    if not isinstance(document, dict):
        raise InputError("no spheres; expected {LINK: {spheres: [{origin: [x, y, z], radius: r}, …]}}")
    return document


def _of_link(document: Any, name: str) -> Any:
    rows = document.get("spheres") if isinstance(document, dict) else None
    if not isinstance(rows, list) or not all(isinstance(each, dict) for each in rows):
        raise InputError(f"'{name}' has no spheres; expected spheres: [{{origin: [x, y, z], radius: r}}, …]")
    return checked_spheres([(each.get("origin"), each.get("radius")) for each in rows], name)


FORMAT = RobotFormat((".json",), b"spheres", write_json, read_json)

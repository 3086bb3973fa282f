"""What a file of a scene states: how many triangles it shows, and its unit. Its reader may lose some without a word."""

import json
import zipfile
from collections.abc import Callable, Mapping
from io import BytesIO
from typing import Any, NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from hhsim.errors import MeshError

MOST_NODES = 10_000
"""Most nodes of a scene, and most meshes that it shows, each as often as it is shown: a reader takes 1 ms for each."""

METRES_OF_3MF = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
"""Units of 3MF, and their length [m]."""


class Stated(NamedTuple):
    """Unit of a file and number of its triangles, as the file states them."""

    triangles: int  # number of triangles of the scene that is shown, each as often as it is shown
    metre: float  # length of its unit [m]


def of_gltf(content: bytes) -> Stated:
    """Return what a glTF states, text or binary; MeshError for nodes that are no tree, or too many of them."""
    text = content[20 : 20 + int.from_bytes(content[12:16], "little")] if content.startswith(b"glTF") else content
    document = json.loads(text)
    nodes, meshes, accessors = (document.get(key, []) for key in ("nodes", "meshes", "accessors"))
    _require_few(len(nodes))
    _require_tree(nodes)
    scenes = document.get("scenes", [])
    shown = list(scenes[document.get("scene", 0)].get("nodes", [])) if scenes else []
    for node in shown:
        shown += nodes[node].get("children", [])

    def triangles(primitive: dict[str, Any]) -> int:
        if "POSITION" not in primitive["attributes"]:
            return 0
        corners = accessors[primitive.get("indices", primitive["attributes"]["POSITION"])]["count"]
        mode = primitive.get("mode", 4)
        return int(corners // 3 if mode == 4 else max(corners - 2, 0) if mode > 4 else 0)

    def times(node: dict[str, Any]) -> int:
        instances = node.get("extensions", {}).get("EXT_mesh_gpu_instancing", {}).get("attributes", {}).values()
        return int(max((accessors[each]["count"] for each in instances), default=1))

    each = [sum(map(triangles, mesh["primitives"])) for mesh in meshes]
    used = [nodes[node] for node in shown if "mesh" in nodes[node]]
    _require_few(sum(map(times, used)))
    return Stated(sum(times(node) * each[node["mesh"]] for node in used), 1.0)


def _require_few(nodes: int) -> None:
    if nodes > MOST_NODES:
        raise MeshError(f"a scene of {nodes:,} nodes; expected at most {MOST_NODES:,}: join their meshes to one")


def _require_tree(nodes: list[dict[str, Any]]) -> None:
    """Raise MeshError for a node under two others, or under itself: readers leave it out, or take it for the root."""
    below = [node.get("children", []) for node in nodes]
    children = [child for each in below for child in each]
    reached = sorted(set(range(len(nodes))) - set(children))
    # Each node is the child of one other at most, so this ends.
    if len(set(children)) == len(children):
        for node in reached:
            reached += below[node]
    if len(reached) != len(nodes):
        raise MeshError("its nodes go in a circle, or one has two parents; expected a tree of nodes")


def of_3mf(content: bytes) -> Stated:
    """Return what a 3MF states, whose objects may be made of others, also of those of another of its files."""
    with zipfile.ZipFile(BytesIO(content)) as archive:
        models = {
            name.lstrip("/").lower(): ElementTree.fromstring(archive.read(name))
            for name in archive.namelist()
            if name.lower().endswith(".model")
        }
    main = next(name for name in models if "3d/3dmodel.model" in name)
    objects = {(name, each.get("id")): each for name, root in models.items() for each in root.findall(".//{*}object")}
    counted = dict[tuple[str, str | None], tuple[int, int]]()

    def count(use: Element, file: str, above: tuple[Element, ...] = ()) -> tuple[int, int]:
        """Return the numbers of meshes and of triangles of the object that an item or a component names."""
        path = next((value.lstrip("/").lower() for key, value in use.attrib.items() if key.endswith("path")), file)
        key = path, use.get("objectid")
        if key not in counted:
            if objects[key] in above:
                raise MeshError("an object is a part of itself; expected a tree of objects")
            parts = [count(each, path, (*above, objects[key])) for each in objects[key].findall(".//{*}component")]
            own = len(objects[key].findall(".//{*}triangle"))
            counted[key] = 1 + sum(part[0] for part in parts), own + sum(part[1] for part in parts)
        return counted[key]

    shown = [count(item, main) for item in models[main].findall(".//{*}build/{*}item")]
    _require_few(sum(meshes for meshes, _ in shown))
    return Stated(sum(triangles for _, triangles in shown), METRES_OF_3MF[models[main].get("unit", "millimeter")])


def of_dae(content: bytes) -> Stated:
    """Return what a COLLADA states; the triangles of its skins count, too."""
    root = ElementTree.fromstring(content)
    geometries = {each.get("id"): sum(map(_of_primitive, each.iter())) for each in root.iterfind(".//{*}geometry")}
    skins = {
        each.get("id"): skin.get("source", "")
        for each in root.iterfind(".//{*}controller")
        for skin in each.iterfind("{*}skin")
    }
    named = {each.get("id"): each for each in root.iterfind(".//{*}node")}
    instances = 0

    def count(element: Element, depth: int = 0) -> int:
        nonlocal instances
        instances += 1
        _require_few(instances)
        if depth > 100:
            raise MeshError("a node is a part of itself; expected a tree of nodes")
        found = 0
        for each in element:
            kind, url = each.tag.rpartition("}")[2], each.get("url", "").lstrip("#")
            if kind == "node":
                found += count(each, depth + 1)
            elif kind == "instance_node" and url in named:
                found += count(named[url], depth + 1)
            elif kind in ("instance_geometry", "instance_controller"):
                found += geometries.get(skins.get(url, url).lstrip("#"), 0)
        return found

    unit = root.find("{*}asset/{*}unit")
    metre = 1.0 if unit is None else float(unit.get("meter", "1"))
    shown = (root.find("{*}scene/{*}instance_visual_scene"), *root.iterfind(".//{*}visual_scene"))
    url = "" if shown[0] is None else shown[0].get("url", "").lstrip("#")
    return Stated(sum(count(each) for each in shown[1:] if each is not None and each.get("id") == url), metre)


def _of_primitive(element: Element) -> int:
    """Return the number of triangles of an element of a COLLADA, 0 if it is no primitive."""
    kind = element.tag.rpartition("}")[2]
    if kind == "triangles":
        return int(element.get("count", "0"))
    if kind == "polylist":
        return sum(max(int(size) - 2, 0) for size in (element.findtext("{*}vcount") or "").split())
    if kind in ("polygons", "tristrips", "trifans"):
        inputs = 1 + max((int(each.get("offset", "0")) for each in element.iterfind("{*}input")), default=0)
        rings = element.iterfind("{*}p")
        return sum(max(len((ring.text or "").split()) // inputs - 2, 0) for ring in rings)
    return 0


def of_zae(content: bytes) -> Stated:
    """Return what the COLLADA in a zipped one states."""
    with zipfile.ZipFile(BytesIO(content)) as archive:
        return of_dae(archive.read(next(name for name in archive.namelist() if name.lower().endswith(".dae"))))


STATED: Mapping[str, Callable[[bytes], Stated]] = {
    "gltf": of_gltf,
    "glb": of_gltf,
    "3mf": of_3mf,
    "dae": of_dae,
    "zae": of_zae,
}
"""What a file states, by its format."""

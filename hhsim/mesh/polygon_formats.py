"""Mesh formats of points and polygons: OBJ, OFF and STL. All that a file states is read, or it is refused."""

import io
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.mesh.topology import polygon_triangles
from hhsim.system.counted import counted

NO_END = "its last solid has no 'endsolid': the file may be cut"

_STL_HEAD = 84
_STL_FACET = np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")])


class Triangles(NamedTuple):
    """Triangles of a file, unmerged; the parts of a scene are joined in its frame."""

    vertices: FloatArray  # in the unit of the file, shape (V, 3)
    faces: IntArray  # corner indices, shape (F, 3)
    metre: float | None = None  # length of the unit that the file states [m]; None if it states none
    warnings: tuple[str, ...] = ()  # suspicions, a sentence each


def text_of(content: bytes) -> str:
    """Decode text with any byte-order mark or none, its lines ended by a newline; MeshError where it is none."""
    is_wide = content.startswith((BOM_UTF16_LE, BOM_UTF16_BE))
    with io.TextIOWrapper(io.BytesIO(content), "utf-16" if is_wide else "utf-8-sig", "replace") as file:
        text = file.read()
    if "\0" in text:
        raise MeshError("damaged, or of another kind")
    return text


def read_obj(content: bytes) -> Triangles:
    """Read all faces of an OBJ; a relative index counts back from its own line."""
    points, corners, sizes = list[list[str]](), list[int](), list[int]()
    for number, line in enumerate(text_of(content).replace("\\\n", " ").split("\n"), 1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if words[0] == "v":
            if len(words) < 4:
                raise MeshError(f"line {number} reads '{line.strip()[:60]}', expected v x y z")
            points.append(words[1:4])
        elif words[0] == "f":
            try:
                ring = [int(word.partition("/")[0]) for word in words[1:]]
            except ValueError:
                ring = [0]
            # Indices count from 1, or back from the last vertex so far.
            if len(ring) < 3 or 0 in ring or len(points) + min(ring) < 0:
                raise MeshError(f"line {number} reads '{line.strip()[:60]}', expected f with three vertices or more")
            corners += [index - 1 if index > 0 else len(points) + index for index in ring]
            sizes.append(len(ring))
    return _cut(points, corners, sizes)


def read_off(content: bytes) -> Triangles:
    """Read an OFF as long as its own counts say."""
    lines = [words for line in text_of(content).split("\n") if (words := line.partition("#")[0].split())]
    head = re.fullmatch(r"(ST|C|N)*OFF(.*)", " ".join(lines[0])) if lines else None
    if head is None:
        raise MeshError("the first line does not read OFF")
    counts, rows = (head[2].split(), lines[1:]) if head[2].strip() else (lines[1] if lines[1:] else [], lines[2:])
    if len(counts) < 2 or not (counts[0].isdecimal() and counts[1].isdecimal()):
        raise MeshError("expected the numbers of its vertices and faces below OFF")
    points, faces = int(counts[0]), int(counts[1])
    rings = [row[1 : 1 + int(row[0])] for row in rows[points : points + faces]]
    complete = sum(len(ring) == int(row[0]) for ring, row in zip(rings, rows[points:]))
    if complete < faces or any(len(row) < 3 for row in rows[:points]):
        raise MeshError(f"{complete:,} of {faces:,} faces are there: is the file cut?")
    corners = [int(index) for ring in rings for index in ring]
    return _cut([row[:3] for row in rows[:points]], corners, [len(ring) for ring in rings])


def read_stl(content: bytes) -> Triangles:
    """Read a binary STL of the length that it states, or all solids of one that is text."""
    stated = int.from_bytes(content[80:_STL_HEAD], "little")
    if len(content) == _STL_HEAD + stated * _STL_FACET.itemsize:
        corner = np.frombuffer(content, _STL_FACET, offset=_STL_HEAD)["corner"].reshape(-1, 3)
        return Triangles(corner.astype(np.float64), np.arange(len(corner)).reshape(-1, 3))
    text = text_of(content).lower()
    facets = len(re.findall(r"^\s*facet\b", text, re.MULTILINE))
    if text.strip() and not facets and not re.match(r"\s*solid\b", text):
        raise MeshError("damaged, or of another kind")
    rows = [row.split() for row in re.findall(r"^\s*vertex\b(.*)$", text, re.MULTILINE)]
    if len(rows) != 3 * facets or any(len(row) != 3 for row in rows):
        raise MeshError(f"{counted(facets, 'facet')} and {counted(len(rows), 'vertex')}: is the file cut?")
    ends = len(re.findall(r"^\s*endsolid\b", text, re.MULTILINE))
    is_cut = ends < len(re.findall(r"^\s*solid\b", text, re.MULTILINE))
    faces = np.arange(len(rows)).reshape(-1, 3)
    return Triangles(_numbers(rows), faces, warnings=(NO_END,) if is_cut else ())


READERS: Mapping[str, Callable[[bytes], Triangles]] = {
    "obj": read_obj,
    "off": read_off,
    "stl": read_stl,
    "stl_ascii": read_stl,
}
"""Reader of each format, which raises MeshError or ValueError for one that is not whole."""


def _cut(points: list[list[str]], corners: list[int], sizes: list[int]) -> Triangles:
    vertices, index = _numbers(points), np.array(corners, dtype=np.int64)
    if len(index) and not 0 <= index.min() <= index.max() < len(points):
        raise MeshError(f"a face names vertex {index.max() + 1:,} of {len(points):,}")
    return Triangles(vertices, polygon_triangles(vertices, index, np.array(sizes, dtype=np.int64)))


def _numbers(rows: list[list[str]]) -> FloatArray:
    return np.array(rows, dtype=np.float64).reshape(-1, 3)

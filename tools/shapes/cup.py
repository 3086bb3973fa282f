"""A cup by formula: a turned wall, open at the top, with a handle."""

from itertools import pairwise

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.mesh import Mesh
from tools.shapes.surface_parts import band, circle, fan, finished_mesh

CUP_SEGMENTS = 72
CUP_ROW = 0.003
HANDLE_COLUMNS = 4
HANDLE_ROWS = 4
HANDLE_RINGS = 26


def cup(diameter: float = 0.08, height: float = 0.092, wall: float = 0.0035, handle_reach: float = 0.032) -> Mesh:
    """Cup, open at the top, with a handle on the +x side that a finger fits through.

    The wall is a turned profile with a round lip; the handle is a swept ellipse that grows out of two rectangular
    openings in the outer wall, vertex to vertex, so that no boolean operation is needed.

    Args:
        diameter: Outer diameter at the lip [m].
        height: Height [m].
        wall: Thickness of the wall [m].
        handle_reach: How far the handle's centre line stands out from the wall [m].
    """
    radius = diameter / 2.0
    profile, first_row, last_row = _cup_profile(radius, height, wall)
    ring = circle(CUP_SEGMENTS)
    body = np.concatenate([np.column_stack([r * ring, np.full(CUP_SEGMENTS, z)]) for r, z in profile])
    rings = np.arange(len(body)).reshape(len(profile), CUP_SEGMENTS)
    poles = np.array([[0.0, 0.0, profile[0, 1]], [0.0, 0.0, profile[-1, 1]]])

    middle = (first_row + last_row) // 2
    half_span = round(0.29 * height / CUP_ROW)
    openings = [middle + half_span - HANDLE_ROWS // 2, middle - half_span - HANDLE_ROWS // 2]
    faces: list[IntArray] = []
    left = -(HANDLE_COLUMNS // 2) % CUP_SEGMENTS
    for row in range(len(profile) - 1):
        quads = band(rings[row], rings[row + 1]).reshape(2, CUP_SEGMENTS, 3)
        if any(start <= row < start + HANDLE_ROWS for start in openings):
            cut = (left + np.arange(HANDLE_COLUMNS)) % CUP_SEGMENTS
            quads = np.delete(quads, cut, axis=1)
        faces.append(quads.reshape(-1, 3))
    faces += [fan(len(body), rings[0])[:, ::-1], fan(len(body) + 1, rings[-1])]

    columns, rows = _opening_loop()
    upper = rings[openings[0] + rows, (left + columns) % CUP_SEGMENTS]
    lower = rings[openings[1] + HANDLE_ROWS - rows, (left + columns) % CUP_SEGMENTS]
    shape = np.stack([columns / HANDLE_COLUMNS - 0.5, rows / HANDLE_ROWS - 0.5], axis=1)
    handle = _handle_rings(body[upper], body[lower], shape, handle_reach)
    offset = len(body) + 2
    loops = [upper, *(offset + np.arange(handle.shape[0] * handle.shape[1]).reshape(handle.shape[:2])), lower]
    faces += [band(lower_loop, upper_loop) for lower_loop, upper_loop in pairwise(loops)]
    vertices = np.concatenate([body, poles, handle.reshape(-1, 3)])
    source = f"cup(diameter={diameter}, height={height}, wall={wall}, handle_reach={handle_reach})"
    return finished_mesh(vertices, faces, "cup", source)


def _cup_profile(radius: float, height: float, wall: float) -> tuple[FloatArray, int, int]:
    """Turned profile (r, z) [m] from the bottom round the lip to the inner bottom; first and last row of the wall."""
    foot, base = 0.88 * radius, 1.6 * wall
    round_out, round_in = 2.0 * wall, 2.5 * wall

    def outer(z: FloatArray) -> FloatArray:
        return np.asarray(foot + (radius - foot) * (z / height))

    quarter = np.linspace(0.0, np.pi / 2.0, 5)
    heel_r = float(outer(np.array(round_out)))
    heel = np.column_stack([heel_r - round_out * (1.0 - np.sin(quarter)), round_out * (1.0 - np.cos(quarter))])
    lip_z = height - wall / 2.0
    steps = round((lip_z - round_out) / CUP_ROW)
    z = np.linspace(round_out, lip_z, steps + 1)
    straight = np.column_stack([outer(z), z])
    lip_r = float(outer(np.array(lip_z))) - wall / 2.0
    half = np.linspace(0.0, np.pi, 7)[1:-1]
    lip = np.column_stack([lip_r + wall / 2.0 * np.cos(half), lip_z + wall / 2.0 * np.sin(half)])
    z_in = np.linspace(lip_z, base + round_in, steps // 3 + 1)
    inside = np.column_stack([outer(z_in) - wall, z_in])
    corner_r = float(inside[-1, 0])
    fillet = np.column_stack([corner_r - round_in * (1.0 - np.cos(quarter)), base + round_in * (1.0 - np.sin(quarter))])
    bottom = np.array([[corner_r - round_in - 0.3 * corner_r, base]])
    start = np.array([[heel[0, 0] * 0.55, 0.0]])
    profile = np.concatenate([start, heel[:-1], straight, lip, inside[:-1], fillet, bottom])
    first = len(start) + len(heel) - 1
    return profile, first, first + steps


def _opening_loop() -> tuple[IntArray, IntArray]:
    """Columns and rows around a rectangular opening, counter-clockwise seen from outside, both shape (n,)."""
    across, up = np.arange(HANDLE_COLUMNS), np.arange(HANDLE_ROWS)
    columns = np.concatenate([across, np.full(HANDLE_ROWS, HANDLE_COLUMNS), across[::-1] + 1, np.zeros(HANDLE_ROWS)])
    rows = np.concatenate([np.zeros(HANDLE_COLUMNS), up, np.full(HANDLE_COLUMNS, HANDLE_ROWS), up[::-1] + 1])
    return columns.astype(np.int64), rows.astype(np.int64)


def _handle_rings(upper: FloatArray, lower: FloatArray, shape: FloatArray, reach: float) -> FloatArray:
    """Rings of the handle between its two openings [m], shape (rings, n, 3)."""
    angle = np.arctan2(shape[:, 1], shape[:, 0])
    ellipse = np.stack([0.0060 * np.cos(angle), 0.0042 * np.sin(angle)], axis=1)
    top, bottom = upper.mean(axis=0), lower.mean(axis=0)
    at = np.arange(1, HANDLE_RINGS) / HANDLE_RINGS
    phi = np.pi * at
    half_height = (top[2] - bottom[2]) / 2.0
    root = top[0] + (bottom[0] - top[0]) * at
    path = np.stack([root + reach * np.sin(phi), (top[2] + bottom[2]) / 2.0 + half_height * np.cos(phi)], axis=1)
    tangent = np.stack([reach * np.cos(phi), -half_height * np.sin(phi)], axis=1)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    rings = []
    for position, (tx, tz), phase in zip(path, tangent, at):
        # Wide near the wall, so that the handle grows out of its opening.
        flare = 1.0 + 0.28 * np.exp(-((min(phase, 1.0 - phase) / 0.06) ** 2))
        y, n = ellipse.T * flare
        rings.append(np.column_stack([position[0] - n * tz, y, position[1] + n * tx]))
    return np.array(rings)

"""A small robot's hand, written by the tests: three fingers of three joints on a palm, and where they are."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

LENGTHS = (0.05, 0.03, 0.02)
BASES = {"thumb": (0.0, -0.03, 0.0), "index": (0.01, 0.03, 0.08), "little": (0.02, -0.03, 0.09)}
TURNED = {"thumb": (1.2, 0.0, 0.0), "index": (0.0, 0.1, 0.0), "little": (0.1, 0.0, 0.0)}
"""Roll, pitch and yaw of the fingers' first frames [rad]."""
RANGE = (-0.2, 1.6)
JOINTS = 9
BOX = (0.01, 0.012, 0.014)
"""Edges of the box at each fingertip [m]."""


def write_robot(path: Path, mimic: bool = False, shape: str = "") -> Path:
    """Write a URDF; with `mimic` the last joint of a finger turns half as far as the one before, and 0.1 rad more."""
    box = shape or f'<box size="{BOX[0]} {BOX[1]} {BOX[2]}"/>'
    parts = ['<link name="palm"/>']
    for finger, base in BASES.items():
        parent, place, turn = "palm", base, TURNED[finger]
        for k, length in enumerate(LENGTHS):
            follows = f'<mimic joint="{finger}_1" multiplier="0.5" offset="0.1"/>' if mimic and k == 2 else ""
            xyz, rpy = (" ".join(map(str, values)) for values in (place, turn))
            parts.append(
                f'<joint name="{finger}_{k}" type="revolute"><parent link="{parent}"/><child link="{finger}_link{k}"/>'
                f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{"0 1 0" if k else "1 0 0"}"/>'
                f'<limit lower="{RANGE[0]}" upper="{RANGE[1]}" effort="1" velocity="1"/>{follows}</joint>'
                f'<link name="{finger}_link{k}"/>'
            )
            parent, place, turn = f"{finger}_link{k}", (0.0, 0.0, length), (0.0, 0.0, 0.0)
        parts.append(
            f'<joint name="{finger}_end" type="fixed"><parent link="{parent}"/><child link="{finger}_tip"/>'
            f'<origin xyz="0 0 {LENGTHS[-1]}"/></joint>'
            f'<link name="{finger}_tip"><collision><geometry>{box}</geometry></collision></link>'
        )
    path.write_text(f'<?xml version="1.0"?><robot name="two">{"".join(parts)}</robot>')
    return path


def expected_tips(angles: np.ndarray) -> np.ndarray:
    """Fingertips in the root's frame [m], shape (3, 3), at the nine angles, thumb first."""
    tips = []
    for row, finger in enumerate(BASES):
        place, turn = np.array(BASES[finger]), Rotation.from_euler("xyz", TURNED[finger])
        for axis, angle, length in zip("xyy", angles[3 * row :], LENGTHS):
            turn = turn * Rotation.from_euler(axis, angle)
            place = place + turn.apply([0.0, 0.0, length])
        tips.append(place)
    return np.array(tips)

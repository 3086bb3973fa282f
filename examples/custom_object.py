"""Write a mesh of one's own, a chess pawn, as an STL file in millimetres: `python custom_object.py pawn.stl`.

Any program that writes closed triangle meshes does as well; only the unit is not in the file, so that hhsim is told it.
"""

import math
import sys
from itertools import pairwise
from pathlib import Path

SEGMENTS = 48
FOOT = [(0.0, 0.0), (21.0, 0.0), (22.0, 2.0), (22.0, 6.0), (18.0, 9.0), (13.0, 14.0), (9.0, 24.0), (8.0, 36.0)]
COLLAR = [(13.0, 39.0), (13.0, 42.0), (9.0, 44.0)]
HEAD = [(14.0 * math.cos(t), 55.0 + 14.0 * math.sin(t)) for t in (-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9, 1.2, 1.4)]
PROFILE = [*FOOT, *COLLAR, *HEAD, (0.0, 69.0)]  # radius and height [mm], from the middle of the foot to the top


def point(radius, height, k):
    angle = 2.0 * math.pi * (k % SEGMENTS) / SEGMENTS
    return (radius * math.cos(angle), radius * math.sin(angle), height)


def triangles():
    """Two for each piece of the profile and each segment around, outward; one where the profile is at its axis."""
    for (r0, z0), (r1, z1) in pairwise(PROFILE):
        for k in range(SEGMENTS):
            a, b = point(r0, z0, k), point(r0, z0, k + 1)
            c, d = point(r1, z1, k + 1), point(r1, z1, k)
            if r0 > 0.0:
                yield a, b, c
            if r1 > 0.0:
                yield a, c, d


lines = ["solid pawn"]
for triangle in triangles():
    lines += ["facet normal 0 0 0", "outer loop"]
    lines += [f"vertex {x:.6f} {y:.6f} {z:.6f}" for x, y, z in triangle]
    lines += ["endloop", "endfacet"]
Path(sys.argv[1]).write_text("\n".join([*lines, "endsolid pawn\n"]))

"""References for trees of this and of other programs: the bars of hhsim, and peers on the same shapes.

All figures are for objects with a longest extent of 100 mm; errors scale with it.
"""

from dataclasses import dataclass

EXTENT = 0.1
"""Longest extent of the objects of the figures [m]."""

LEAST_GAP = 1e-9
"""A gap up to this is none [m]."""


@dataclass(frozen=True)
class Bar:
    """Largest protrusion of a tree from the mesh [m], and CPU time of its builder without compilation [s]."""

    protrusion: float
    cpu: float


BARS: dict[tuple[str, int], Bar] = {
    ("bunny", 512): Bar(0.70e-3, 2.0),
    ("teapot", 512): Bar(0.70e-3, 2.0),
    ("cube", 512): Bar(1.9e-3, 2.0),
    ("hexagonal-prism", 512): Bar(1.45e-3, 2.0),
    ("cylinder", 512): Bar(1.25e-3, 2.0),
    ("bunny", 4096): Bar(0.18e-3, 12.0),
    ("teapot", 4096): Bar(0.17e-3, 12.0),
    ("cube", 4096): Bar(0.37e-3, 12.0),
    ("hexagonal-prism", 4096): Bar(0.30e-3, 12.0),
    ("cylinder", 4096): Bar(0.23e-3, 12.0),
    ("cup", 4096): Bar(0.85e-3, 12.0),
}
"""Bars by object and number of leaves."""


@dataclass(frozen=True)
class Reference:
    """Spheres of another program on the same shape, measured in November 2026 on one core of a 2-core machine.

    Largest and mean protrusion [m], the mean over the free surface; gap [m]; CPU time of the build [s]. None: unknown.
    """

    object: str
    label: str
    spheres: int | None
    protrusion: float
    protrusion_mean: float | None = None
    gap: float | None = None
    cpu: float | None = None


TOOLKIT = "toolkit 2004, medial"
"""Program of Bradshaw and O'Sullivan with its adaptive medial axis."""

REFERENCES: tuple[Reference, ...] = (
    Reference("bunny", TOOLKIT, 505, 2.97e-3, 0.545e-3, 0.55e-3, 137.0),
    Reference("bunny", TOOLKIT, 2924, 2.85e-3, 0.249e-3, 0.75e-3, 1937.0),
    Reference("teapot", TOOLKIT, 500, 1.81e-3, 0.54e-3, 0.54e-3, 110.0),
    Reference("cube", TOOLKIT, 507, 2.92e-3, 0.78e-3, 1.21e-3, 27.0),
    Reference("cube", TOOLKIT, 3163, 2.44e-3, 0.12e-3, 1.94e-3, 1905.0),
    Reference("hexagonal-prism", TOOLKIT, 438, 2.51e-3, 0.87e-3, 1.06e-3, 30.0),
    Reference("cylinder", TOOLKIT, 509, 2.39e-3, 0.69e-3, 0.97e-3, 54.0),
    Reference("cup", TOOLKIT, 497, 7.6e-3, 2.6e-3, 0.93e-3, 179.0),
    Reference("bunny", "toolkit 2004, octree", None, 20.7e-3, 11.8e-3),
    Reference("bunny", "toolkit 2004, Hubbard", None, 8.7e-3, 3.1e-3),
    Reference("bunny", "toolkit 2004, grid", None, 4.7e-3, 0.98e-3),
    Reference("bunny", "toolkit 2004, spawn", None, 5.7e-3, 1.6e-3),
    Reference("bunny", "MorphIt", 512, 1.9e-3, None, 3.2e-3, 46.0),
    Reference("bunny", "Ballpark", 339, 7.97e-3, 2.49e-3, 4.3e-3),
    Reference("bunny", "cuRobo", 110, 3.17e-3, None, 5.8e-3),
    Reference("bunny", "Wang 2006", 64, 7.07e-3, 1.61e-3, None, 482.0),
)
"""Level 3 where a program that builds trees names no number of spheres. Of a range the better end is kept."""

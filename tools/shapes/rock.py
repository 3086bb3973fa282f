"""A rock by formula: facets, worn edges, an uneven surface."""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.mesh.mesh import Mesh
from tools.shapes.surface_parts import finished_mesh, icosphere


def rock(size: float = 0.1, seed: int = 7, subdivisions: int = 4) -> Mesh:
    """Boulder with broad facets, worn edges and an uneven surface.

    A unit sphere is cut by random planes whose edges a power mean rounds off, then displaced along the radius by random
    waves of falling amplitude. The radius is one positive number a direction, so the surface cannot cross itself.

    Args:
        size: Longest extent [m].
        seed: Another seed is another rock.
        subdivisions: Splits of the icosahedron; 4 gives 5,120 triangles.
    """
    generator = np.random.default_rng(seed)
    direction, faces = icosphere(subdivisions)
    normal = _random_directions(generator, 26)
    distance = generator.uniform(0.74, 1.0, len(normal))
    reach = np.maximum(direction @ normal.T / distance, 0.0)
    radius = np.sum(reach**18.0, axis=1) ** (-1.0 / 18.0)
    for frequency, amplitude in ((3.0, 0.035), (6.0, 0.022), (12.0, 0.014), (22.0, 0.007)):
        wave = _random_directions(generator, 10) * frequency
        phase = generator.uniform(0.0, 2.0 * np.pi, len(wave))
        noise = np.cos(direction @ wave.T + phase).sum(axis=1) * (2.0 / len(wave)) ** 0.5
        # A folded wave has creases, as a broken surface has.
        radius = radius + amplitude * (0.5 - np.abs(noise))
    vertices = direction * radius[:, None] * np.array([1.0, 0.82, 0.7])
    vertices *= size / np.ptp(vertices, axis=0).max()
    return finished_mesh(vertices, faces, "rock", f"rock(size={size}, seed={seed}, subdivisions={subdivisions})")


def _random_directions(generator: np.random.Generator, count: int) -> FloatArray:
    """Uniform directions, shape (count, 3), from uniform numbers alone, whose stream numpy keeps fixed."""
    z = generator.uniform(-1.0, 1.0, count)
    angle = generator.uniform(0.0, 2.0 * np.pi, count)
    ring = np.sqrt(1.0 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)

"""Random programs in the likeness of contacts, by size: to compare solvers at sizes that published tables have.

A finger's program (3 variables), the palm's (6) and the whole hand's (21), with contacts in patches of about eight
whose normals differ by a few degrees, a command some millimetres deep, and the default stiffness.
"""

from collections.abc import Iterator

import numpy as np

from hhsim.bench.qp.program import Program, dense_program

SIZES = ((3, 10), (3, 100), (6, 100), (6, 250), (21, 50), (21, 250), (21, 500))
"""Variables and rows."""

PATCH = 8
"""Contacts of a patch, on average."""
TRANSLATION, ROTATION, FLEXION = 1000.0, 5.0, 0.5
"""Stiffness [N/m], [N·m/rad], [N·m/rad]."""
TOLERANCE = 3e-12
"""Violation that counts as satisfied [√J]: 0.1 pm."""


def contact_programs(variables: int, rows: int, count: int, seed: int) -> Iterator[Program]:
    """`count` programs of one size.

    Raises:
        ValueError: for other than 3, 6 or 21 variables.
    """
    rng = np.random.default_rng([seed, variables, rows])
    kind = f"{variables}×{rows}"
    for _ in range(count):
        yield _contacts(rng, kind, variables, rows)


def _contacts(rng: np.random.Generator, kind: str, n: int, m: int) -> Program:
    patches = max(1, m // PATCH)
    patch = rng.integers(0, patches, size=m)
    normal = rng.normal(size=(patches, 3))[patch] + 0.05 * rng.normal(size=(m, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    point = 0.05 * rng.normal(size=(patches, 3))[patch] + 0.002 * rng.normal(size=(m, 3))
    lever = 0.03 * rng.normal(size=(patches, 3))[patch] + 0.002 * rng.normal(size=(m, 3))
    root = np.sqrt([TRANSLATION] * 3 + [ROTATION] * 3 + [FLEXION] * 15)
    reach = np.array([5e-3] * 3 + [0.05] * 3 + [0.1] * 15) * root
    matrix = np.zeros((m, 21))
    matrix[:, :3] = normal
    matrix[:, 3:6] = np.cross(point, normal)
    owner = rng.integers(0, 6, size=patches)[patch]
    for finger in range(1, 6):
        own = owner == finger
        matrix[own, 3 + 3 * finger : 6 + 3 * finger] = lever[own]
    if n == 3:
        matrix, root, reach = lever, root[6:9], reach[6:9]
    elif n == 6:
        matrix, root, reach = matrix[:, :6], root[:6], reach[:6]
    elif n != 21:
        raise ValueError(f"{n} variables are no finger, palm or hand")
    matrix = matrix / root
    inside = 0.1 * reach * rng.normal(size=n)
    rhs = matrix @ inside - rng.exponential(3e-4, size=m)
    return dense_program(kind, matrix, rhs, inside + reach * rng.normal(size=n), TOLERANCE)

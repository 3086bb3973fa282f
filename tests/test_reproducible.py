"""Products, angles and axes that do not depend on the machine, against numpy's; what enters a tick uses no others."""

import ast

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hhsim.arrays import FloatArray
from hhsim.reproducible import arc_tangent, dot, exponential, matmul, norm, principal_axes, sine_and_cosine
from tools.import_graph import REPOSITORY

ENTERS_A_TICK = ("kernels", "hand", "motion", "scene", "solver", "trees", "mesh")
"""Packages of what a tick is computed from, and of the tick."""
ANYWHERE_ELSE = {
    "scene/overlap.py": {"@", "**"},  # depths that a scene is refused for
    "trees/builder.py": {"math.log", "**"},  # a first guess of a number of spheres
    "trees/surface_cover.py": {"**"},  # a share, of which the whole part is taken
    "trees/sphere_tree.py": {"np.linalg.det"},  # its sign, of a rotation or a mirror
    "solver/qp.py": {"@"},  # programs for other solvers, whose bits are theirs
    "mesh/isosurface.py": {"np.log2", "np.einsum"},
    "mesh/mesh.py": {"**"},  # a bound for meshes that enclose nothing
    "mesh/repair.py": {"**"},
    "mesh/topology.py": {"@", "np.linalg.svd", "np.einsum"},
}
"""Where the last bit may depend on the machine: estimates, times, and the repair of meshes."""
LIBM = {"sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "expm1", "log", "log2", "log1p", "pow", "hypot"}
LIBM |= {"sinh", "cosh", "tanh", "cbrt", "arcsin", "arccos", "arctan", "arctan2", "power", "float_power"}
BLAS = {"dot", "matmul", "einsum", "tensordot", "vdot", "inner"}
LAPACK = {"eig", "eigh", "eigvals", "eigvalsh", "svd", "solve", "inv", "pinv", "det", "lstsq", "qr", "cholesky"}


def depends_on_the_machine(node: ast.AST) -> str:
    """What of an expression a library may round by the processor; "" for nothing."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
        return "@"
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        # A square is one product, and powers of whole numbers are exact.
        square = isinstance(node.right, ast.Constant) and node.right.value == 2
        of_two = isinstance(node.left, ast.Constant) and node.left.value in (2.0, 10)
        return "" if square or of_two or "branching" in ast.unparse(node.left).lower() else "**"
    if not isinstance(node, ast.Attribute):
        return ""
    text = ast.unparse(node)
    library, _, name = text.rpartition(".")
    if library in ("math", "np") and name in LIBM | BLAS:
        return text
    return text if library == "np.linalg" and name in LAPACK else ""


def test_what_enters_a_tick_takes_no_last_bit_from_a_library() -> None:
    found: dict[str, set[str]] = {}
    for package in ENTERS_A_TICK:
        for path in (REPOSITORY / "hhsim" / package).rglob("*.py"):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            for node in ast.walk(tree):
                if what := depends_on_the_machine(node):
                    found.setdefault(path.relative_to(REPOSITORY / "hhsim").as_posix(), set()).add(what)
                if isinstance(node, ast.Call) and ast.unparse(node.func) == "np.linalg.norm":
                    along = any(keyword.arg == "axis" for keyword in node.keywords)
                    # Without an axis numpy takes the norm by BLAS.
                    if not along:
                        name = path.relative_to(REPOSITORY / "hhsim").as_posix()
                        found.setdefault(name, set()).add("np.linalg.norm")
    assert found == ANYWHERE_ELSE


def test_the_guard_sees_what_it_looks_for() -> None:
    seen = {"a @ b": "@", "x**3": "**", "math.sin(x)": "math.sin", "np.linalg.svd(a)": "np.linalg.svd", "x**2": ""}
    for text, what in seen.items():
        assert {depends_on_the_machine(node) for node in ast.walk(ast.parse(text))} - {""} == ({what} - {""})


MATRICES = arrays(np.float64, (3, 3), elements=st.floats(-10.0, 10.0))


@given(MATRICES, MATRICES)
def test_products(first: FloatArray, second: FloatArray) -> None:
    np.testing.assert_allclose(matmul(first, second), first @ second, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(matmul(first, second[0]), first @ second[0], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(matmul(first[None, None], second), (first @ second)[None, None], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(dot(first, second), np.einsum("ij,ij->i", first, second), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(norm(first), np.linalg.norm(first, axis=1), rtol=1e-15)


def test_a_product_takes_its_terms_one_after_the_other() -> None:
    first, second = np.random.default_rng(0).normal(size=(2, 3, 3))
    for i in range(3):
        for j in range(3):
            total = first[i, 0] * second[0, j]
            for k in (1, 2):
                total = total + first[i, k] * second[k, j]
            assert matmul(first, second)[i, j] == total


def test_angles_keep_the_shape() -> None:
    angle = np.random.default_rng(1).normal(size=(4, 5))
    sine, cosine = sine_and_cosine(angle)
    np.testing.assert_allclose([sine, cosine], [np.sin(angle), np.cos(angle)], rtol=0.0, atol=2e-16)
    np.testing.assert_allclose(arc_tangent(angle, angle[:1]), np.arctan2(angle, angle[:1]), rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(exponential(angle), np.exp(angle), rtol=1e-15)
    assert sine_and_cosine(0.5)[0].shape == arc_tangent(1.0, 2.0).shape == exponential(1.0).shape == ()


@given(arrays(np.float64, (4, 3), elements=st.floats(-10.0, 10.0)))
def test_principal_axes_diagonalise_the_matrix(points: FloatArray) -> None:
    matrix = points.T @ points
    value, axes = principal_axes(matrix)
    scale = max(1.0, float(np.abs(matrix).max()))
    np.testing.assert_allclose(value, np.linalg.eigvalsh(matrix), rtol=0.0, atol=1e-13 * scale)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(axes @ np.diag(value) @ axes.T, matrix, rtol=0.0, atol=1e-13 * scale)
    assert np.linalg.det(axes) > 0.0
    assert all(axes[np.abs(axes[:, k]).argmax(), k] > 0.0 for k in (0, 1))

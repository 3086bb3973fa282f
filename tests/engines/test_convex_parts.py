"""Convex parts: a ball and a box are known as such, and what has to be decomposed is kept."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hhsim.engines import convex_parts as module
from hhsim.engines.convex_parts import COARSE, FINE, Ball, Box, Hull, convex_parts
from hhsim.mesh.catalogue import load_object


def test_a_sphere_is_a_ball_and_a_cube_a_box() -> None:
    (ball,) = convex_parts(load_object("sphere").mesh)
    assert isinstance(ball, Ball)
    away = np.linalg.norm(load_object("sphere").mesh.vertices - ball.center, axis=1)
    assert abs(ball.radius - away.max()) < 2e-3 * ball.radius
    cube = load_object("cube").mesh
    (box,) = convex_parts(cube)
    assert isinstance(box, Box)
    np.testing.assert_allclose(2.0 * box.half, cube.extent)


def test_what_is_convex_is_one_hull_and_needs_no_decomposition(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_decompose", None)
    mesh = load_object("hexagonal-prism").mesh
    (hull,) = convex_parts(mesh)
    assert isinstance(hull, Hull)
    assert {tuple(point) for point in hull.points} == {tuple(vertex) for vertex in mesh.vertices[np.unique(mesh.faces)]}


def test_parts_are_found_once_and_a_damaged_file_is_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, made = load_object("cup").mesh, []

    def decompose(given: object, concavity: float) -> list[np.ndarray]:
        made.append(given)
        return [mesh.vertices[:5], mesh.vertices[5:9]]

    monkeypatch.setattr(module, "_decompose", decompose)
    monkeypatch.setattr(module, "cache_root", lambda: tmp_path)
    first, again = convex_parts(mesh), convex_parts(mesh)
    assert made == [mesh]
    for one, other in zip(first, again, strict=True):
        assert isinstance(one, Hull) and isinstance(other, Hull)
        np.testing.assert_array_equal(one.points, other.points)
    (file,) = (tmp_path / "convex-parts").iterdir()
    file.write_bytes(b"not a file of numpy's")
    convex_parts(mesh)
    assert len(made) == 2


def test_finer_parts_are_others_and_a_closed_mesh_is_not_remeshed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = load_object("cup").mesh
    monkeypatch.setattr(module, "cache_root", lambda: tmp_path)
    monkeypatch.setattr(module, "_decompose", lambda mesh, concavity: [mesh.vertices[: round(1000 * concavity)]])
    sizes = [
        len(part.points) for limit in (COARSE, FINE) for part in convex_parts(mesh, limit) if isinstance(part, Hull)
    ]
    assert sizes == [20, 10]
    assert module._preparation(mesh) == "off"
    assert module._preparation(replace(mesh, faces=mesh.faces[1:])) == "auto"

"""The table of `hhsim bench mesh-size`: finer meshes of one object, ready in a fresh process, their ticks by turns."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run

from hhsim.bench import mesh_size
from hhsim.bench.mesh_size import COLUMNS, METHODS, MeshSizeOptions, Preparation, finer_mesh, measure
from hhsim.bench.table import load_table
from hhsim.errors import HhsimError
from hhsim.mesh.catalogue import load_object
from hhsim.trees.contact_surface import encloses

SMALL = MeshSizeOptions(object_name="cube", subdivisions=(1,))


@pytest.fixture(scope="module")
def rows() -> Iterator[list[dict[str, Any]]]:
    with pytest.MonkeyPatch.context() as patch:
        # A tree of level 4 takes half a minute, twice.
        patch.setattr(mesh_size, "MESH_LEVEL", 2)
        # A process takes two seconds of start: those of the object as it is are real.
        known, real = iter([Preparation(2.0, 1e8), Preparation(1.0, 1e8)]), mesh_size._in_fresh_process
        patch.setattr(mesh_size, "_in_fresh_process", lambda path: real(path) if path.stem == "cube" else next(known))
        yield measure(SMALL)


@pytest.mark.soak
def test_each_size_and_method_has_a_row_beside_the_object_as_it_is(rows: list[dict[str, Any]]) -> None:
    triangles = len(load_object("cube").mesh.faces)
    sizes = [(count, method) for count in (triangles, 4 * triangles) for method in METHODS]
    assert [(row["triangles"], row["method"]) for row in rows] == sizes
    for row in rows:
        first = next(other for other in rows if other["method"] == row["method"])
        assert row["tick_ratio"] == pytest.approx(row["tick_p50"] / first["tick_p50"])
        assert set(row) == {column.name for column in COLUMNS} and row["failure"] == ""
        assert row["ticks"] > 500 and 0.0 < row["tick_p50"] <= row["tick_p99"]
        assert 0 < row["candidates"] <= row["pair_tests"]
        assert row["ready"] > 0.0 and row["ready_again"] > 0.0 and 5e7 < row["memory"] < 4e9


def test_a_finer_mesh_is_closed_and_has_no_coplanar_neighbours() -> None:
    mesh = load_object("bunny").mesh
    finer = finer_mesh(mesh, 1)
    assert len(finer.faces) == 4 * len(mesh.faces) and encloses(finer)
    assert finer.volume == pytest.approx(mesh.volume, rel=0.01)
    assert finer_mesh(mesh, 1).sha256 == finer.sha256
    assert finer_mesh(mesh, 0) is mesh
    a, b, c = finer.triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    ends = np.sort(np.stack([finer.faces, np.roll(finer.faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    pairs = np.lexsort(ends.T).reshape(-1, 2) // 3
    bend = np.linalg.norm(np.cross(normal[pairs[:, 0]], normal[pairs[:, 1]]), axis=1)
    assert np.median(bend) > 0.01 and np.mean(bend < 1e-6) < 1e-3


def test_a_size_that_the_solver_does_not_hold_is_a_row_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        def __init__(self, *given: Any) -> None:
            pass

        def run(self, *haptic: Any) -> None:
            raise HhsimError("more pairs are near than fit")

    monkeypatch.setattr(mesh_size, "HandSolver", Full)
    monkeypatch.setattr(mesh_size, "_in_fresh_process", lambda path: mesh_size.Preparation(1.0, 1e8))
    for row in measure(SMALL):
        assert row["failure"] == "more pairs are near than fit"
        assert (row["ticks"], row["tick_p50"], row["tick_ratio"]) == (0, None, None)


def test_the_command_writes_its_table(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = [column.name for column in COLUMNS]
    row = {**dict.fromkeys(names, 1.0), "method": "coupled", "triangles": 12, "ticks": 700, "failure": ""}
    failed = {**row, "failure": "too many pairs", "tick_p50": None, "tick_ratio": None}
    rows = [row, {**row, "method": "progressive"}, failed]
    monkeypatch.setattr(mesh_size, "measure", lambda options, report: rows)
    done = run("bench", "mesh-size", "--object", "cube", "--subdivisions", "1", "--out", str(tmp_path / "sizes.h5"))
    assert done.code == 0 and "too many pairs" in done.out + done.err
    table = load_table(tmp_path / "sizes.h5")
    assert table.suite == "mesh-size" and len(table.rows) == len(rows)
    done = run("bench", "mesh-size", "--out", str(tmp_path / "sizes.h5"), "--json")
    assert json.loads(done.out)["rows"][0]["triangles"] == rows[0]["triangles"]

"""Speed against error: what is run, that the figures of the table are those of the runs, and the picture."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from referee_clearance import referee_clearance

from hhsim.bench.suite import run_cells
from hhsim.bench.suites.speed_error import (
    COLUMNS,
    DEFAULT_LEVEL,
    FULL,
    NO_LEVEL,
    SUITE,
    Configuration,
    SpeedErrorOptions,
    backend_configurations,
    cells,
    chosen,
    configurations,
    remarks,
    table_rows,
)
from hhsim.bench.trade_off import Run, placed_at, run_cell
from hhsim.report.figure import new_figure
from hhsim.report.trade_off import bench_trade_off, draw_trade_off
from hhsim.result.reader import Result
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions
from hhsim.system.progress import silent
from hhsim.table.file import ALL

pytestmark = pytest.mark.slow

SMALL = SpeedErrorOptions(
    objects=("cube",),
    motions=("touch",),
    methods=("coupled", "progressive"),
    surfaces=("spheres", "mesh"),
    levels=(1, 2),
    linearisations=(12,),
    backends=("clarabel",),
    repetitions=2,
    rate=50.0,
)


@pytest.fixture(scope="module")
def small() -> list[Run]:
    return list(run_cells(SUITE, SMALL))


def test_every_method_is_run_with_every_level_and_number_once() -> None:
    options = replace(SMALL, methods=tuple(METHODS), levels=(3, 4), linearisations=(1, 2, 12))
    found = configurations(options)
    on_mesh = [way for way in found if way.surface == "mesh"]
    assert len(found) == len(set(found)) == 6 * len(METHODS) + 6
    assert {(way.method, way.level) for way in on_mesh} == {("coupled", NO_LEVEL), ("progressive", NO_LEVEL)}
    for method in METHODS:
        (usual,) = [way for way in found if way.method == method and way.is_default]
        assert usual.solver_options() == SolverOptions(method=method)
    full = SpeedErrorOptions(**FULL.values)
    assert {*configurations(SpeedErrorOptions())} < {*configurations(full)} and len(configurations(full)) == 4 * (
        4 * len(METHODS) + 2
    )
    assert {*SpeedErrorOptions().levels} <= set(range(1, DEFAULT_LEVEL + 1)), "the trees that ship"
    for surfaces, level in ((("spheres", "mesh"), 4), (("mesh", "spheres"), NO_LEVEL)):
        own, _ = backend_configurations(replace(options, surfaces=surfaces))
        assert (own.surface, own.level) == (surfaces[0], level)


def test_every_configuration_runs_on_every_scene(small: list[Run]) -> None:
    whole = [run for run in small if not run.way.stretch]
    ours, other = (run for run in small if run.way.stretch)
    assert [run.way for run in whole] == configurations(SMALL)
    assert [ours.way, other.way] == backend_configurations(SMALL)
    for run in small:
        assert (run.object, run.motion, run.failure, run.repeatable) == ("cube", "touch", "", True)
        assert len(run.cpu) == len(run.other) == 2 and (np.array(run.cpu) > 0.0).all()
        assert run.figures["penetration_max"] <= 1e-6
    assert len({run.cpu[0].size for run in whole}) == 1, "the ticks in contact are the scene's, not the method's"
    assert ours.cpu[0].size == other.cpu[0].size < whole[0].cpu[0].size
    assert other.figures["off_optimum_mean"] == pytest.approx(ours.figures["off_optimum_mean"], abs=1e-4)
    (mesh,) = (run for run in whole if run.way.surface == "mesh" and run.way.method == "coupled")
    coarse = whole[0]
    assert mesh.figures["off_optimum_mean"] < 1e-6 < 1e-3 < coarse.figures["off_optimum_mean"]
    assert mesh.figures["mesh_error"] < 2e-6 < 1e-3 < coarse.figures["mesh_error"], "its spheres are off the mesh"


def test_a_hand_inside_the_mesh_is_told_by_how_much() -> None:
    cell = cells(replace(SMALL, levels=(1,), surfaces=("spheres",), backends=()), silent)[0]
    found: list[tuple[float, float]] = []

    def deeper(result: Result) -> dict[str, float]:
        # Brute force over the triangles; the paper's method is in the spheres, and these reach out of the mesh.
        placed = placed_at(result, np.flatnonzero(cell.stage.contact))
        figures = cell.errors(result)
        found.append((figures["mesh_depth_max"], -referee_clearance(cell.stage.hand, cell.stage.mesh, placed)))
        return figures

    soft = replace(SolverOptions().stiffness, contact=20.0)
    sunk = replace(cell, errors=deeper, solver=SolverOptions(method="penalty", stiffness=soft))
    run = run_cell(sunk, None)
    assert run.failure == ""
    ((told, exact),) = found
    assert told == pytest.approx(max(0.0, exact), abs=1e-5)


def test_a_row_of_the_command_names_who_is_beaten_by_none(small: list[Run]) -> None:
    rows = table_rows(small)
    assert all(set(row) == {column.name for column in COLUMNS} for row in rows)
    best = chosen(rows, object=ALL, motion=ALL, mesh_frontier=True)
    assert any(row["surface"] == "mesh" for row in best)
    (part, _) = chosen(rows, object=ALL, motion=ALL, stretch=True)
    assert not part["mesh_frontier"], "a stretch competes with nobody"
    assert not any("determin" in line for line in remarks(small))
    changing = replace(small[0], repeatable=False, way=Configuration("coupled", 4, 12))
    assert any("coupled differ between repetitions" in line for line in remarks([changing]))


def test_the_picture_is_drawn_for_any_table(small: list[Run], tmp_path: Path) -> None:
    import matplotlib.image

    rows = table_rows(small)
    draw_trade_off(tmp_path / "small.png", rows)
    assert matplotlib.image.imread(tmp_path / "small.png").shape[1] == 1360
    drawn = bench_trade_off("speed-error", rows)
    assert drawn is not None and drawn.drawing is not None
    with new_figure(7.0, drawn.drawing.height(7.0, False)) as figure:
        drawn.drawing.draw(figure, False)
        lines = [line.get_xdata() for axes in figure.axes for line in axes.get_lines()]
    for row in chosen(rows, object="cube", motion=ALL):
        assert any(np.array_equal(line, [row["tick_cpu_p50"], row["tick_cpu_p99"]]) for line in lines)
    for row in rows:
        row |= {"mesh_error": np.nan, "off_optimum_mean": 0.0, "method": "unheard-of"}
    draw_trade_off(tmp_path / "odd.png", rows)
    assert (tmp_path / "odd.png").stat().st_size > 10_000

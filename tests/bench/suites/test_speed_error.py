"""Speed against error: what is run, that the figures of the table are those of the runs, and the picture."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawings_alone import trade_offs_undrawn

from hhsim.bench.suite import run_cells
from hhsim.bench.suites.speed_error import DEFAULT_LEVEL, NO_LEVEL, SpeedError, is_default
from hhsim.bench.trade_off import Run, draw_trade_off
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions
from hhsim.table.file import ALL

pytestmark = pytest.mark.slow

SCENE = {"objects": ("cube",), "motions": ("touch",), "surfaces": ("spheres", "mesh"), "rate": 50.0}
WAYS = {"methods": ("coupled",), "levels": (1, 2), "linearisations": (12,), "backends": ("clarabel",)}
SMALL = SpeedError.planned(**SCENE, **WAYS, repetitions=2)


@pytest.fixture(scope="module")
def small() -> list[Run]:
    return list(run_cells(SMALL))


def test_every_method_is_run_with_every_level_and_number_once() -> None:
    options = replace(SMALL, methods=tuple(METHODS), levels=(3, 4), linearisations=(1, 2, 12), backends=())
    found = options.ways()
    assert len(found) == len(set(found)) == 6 * len(METHODS) + 6
    on_mesh = {(way.solver.method, way.level) for way in found if way.solver.surface == "mesh"}
    assert on_mesh == {("coupled", NO_LEVEL), ("progressive", NO_LEVEL)}
    defaults = [way.solver for way in found if is_default(way)]
    assert defaults == [SolverOptions(method=method) for method in METHODS]
    usual, full = SpeedError.planned(), replace(SpeedError.planned(is_preset=True), backends=())
    assert {*usual.ways()} < {*full.ways()} and len(full.ways()) == 4 * (4 * len(METHODS) + 2)
    assert {*usual.levels} <= set(range(1, DEFAULT_LEVEL + 1)), "the trees that ship"
    for surfaces, level in ((("spheres", "mesh"), 4), (("mesh", "spheres"), NO_LEVEL)):
        other = replace(options, surfaces=surfaces, backends=("clarabel",)).ways()[-1]
        assert (other.solver.surface, other.level, other.name) == (surfaces[0], level, "coupled with clarabel")


def test_every_way_runs_on_every_scene(small: list[Run]) -> None:
    assert [run.way for run in small] == SMALL.ways()
    for run in small:
        assert (run.object, run.motion, run.failure, run.repeatable) == ("cube", "touch", "", True)
        assert len(run.cpu) == len(run.other) == 2 and (np.array(run.cpu) > 0.0).all()
        assert run.figures["penetration_max"] <= 1e-6
    assert len({run.cpu[0].size for run in small}) == 1, "the ticks in contact are the scene's, not the method's"
    coarse, ours, mesh, *_, other = small
    assert (ours.way.level, mesh.way.solver.surface, other.way.level) == (2, "mesh", 2)
    assert other.figures["off_optimum_mean"] == pytest.approx(ours.figures["off_optimum_mean"], abs=1e-4)
    assert mesh.figures["off_optimum_mean"] < 1e-6 < 1e-3 < coarse.figures["off_optimum_mean"]
    assert mesh.figures["mesh_error"] < 2e-6 < 1e-3 < coarse.figures["mesh_error"], "its spheres are off the mesh"


def test_a_row_of_the_command_names_who_is_beaten_by_none(small: list[Run]) -> None:
    rows = SMALL.rows(small)
    assert all(set(row) == {column.name for column in SMALL.columns()} for row in rows)
    best = [row for row in rows if row["object"] == row["motion"] == ALL and row["mesh_frontier"]]
    assert any(row["surface"] == "mesh" for row in best)
    assert not any("determin" in line for line in SMALL.notes(small))
    changing = replace(small[0], repeatable=False)
    assert any("coupled differ between repetitions" in line for line in SMALL.notes([changing]))


def test_the_picture_is_drawn_for_any_table(small: list[Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import matplotlib.image

    rows = SMALL.rows(small)
    draw_trade_off(tmp_path / "small.png", rows)
    assert matplotlib.image.imread(tmp_path / "small.png").shape[1] == 1360
    figures = trade_offs_undrawn(monkeypatch)
    draw_trade_off(tmp_path / "none.png", rows)
    lines = [line.get_xdata() for axes in figures[0].axes for line in axes.get_lines()]
    for row in (row for row in rows if (row["object"], row["motion"], row["qp"]) == ("cube", ALL, "active-set")):
        assert any(np.array_equal(line, [row["tick_cpu_p50"], row["tick_cpu_p99"]]) for line in lines)
    for row in rows:
        row |= {"mesh_error": np.nan, "off_optimum_mean": 0.0, "method": "unheard-of"}
    draw_trade_off(tmp_path / "odd.png", rows)
    assert "not measured" in [text.get_text() for axes in figures[1].axes for text in axes.texts]

"""Speed against error: what is run, that the figures of the table are those of the runs, and the picture."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.bench.run_errors import RunErrors
from hhsim.bench.suite import measure
from hhsim.bench.suites.speed_error import (
    COLUMNS,
    DEFAULT_LEVEL,
    EVERY,
    FULL,
    LINEARISATIONS,
    NO_LEVEL,
    SUITE,
    Configuration,
    SpeedErrorOptions,
    backend_configurations,
    chosen,
    configurations,
    remarks,
    table_rows,
)
from hhsim.bench.trade_off import Run, frontier, tick_times
from hhsim.errors import HhsimError
from hhsim.kernels.tick.block import TickRecord
from hhsim.report.bench_trade_off import bench_trade_off, draw_trade_off
from hhsim.report.figure import new_figure
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions
from hhsim.table.file import ALL

SMALL = SpeedErrorOptions(
    objects=("cube",),
    motions=("touch",),
    methods=("coupled", "progressive"),
    surfaces=("spheres",),
    levels=(1, 2),
    linearisations=(12,),
    backends=("clarabel",),
    repetitions=2,
    rate=50.0,
)


@pytest.fixture(scope="module")
def small() -> list[Run]:
    return measure(SUITE, SMALL)


def test_every_method_is_run_with_every_level_and_number_once() -> None:
    options = replace(SMALL, methods=tuple(METHODS), levels=(3, 4), linearisations=(1, 2, 12))
    found = configurations(options)
    assert len(found) == len(set(found)) == 6 * len(METHODS)
    usually = configurations(replace(options, linearisations=None, every_linearisation=True))
    for method in METHODS:
        assert len([c for c in usually if c.method == method]) == 2 * len(LINEARISATIONS.get(method, EVERY))
        assert sum(c.is_default for c in usually if c.method == method) == 1
        (usual,) = [c for c in found if c.method == method and c.is_default]
        assert usual.solver_options() == SolverOptions(method=method)


def test_without_options_one_object_is_run_by_every_method_on_all_it_takes() -> None:
    options = SpeedErrorOptions()
    assert len(options.objects) == 1 and options.backends == ()
    assert set(options.levels) <= set(range(1, DEFAULT_LEVEL + 1)), "the trees that ship: no command builds one first"
    found = configurations(options)
    assert {c.method for c in found} == set(METHODS)
    for method in METHODS:
        one = [(c.surface, c.level, c.linearisations) for c in found if c.method == method]
        usual = SolverOptions(method=method).linearisations
        on_mesh = [] if METHODS[method].refuses_surfaces else [("mesh", NO_LEVEL, usual)]
        assert one == [*(("spheres", level, usual) for level in (2, 3, 4)), *on_mesh]
    full = SpeedErrorOptions(**FULL.values)
    assert {*found} < {*configurations(full)} and len(configurations(full)) == 56


def test_every_configuration_runs_on_every_scene(small: list[Run]) -> None:
    whole = [run for run in small if not run.way.stretch]
    assert [run.way for run in whole] == configurations(SMALL)
    part = [run for run in small if run.way.stretch]
    assert [run.way for run in part] == backend_configurations(SMALL)
    for run in small:
        assert (run.object_name, run.motion) == ("cube", "touch")
        assert np.shape(run.cpu) == np.shape(run.other) == (2, run.candidates.size)
        assert np.array_equal(tick_times([run.cpu]), np.mean(run.cpu, axis=0))
        assert (tick_times([run.cpu]) > 0.0).all()
        assert run.repeatable
        assert run.errors is not None
        assert run.errors.penetration_max <= 1e-6
        assert run.work.shape == run.candidates.shape
        assert (run.work > 0).all()
    assert len({run.candidates.size for run in whole}) == 1, "the ticks in contact are the scene's, not the method's"
    ours, other = part
    assert ours.ticks == other.ticks < whole[0].ticks
    assert ours.errors is not None
    assert other.errors is not None
    assert other.errors.off_optimum_max == pytest.approx(ours.errors.off_optimum_max, abs=1e-4)


def test_the_mesh_is_a_configuration_beside_the_levels_of_spheres() -> None:
    both = replace(SMALL, surfaces=("spheres", "mesh"), methods=tuple(METHODS))
    found = configurations(both)
    assert len(found) == len(set(found)) == 2 * len(METHODS) + 2
    assert [(c.method, c.level, c.is_default) for c in found if c.surface == "mesh"] == [
        ("coupled", NO_LEVEL, False),
        ("progressive", NO_LEVEL, False),
    ]
    for configuration in found:
        assert configuration.solver_options().surface == configuration.surface
    (own, _) = backend_configurations(both)
    assert (own.surface, own.level) == ("spheres", 2)
    (own, _) = backend_configurations(replace(SMALL, surfaces=("mesh", "spheres")))
    assert (own.surface, own.level) == ("mesh", NO_LEVEL)


ZEROS = RunErrors(**dict.fromkeys(RunErrors.__dataclass_fields__, 0))


def made_up(object_name: str, motion: str, configuration: Configuration, cost: float, **errors: float) -> Run:
    return Run(
        object_name,
        motion,
        configuration,
        cpu=[np.full(4, cost)],
        other=[np.full(4, 2.0 * cost)],
        candidates=np.arange(4),
        work=np.arange(4) if object_name == "cube" else np.zeros(4, np.int64),
        errors=replace(ZEROS, **errors),  # type: ignore[arg-type]
        ticks=10,
    )


def test_rows_sum_up_by_worst_mean_and_count() -> None:
    one, two = Configuration("coupled", 4, 12), Configuration("coupled", 4, 12, "clarabel", stretch=True)
    runs = [
        made_up(*scene, one, cost, mesh_error=error, off_optimum_mean=off, lag_ticks=lag, force_variation_hold=change)
        for scene, cost, error, off, lag, change in (
            (("cube", "touch"), 1e-5, 1e-4, 2e-3, 3, np.nan),
            (("cube", "grasp"), 3e-5, 3e-4, 4e-3, 4, 0.5),
            (("cup", "grasp"), 9e-3, 2e-4, 9e-3, 5, 0.7),
        )
    ]
    runs.append(made_up("cup", "grasp", two, 1e-6))
    rows = table_rows(runs)
    assert [(row["object"], row["motion"], row["stretch"]) for row in rows] == [
        ("cube", "touch", False),
        ("cube", "grasp", False),
        ("cup", "grasp", False),
        ("cup", "grasp", True),
        ("cube", ALL, False),
        ("cup", ALL, False),
        (ALL, ALL, False),
        (ALL, ALL, True),
    ]
    (cube,) = chosen(rows, object="cube", motion=ALL)
    assert (cube["mesh_error"], cube["lag_ticks"], cube["ticks"], cube["contact_ticks"]) == (3e-4, 7, 20, 8)
    assert cube["off_optimum_mean"] == pytest.approx(3e-3)
    assert cube["force_variation_hold"] == 0.5
    assert (cube["tick_cpu_p50"], cube["tick_cpu_max"]) == pytest.approx((2e-5, 3e-5))
    assert cube["tick_wall_p50"] == pytest.approx(4e-5)
    assert cube["work_p50"] == 1.5
    assert np.isnan(chosen(rows, object="cup", motion=ALL)[0]["work_p50"])
    (everything,) = chosen(rows, object=ALL, motion=ALL)
    assert everything["over_1ms"] == pytest.approx(1 / 3)
    assert everything["is_default"]
    assert everything["mesh_frontier"]
    (part,) = chosen(rows, object=ALL, motion=ALL, stretch=True)
    assert not part["mesh_frontier"], "a stretch competes with nobody"
    assert all(set(row) == {column.name for column in COLUMNS} for row in rows)


def test_the_frontier_is_over_spheres_and_the_mesh_and_leaves_out_hair_breadths() -> None:
    coarse, fine, poor = (Configuration("coupled", level, 12) for level in (4, 5, 3))
    mesh, slow = (Configuration(method, NO_LEVEL, 12, surface="mesh") for method in ("coupled", "progressive"))
    runs = [
        made_up("cube", "touch", coarse, 1e-5, mesh_error=2e-4, off_optimum_mean=3e-4),
        made_up("cube", "touch", fine, 3e-5, mesh_error=5e-5, off_optimum_mean=1e-4),
        made_up("cube", "touch", mesh, 2e-5, mesh_error=1e-6, off_optimum_mean=1e-6),
        made_up("cube", "touch", slow, 4e-5, mesh_error=1e-6, off_optimum_mean=4e-3),
        made_up("cube", "touch", poor, 5e-5, mesh_error=9.9e-7, off_optimum_mean=1e-2),
    ]
    found = chosen(table_rows(runs), object=ALL, motion=ALL)
    places = [("spheres", 4), ("spheres", 5), ("mesh", NO_LEVEL), ("mesh", NO_LEVEL), ("spheres", 3)]
    assert [(row["surface"], row["level"]) for row in found] == places
    for flag in ("mesh_frontier", "tracking_frontier"):
        assert [row[flag] for row in found] == [True, False, True, False, False]
    assert not any("determin" in line for line in remarks(runs))
    runs[0].repeatable = False
    assert any("coupled differ between repetitions" in line for line in remarks(runs))


def test_a_run_that_fails_is_told_and_wins_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    class Fragile(HandSolver):
        def run(self, *haptic: Any) -> TickRecord:
            if self.options.method == "progressive":
                raise HhsimError("more contacts than the arrays hold")
            record = super().run(*haptic)
            if self.options.linearisations == 2:
                record.joints[7, 0, 0, 0] = np.nan
            return record

    monkeypatch.setattr("hhsim.bench.suites.speed_error.HandSolver", Fragile)
    runs = measure(SUITE, replace(SMALL, levels=(1,), linearisations=(2, 12), backends=()))
    assert [(run.way.method, run.way.linearisations, run.failure) for run in runs] == [
        ("coupled", 2, "the graphic hand is not finite after tick 7"),
        ("coupled", 12, ""),
        ("progressive", 2, "more contacts than the arrays hold"),
        ("progressive", 12, "more contacts than the arrays hold"),
    ]
    rows = chosen(table_rows(runs), object=ALL, motion=ALL)
    assert [row["failed_runs"] for row in rows] == [1, 0, 1, 1]
    assert [row["mesh_frontier"] for row in rows] == [False, True, False, False]
    assert all(np.isnan(row["tick_cpu_p50"]) == bool(row["failed_runs"]) for row in rows)
    (line,) = (line for line in remarks(runs) if "could not be done" in line)
    assert line.startswith("3 of 4 runs could not be done; the first: coupled, level 1, cube, touch: the graphic hand")


def test_the_picture_is_drawn_for_any_table(small: list[Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import matplotlib.image

    rows = table_rows(small)
    draw_trade_off(tmp_path / "small.png", "speed-error", rows)
    assert matplotlib.image.imread(tmp_path / "small.png").shape[1] == 1360
    drawn = bench_trade_off("speed-error", rows)
    assert drawn is not None and drawn.drawing is not None
    with new_figure(7.0, drawn.drawing.height(7.0, False)) as figure:
        drawn.drawing.draw(figure, False)
        lines = [line.get_xdata() for axes in figure.axes for line in axes.get_lines()]
    for row in chosen(rows, object="cube", motion=ALL):
        assert any(np.array_equal(line, [row["tick_cpu_p50"], row["tick_cpu_p99"]]) for line in lines)
    for row in rows:
        row["mesh_error"] = np.nan
        row["off_optimum_mean"] = 0.0
        row["method"] = "unheard-of"
    draw_trade_off(tmp_path / "odd.png", "speed-error", rows)
    assert (tmp_path / "odd.png").stat().st_size > 10_000


coordinate = st.one_of(st.integers(0, 5).map(float), st.floats(allow_nan=True, allow_infinity=True))


@given(st.lists(st.tuples(coordinate, coordinate), max_size=30))
def test_the_frontier_holds_exactly_what_no_other_point_beats(points: list[tuple[float, float]]) -> None:
    found = frontier([x for x, _ in points], [y for _, y in points])
    values = [points[i] for i in found]
    assert values == sorted(values)
    assert len(set(values)) == len(values)
    whole = [p for p in points if not (np.isnan(p[0]) or np.isnan(p[1]))]
    unbeaten = {(x, y) for x, y in whole if not any(a <= x and b <= y and (a < x or b < y) for a, b in whole)}
    assert set(values) == unbeaten

"""Plans of sweeps, and cells that Dask runs."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from joint_samples import joint_sample, openxr_csv
from sweep_plans import PLAN, without_times, write_plan

from hhsim.errors import InputError
from hhsim.solver.method import find_method
from hhsim.sweep import engines
from hhsim.sweep.engines import run_on_dask, run_with_client
from hhsim.sweep.input_files import file_digest, source_digest
from hhsim.sweep.plan import SweepPlan, load_plan
from hhsim.sweep.sweep import CellTask, SweepFolder, run_sweep

WIDE = """
version = 1
objects = ["cube", { file = "cup", name = "mug" }]
motions = ["handle", { file = "short.toml", name = "mine" }]
methods = ["coupled", "penalty"]
surfaces = ["spheres", "mesh"]
seeds = [0, 1]
ticks = 150
[options.usual]
[options.coarse]
level = 2
stiffness = { translation = 500.0 }
"""


def plan(tmp_path: Path, text: str = PLAN) -> SweepPlan:
    return load_plan(write_plan(tmp_path, text))


def test_every_object_meets_every_motion_but_what_cannot_be_together(tmp_path: Path) -> None:
    found = plan(tmp_path, WIDE)
    cells = list(found.cells.values())
    # handle is for the cup alone; penalty takes no mesh: 3 scenes x 3 ways to solve x 2 sets x 2 seeds.
    assert len(cells) == 3 * 3 * 2 * 2
    met = {(cell.object.name, cell.motion.name) for cell in cells}
    assert met == {("cube", "mine"), ("mug", "handle"), ("mug", "mine")}
    assert found.notes == (
        "16 cells left out: motion handle is made for cup",
        "12 cells left out: method penalty takes no surface mesh",
    )
    assert found.name == "plan"
    assert {cell.length for cell in cells} == {150}
    coarse = next(cell for cell in cells if cell.options_name == "coarse")
    assert coarse.solver_options().stiffness.translation == 500.0
    assert coarse.label == "cube, mine, coupled, coarse"


def test_sets_of_options_that_come_to_the_same_are_computed_once_under_both_names(tmp_path: Path) -> None:
    more = "[options.stated]\nlevel = 3\nrate = 1000.0\nlinearisations = 12\n[options.other]\nlevel = 2\n"
    found = plan(tmp_path, PLAN.replace("level = 2", more).replace('"cylinder"', '"cylinder", "bunny"'))
    names = [(cell.object.name, cell.options_name) for cell in found.cells.values()]
    assert names[:2] == [("cylinder", "usual = stated"), ("cylinder", "other")]
    # The bunny's own level is 4: there level 3 is another one.
    assert ("bunny", "usual") in names and ("bunny", "stated") in names and len(names) == 2 * 2 + 3 * 2
    assert found.notes[0].startswith("cylinder: 2 cells computed once and called usual = stated")


def test_what_a_recording_was_imported_as_is_said(tmp_path: Path) -> None:
    (tmp_path / "quest.csv").write_text(openxr_csv(joint_sample()))
    (remark,) = plan(tmp_path, PLAN.replace("short.toml", "quest.csv")).notes
    assert remark.startswith("quest: ") and "on the way in: hhsim import tells what" in remark


def test_a_digest_is_of_what_is_in_the_files_and_not_of_names(tmp_path: Path) -> None:
    before = list(plan(tmp_path).cells)
    renamed = PLAN.replace("[options.usual]", "[options.other]").replace('"small"', '"large"')
    assert list(plan(tmp_path, renamed).cells) == before
    (tmp_path / "copy").mkdir()
    assert list(plan(tmp_path / "copy").cells) == before
    path = write_plan(tmp_path)
    (tmp_path / "short.toml").write_text((tmp_path / "short.toml").read_text() + "# another\n")
    assert not load_plan(path).cells.keys() & set(before)
    for change in (("level = 2", "level = 3"), ("level = 2", "level = 2\nbudget = 9"), ("[opt", "ticks = 9\n[opt")):
        assert not plan(tmp_path, PLAN.replace(*change)).cells.keys() & set(before)


def test_the_recording_of_a_demonstration_counts(tmp_path: Path) -> None:
    (tmp_path / "take.csv").write_text("1")
    (tmp_path / "demonstration.toml").write_text('recording = "take.csv"')
    before = file_digest(tmp_path / "demonstration.toml")
    (tmp_path / "take.csv").write_text("23")
    assert file_digest(tmp_path / "demonstration.toml") != before


def test_a_method_from_outside_is_known_by_its_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    methods = ("__init__(self, scene)", "begin(self, pose)", "tick(self, haptic)")
    text = "\n".join(["class Mine:", *(f"    def {method}: ..." for method in methods), ""])
    for name in ("one_of_ours", "other_of_ours"):
        (tmp_path / f"{name}.py").write_text(text + f"# {name}\n")
    one, other = (find_method(f"{name}:Mine").source for name in ("one_of_ours", "other_of_ours"))
    assert one and other and one != other
    assert find_method("coupled").source == ""


def test_a_pattern_takes_every_file_in_order(tmp_path: Path) -> None:
    write_plan(tmp_path)
    (tmp_path / "again.toml").write_text((tmp_path / "short.toml").read_text() + "# the same\n")
    found = plan(tmp_path, PLAN.replace('"short.toml"', '"[as]*.toml"'))
    assert list(dict.fromkeys(cell.motion.name for cell in found.cells.values())) == ["again", "short"]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"cylinder"', '"cylinde"', "did you mean cylinder?"),
        ('"cylinder"', '{ file = "cube", unit = "mm" }', "'cube' has its size"),
        ('"cylinder"', '"cylinder", "cylinder"', "two are called cylinder"),
        ('"short.toml"', '"*.npz"', "no file is called *.npz"),
        ('"coupled"', '"coupled", "coupled"', "two cells are the same: cylinder, short, coupled, usual"),
        ('"penalty"]', '"penalty"]\nsurfaces = ["skin"]', "unknown surface 'skin'"),
        ("level = 2", "level = 9", "options.usual: level = 9"),
        ("level = 2", "levle = 2", "options.usual 'levle': did you mean level?"),
        ("level = 2", 'margin = "wide"', "[options.usual], coupled: margin is 'wide': expected 1e-09 to 100"),
        ("level = 2", "stiffness = { shear = 1.0 }", "unexpected keyword argument 'shear'"),
        ("level = 2", "tremor_mm_deg = 1.0", "expected two numbers"),
        ("level = 2", "level = 2\nmax_error = 1e-3", "leave level out"),
        ('name = "small"', 'name = "../small"', "expected a name for a folder"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        plan(tmp_path, PLAN.replace(old, new))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_example_is_a_plan_of_what_ships(repository: Path) -> None:
    cells = list(load_plan(repository / "examples" / "sweep.toml").cells.values())
    assert {(cell.object.name, cell.motion.name) for cell in cells} == {
        (thing, motion) for thing in ("cube", "mug") for motion in ("pinch", "grab")
    }
    assert len(cells) == 4 * 2 * 2 and {cell.ticks for cell in cells} == {2000}


ignored = pytest.mark.filterwarnings("ignore")
"""What a cluster warns of when it ends is its own affair."""


def tasks(tmp_path: Path, folder: str, text: str = PLAN) -> list[CellTask]:
    plan = load_plan(write_plan(tmp_path, text))
    (tmp_path / folder).mkdir()
    more: dict[str, Any] = {"wants_core": False, "sources": source_digest(), "folder": str(tmp_path / folder)}
    return [CellTask(cell=cell, digest=digest, **more) for digest, cell in plan.cells.items()]


@ignored
def test_a_cluster_makes_the_same_files(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    here, there = tasks(tmp_path, "here"), tasks(tmp_path, "there")
    assert not any(task.run().reason for task in here)
    lost = replace(there[0], digest="lost", sources="another")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None, protocol="inproc"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        ends = {end.digest: end for end in run_with_client(client, [*there, lost])}
    assert "is another one" in ends["lost"].reason
    assert {end.reason for digest, end in ends.items() if digest != "lost"} == {""}
    names = sorted(path.name for path in (tmp_path / "here").iterdir())
    assert names == sorted(path.name for path in (tmp_path / "there").iterdir())
    for name in (name for name in names if name.endswith(".h5")):
        assert without_times(tmp_path / "here" / name) == without_times(tmp_path / "there" / name)


def test_without_dask_one_line_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    plan = load_plan(write_plan(tmp_path))
    with pytest.raises(InputError, match=r"pip install 'hhsim\[sweep\]'; without it, --jobs N"):
        run_sweep(plan, SweepFolder(tmp_path / "out"), scheduler="tcp://127.0.0.1:1")
    assert not (tmp_path / "out").exists()


@ignored
def test_a_scheduler_that_is_not_there_is_told_in_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(engines, "PATIENCE", 0.2)
    task: list[Any] = tasks(tmp_path, "out")[:1]
    for address in ("tcp://127.0.0.1:9", "nowhere at all"):
        with pytest.raises(InputError, match=f"no Dask scheduler at {address}"):
            list(run_on_dask(task, address, 1))

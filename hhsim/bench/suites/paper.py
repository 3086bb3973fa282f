"""The paper's whole evaluation, Figs. 11 to 15: its figures beside ours, in one run.

Every scene is played by every method, in turns; of each tick the median of the repetitions counts. Times are those of
one thread on the machine at hand; the paper's are of an Intel Core i7-8700, 3.7 GHz, Fig. 15 with five threads.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

from hhsim.bench.paper.figures import draw_all
from hhsim.bench.paper.run import PaperRuns, SceneRun, Stage, at_contacts, make_stage, paper_scenarios, play, play_again
from hhsim.bench.paper.table import case_table, paper_rows
from hhsim.bench.suite import Row, Suite
from hhsim.errors import check_known
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import FINGER_COUNT
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.solver.method import METHODS, methods_that
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import warm_up
from hhsim.system.progress import Progress
from hhsim.system.settings_file import Count, Names, between
from hhsim.system.thread_pool import usual_threads
from hhsim.table.table import MISSING, Table, shown, unit_size, words
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

CONTACTS = {"TF": 131.0, "WH": 250.0}
"""Numbers of contacts that the paper names, by case of Fig. 15: of two fingers on the bunny, of a whole hand."""
SHOWN_UNITS = {"s": ("µs", 1), "m": ("µm", 3), "%": ("%", 3), "1": ("", 0)}
"""Unit and digits that are printed, by the stored unit of a figure."""
UNJUDGED = (
    "index force and named touches have no bar here: scenes are placed on the paper's tree levels, and medians are of "
    "the holds of all objects"
)


class _Cell(NamedTuple):
    """A stage and a method, and the case and the number of contacts that its margin is to give, if any."""

    stage: Stage
    solver: SolverOptions
    case: str = ""
    wanted: float = math.nan


@dataclass(frozen=True, kw_only=True)
class Paper(Suite):
    """Methods, objects and repetitions."""

    methods: Names
    objects: Names | None
    level: int | None  # of every sphere tree; None for the paper's, 3 for the simple objects and 4 for the complex ones
    instances: Count
    repetitions: Count
    threads: Annotated[int, between(1, FINGER_COUNT)]
    seed: int
    draws_folder = True

    def check(self) -> None:
        """Raise InputError for unknown names."""
        check_known("method", self.methods, list(METHODS))
        check_known("object", self.objects or (), object_names())

    def solver(self, method: str) -> SolverOptions:
        """Return the options of a method: with the threads if it takes several."""
        return SolverOptions(method=method, threads=self.threads if method in methods_that("takes_threads") else 1)

    @property
    def whole(self) -> bool:
        """True for the whole evaluation on trees of the paper's levels."""
        return self.level is None and self.objects is None

    def cells(self, progress: Progress) -> list[_Cell]:
        """Return every scene with every method; TrajectoryError if a motion cannot be done."""
        hand = HandModel.default()
        solvers = [self.solver(method) for method in self.methods]
        for solver in solvers:
            warm_up(hand, solver)
        scenarios = [s for s in paper_scenarios() if self.objects is None or s.object_name in self.objects]
        trees, stages = dict[str, SphereTree](), list[Stage]()
        for number, scenario in enumerate(scenarios):
            if scenario.object_name not in trees:
                item = load_object(scenario.object_name)
                options = TreeOptions(level=item.paper_level if self.level is None else self.level)
                trees[scenario.object_name] = cached_sphere_tree(item.mesh, options, progress, usual_threads())
            progress("hands placed", number, len(scenarios))
            stages.append(make_stage(scenario, hand, trees[scenario.object_name], self.instances, self.seed))
        found = [_Cell(stage, solver) for stage in stages for solver in solvers]
        for case, wanted in CONTACTS.items():
            named = (stage for stage in stages if (stage.scenario.case, stage.scenario.object_name) == (case, "bunny"))
            found += [_Cell(stage, solver, case, wanted) for stage in named for solver in solvers]
        return found

    def run(self, cell: _Cell, before: SceneRun | None) -> SceneRun:
        """Play a scene once more; HhsimError if a solver cannot play it, or not twice alike."""
        if before is not None:
            play_again(before)
            return before
        return at_contacts(*cell) if cell.case else play(cell.stage, cell.solver)

    def rows(self, figures: Sequence[SceneRun]) -> list[Row]:
        """Return the rows of the paper's figures."""
        return paper_rows(PaperRuns(figures), self.methods, self.whole)

    def tables(self, rows: Sequence[Row], figures: Sequence[SceneRun]) -> list[Table]:
        """Return a line for each figure: for each method the figure, and how many times it is below the paper's."""
        names = list(dict.fromkeys(row["row"] for row in rows))
        cells = []
        for name in names:
            same = {row["method"]: row for row in rows if row["row"] == name}
            first = next(iter(same.values()))
            line = [first["figure"], first["label"], first["paper_text"]]
            for method in self.methods:
                row = same[method]
                ratio = "" if not math.isfinite(row["ratio"]) or row["unit"] == "1" else f"{row['ratio']:,.1f}"
                line += [_shown(row["ours"], row["unit"]), ratio]
            bar = next((row["bar"] for row in same.values() if not math.isnan(row["bar"])), math.nan)
            cells.append((*line, "" if math.isnan(bar) else _shown(bar, first["unit"])))
        numbers = [*(heading for method in self.methods for heading in (method, "×")), "our bar"]
        title = (
            "The paper's figures and ours, and how many times (×) ours is below; times are CPU times of one thread; "
            "our bar: the most that ends with exit code 0; blank where we set none, or not for these options"
        )
        headings = ("figure", "what", "printed in the paper", *numbers)
        last = self.methods[-1]
        how = [row for row in rows if row["method"] == last]
        found = [
            Table.of_cells(headings, cells, title, numbers=numbers),
            Table((words("what", "label"), words("how it was measured", "note")), how, f"How ({last})"),
        ]
        cases = case_table(figures)
        return [*found, cases] if cases.rows else found

    def missed(self, rows: Sequence[Row]) -> list[str]:
        """Return the figures in which a method that promises our bars does not keep one."""
        failed = [row for row in rows if row["method"] in methods_that("never_penetrates") and not row["passed"]]
        said = ((row, _shown(row["ours"], row["unit"]), _shown(row["bar"], row["unit"])) for row in failed)
        return [f"{row['label']}, {row['method']}: {ours}, bar {bar}" for row, ours, bar in said]

    def lines(self, rows: Sequence[Row]) -> list[str]:
        """Say which bars are kept."""
        if self.missed(rows):
            return []
        return ["every bar is kept by the methods that promise to", *([] if self.whole else [UNJUDGED])]

    def named(self, cell: _Cell) -> str:
        """Return what is played."""
        return f"{cell.wanted:.0f} contacts" if cell.case else "scenes"

    def draw(
        self, path: Path, rows: Sequence[Row], figures: Sequence[SceneRun], progress: Progress, note: str
    ) -> list[Path]:
        """Draw Figs. 11 to 15 in a folder."""
        return draw_all(path, PaperRuns(figures), progress, note)


def _shown(value: float, unit: str) -> str:
    name, digits = SHOWN_UNITS[unit]
    return f"{shown(value / unit_size(name), digits)} {name}".rstrip() if value == value else MISSING


SUITE = Paper

"""One thread or several: the paper's Fig. 15, detection, response and total by the part of the hand in contact.

The scenes and instances are those of `hhsim bench paper`, played with one thread and with several, in turns. Threads
save wall time and cost the processor time of all of them, waiting for work included.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from hhsim.bench.paper.bench import make_stages, play_in_turns
from hhsim.bench.paper.scene import Scenario, paper_scenarios
from hhsim.bench.paper.table import mean_of_parts
from hhsim.bench.table import mean
from hhsim.errors import InputError, check_known
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import FINGER_COUNT
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_FINGERS, DURATION_FORCE, DURATION_PALM
from hhsim.solver.hand_solver import warm_up
from hhsim.solver.method import methods_that
from hhsim.solver.options import SolverOptions
from hhsim.system.progress import Progress, silent
from hhsim.system.settings_file import Count, between, check_fields
from hhsim.table.table import Column, Table


def figure_15() -> list[Scenario]:
    """Return the scenes of Fig. 15."""
    return [scenario for scenario in paper_scenarios() if scenario.figure == "15"]


STARVED = 0.8
"""Share of a tick's time in which helpers have a processor, below which nothing can be said of threads."""


@dataclass(frozen=True, kw_only=True)
class ThreadsOptions:
    """Options of the suite."""

    objects: tuple[str, ...] = ("cup", "bunny")  # objects of Fig. 15; the paper's picture shows a cup and a bunny
    # Numbers of threads, up to the five fingers and the palm; 1 is always among them.
    threads: tuple[Annotated[int, between(1, FINGER_COUNT)], ...] = (1, 2)
    level: int = 4  # level of the sphere trees
    instances: Count = 100  # limit of the instances of a case
    rounds: Count = 9  # plays of each scene, of which the median counts
    seed: int = 0  # seed of the instances' places

    def __post_init__(self) -> None:
        """Raise InputError for objects that are not in Fig. 15, and numbers out of range."""
        check_known("object of Fig. 15", self.objects, [scenario.object_name for scenario in figure_15()])
        check_fields(self)
        if max(self.threads) == 1:
            raise InputError("one thread has nothing to be compared with: name another number, such as --threads 2")
        object.__setattr__(self, "threads", tuple(sorted({1, *self.threads})))


COLUMNS = (
    Column("object", "object of the catalogue", of="scenario.object_name"),
    Column("case", "SF single finger, TF two fingers, FF five fingers, WH whole hand", of="scenario.case"),
    Column("method", "method of the solver", of="options.method"),
    Column("threads", "threads that share a tick", of="options.threads"),
    Column("instances", "motions, each with the hand a little elsewhere", of=lambda run: len(run.stage.motions)),
    Column("contacts", "candidate pairs of a tick in contact, mean", of=lambda run: mean(run.candidates[run.contact])),
    Column("detection", "contact detection, wall time", "s", lambda run: mean_of_parts(run, DURATION_DETECT)),
    Column(
        "response",
        "collision response: palm, fingers and forces, wall time",
        "s",
        lambda run: mean_of_parts(run, DURATION_PALM, DURATION_FINGERS, DURATION_FORCE),
    ),
    Column("total", "tick in contact, wall time, mean", "s", lambda run: mean(run.tick_wall[run.contact])),
    Column("total_cpu", "the same, processor time of all threads", "s", lambda run: mean(run.tick_cpu[run.contact])),
    Column("speedup", "total of one thread over that of this number", of=lambda run: float("nan")),
)


def measure(options: ThreadsOptions, progress: Progress = silent) -> list[dict[str, Any]]:
    """Play the scenes in turns; return a row of `COLUMNS` a scene, method and threads. HhsimError as of `measure`."""
    hand = HandModel.default()
    solvers = [
        SolverOptions(method=method, threads=threads)
        for method in methods_that("takes_threads")
        for threads in options.threads
    ]
    for solver in solvers:
        warm_up(hand, solver)
    scenarios = [scenario for scenario in figure_15() if scenario.object_name in options.objects]
    stages = make_stages(scenarios, hand, options.level, options.instances, options.seed, progress)
    rows = Table(COLUMNS, play_in_turns(stages, solvers, options.rounds, progress)).records
    alone = float("nan")
    for row in rows:
        alone = row["total"] if row["threads"] == 1 else alone
        row["speedup"] = alone / row["total"]
    return rows


def best_speedup(rows: Sequence[dict[str, Any]]) -> str:
    """Return a sentence on the row in which several threads save the most."""
    best = max((row for row in rows if row["threads"] > 1), key=lambda row: row["speedup"])
    where = f"{best['object']}, {best['case']}, {best['method']}"
    return f"{best['threads']} threads are at best {best['speedup']:.2f} times as fast as one ({where})"


def remarks(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return a remark where other work kept the processors from the helper threads."""
    shares = [(row["total_cpu"] / row["total"] - 1.0) / (row["threads"] - 1) for row in rows if row["threads"] > 1]
    share = max(0.0, float(np.median(shares)))
    note = f"the helper threads had a processor for {100.0 * share:.0f} % of the time only: no verdict on threads"
    return [note] if share < STARVED else []

"""One thread or several: the paper's Fig. 15, detection, response and total by the part of the hand in contact.

The same motions are replayed with one thread and with several, in turns, so that other load of the machine falls on all
of them. Of each tick the median over the rounds counts; a row is the mean over 100 ticks of the closing and the hold.
Threads save wall time and cost the processor time of all of them, waiting for work included.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError, check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import FINGER_COUNT
from hhsim.kernels.tick.state import WORK_CANDIDATES
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_FINGERS, DURATION_FORCE, DURATION_PALM
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import Scene, make_scene
from hhsim.solver.compile import warm_up
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.method import methods_that
from hhsim.solver.options import SolverOptions
from hhsim.system.progress import Progress, silent
from hhsim.system.settings_file import Count, between, check_fields
from hhsim.table.table import Column
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions

MOTIONS = {"SF": "touch", "TF": "pinch", "FF": "grasp", "WH": "whole-hand"}
"""Motion of the catalogue for each case of Fig. 15: single finger, two and five fingers, whole hand."""
PHASES_APART = {"approach", "release"}
"""Phases in which the hand comes or goes."""
PAYS = 1.05
"""Least speedup at which threads pay: less is within the scatter of such times."""
STARVED = 0.8
"""Share of the ticks' time below which other load kept the helpers from running."""


@dataclass(frozen=True, kw_only=True)
class ThreadsOptions:
    """Options of the suite.

    Attributes:
        objects: The paper's figure shows a cup and a bunny.
        threads: Numbers of threads, up to one for each finger; 1 is always among them.
        level: Of the sphere trees.
        instances: Ticks in contact that a row is averaged over.
        rounds: Replays of each, of which the median counts.
    """

    objects: tuple[str, ...] = ("cup", "bunny")
    threads: tuple[Annotated[int, between(1, FINGER_COUNT)], ...] = (1, 2)
    level: int = 4
    instances: Count = 100
    rounds: Count = 9

    def __post_init__(self) -> None:
        """Raise InputError for unknown objects and numbers out of range."""
        check_known("object", self.objects, object_names())
        check_fields(self)
        if max(self.threads) == 1:
            raise InputError("one thread has nothing to be compared with: name another number, such as --threads 2")
        if 1 not in self.threads:
            object.__setattr__(self, "threads", (1, *self.threads))


COLUMNS = (
    Column("object", "object of the catalogue"),
    Column("case", "SF single finger, TF two fingers, FF five fingers, WH whole hand, as in the paper's Fig. 15"),
    Column("motion", "motion of the catalogue"),
    Column("method", "method of the solver"),
    Column("threads", "threads that share a tick"),
    Column("instances", "ticks in contact that the row is the mean of, each the median over the rounds"),
    Column("contacts", "candidate pairs a tick, mean"),
    Column("detection", "contact detection, wall time", "s"),
    Column("response", "collision response: palm, fingers and forces, wall time", "s"),
    Column("total", "whole tick, wall time", "s"),
    Column("total_cpu", "whole tick, processor time of all threads, waiting for work included", "s"),
    Column("speedup", "total wall time of one thread over that of this number"),
    Column("helpers_ran", "share of the tick's time in which the other threads had a processor, median"),
    Column("cpu_ratio", "total processor time of this number of threads over that of one"),
)


@dataclass
class _Replay:
    scene: Scene
    labels: dict[str, str]
    solver: SolverOptions
    instances: IntArray | None = None
    contacts: float = 0.0
    rounds: list[FloatArray] = field(default_factory=list)


def measure(options: ThreadsOptions, progress: Progress = silent) -> list[dict[str, Any]]:
    """Replay everything in turns; return a row a replay, by the names of COLUMNS, times in s.

    Raises:
        InputError: A motion brings no tick in contact.
    """
    hand = HandModel.default()
    groups = _groups(options, hand, progress)
    for method in methods_that("takes_threads"):
        for threads in options.threads:
            warm_up(hand, SolverOptions(method=method, threads=threads))
    total = options.rounds * len(groups)
    for number in range(options.rounds):
        for place, group in enumerate(groups):
            progress(f"round {number + 1} of {options.rounds}", number * len(groups) + place, total)
            # In turns: the first replay finds other caches than the second.
            for i in range(len(group)):
                _run(group[(i + number) % len(group)], options.instances)
    return [row for group in groups for row in _rows(group)]


def _groups(options: ThreadsOptions, hand: HandModel, progress: Progress) -> list[list[_Replay]]:
    """One group for each scene and method: the replays that are compared with each other."""
    groups = []
    for name in options.objects:
        mesh = load_object(name).mesh
        tree = cached_sphere_tree(mesh, TreeOptions(level=options.level), progress)
        for case, motion in MOTIONS.items():
            scene = make_scene(mesh, tree, hand, load_script(motion))
            for method in methods_that("takes_threads"):
                labels = {"object": name, "case": case, "motion": motion, "method": method}
                solvers = [SolverOptions(method=method, threads=threads) for threads in sorted(options.threads)]
                groups.append([_Replay(scene, labels, solver) for solver in solvers])
    return groups


def _run(replay: _Replay, instances: int) -> None:
    ticks = replay.scene.ticks
    solver = HandSolver(replay.scene.hand, replay.scene.tree.arrays(), replay.solver)
    acting = [phase for phase in ticks.phases if phase.name not in PHASES_APART]
    last = max((phase.last_tick for phase in acting), default=len(ticks.time) - 1)
    record = solver.run(*HandConfiguration.of(ticks).part(0, last + 1))
    if replay.instances is None:
        # Ticks with candidate pairs, evenly spread over the phases in which the hand closes and holds.
        inside = np.zeros(len(record.status), dtype=bool)
        for phase in acting:
            inside[phase.first_tick : phase.last_tick + 1] = True
        found = np.flatnonzero(inside & (record.work[:, WORK_CANDIDATES] > 0))
        if len(found) == 0:
            raise InputError(f"{replay.labels['object']}, {replay.labels['motion']}: no tick is in contact")
        replay.instances = found[np.linspace(0, len(found) - 1, min(instances, len(found))).round().astype(np.int64)]
        replay.contacts = float(record.work[replay.instances, WORK_CANDIDATES].mean())
    at = replay.instances
    times = np.stack([*record.duration[at].T, record.duration_total[at], record.duration_cpu[at]])
    replay.rounds.append(1e-9 * times)


def _rows(group: Sequence[_Replay]) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for replay in group:
        assert replay.instances is not None
        times = np.median(replay.rounds, axis=0).mean(axis=1)
        response = times[[DURATION_PALM, DURATION_FINGERS, DURATION_FORCE]].sum()
        rows.append(
            {
                **replay.labels,
                "threads": replay.solver.threads,
                "instances": len(replay.instances),
                "contacts": replay.contacts,
                "detection": float(times[DURATION_DETECT]),
                "response": float(response),
                "total": float(times[-2]),
                "total_cpu": float(times[-1]),
            }
        )
    alone = next(row for row in rows if row["threads"] == 1)
    for row, replay in zip(rows, group):
        # Median of the ratios: in an interrupted tick one of the clocks stands still.
        wall, cpu = np.array(replay.rounds)[:, -2:].transpose(1, 0, 2)
        helpers = row["threads"] - 1
        row["helpers_ran"] = float(np.median(cpu / wall - 1.0)) / helpers if helpers else None
        row["speedup"] = alone["total"] / row["total"]
        row["cpu_ratio"] = row["total_cpu"] / alone["total_cpu"]
    return rows


def when_threads_pay(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a sentence for each method and number of threads: the scenes in which they pay, and the cost."""
    sentences = []
    for method in dict.fromkeys(row["method"] for row in rows):
        for threads in sorted({row["threads"] for row in rows} - {1}):
            mine = [row for row in rows if row["method"] == method and row["threads"] == threads]
            if mine:
                sentences.append(f"{method}, {threads} threads: {_verdict(mine)}")
    return sentences


def _verdict(rows: Sequence[Mapping[str, Any]]) -> str:
    ran = float(np.median([row["helpers_ran"] for row in rows]))
    if ran < STARVED:
        return f"no verdict, since the helpers had a processor for {100.0 * max(ran, 0.0):.0f} % of the time only"
    best = max(rows, key=lambda row: row["speedup"])
    cost = float(np.median([row["cpu_ratio"] for row in rows]))
    pays = sum(row["speedup"] >= PAYS for row in rows)
    where = f"pays in {pays} of {len(rows)} scenes" if pays else "never pays here"
    return (
        f"{where}: at best {best['speedup']:.2f} times as fast "
        f"({best['object']}, {best['case']}), for {cost:.1f} times the processor time"
    )


def remarks(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return remarks on the machine: too few processors, or helpers that did not run."""
    notes = []
    processors = len(os.sched_getaffinity(0))
    most = max(row["threads"] for row in rows)
    if most > processors:
        notes.append(
            f"{most} threads on {processors} processors take turns: their times say nothing of {most} processors"
        )
    shares = [row["helpers_ran"] for row in rows if 1 < row["threads"] <= processors]
    share = max(float(np.median(shares)), 0.0) if shares else 1.0
    if share < STARVED:
        notes.append(
            f"the helpers had a processor for {100.0 * share:.0f} % of the time only: other work kept the processors "
            "busy, and nothing can be said of threads"
        )
    return notes

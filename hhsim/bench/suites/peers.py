"""MuJoCo beside our methods: the same hand, scenes and judge.

Every method has a hand whose phalanges are capsules, which all engines know. Errors are those of the true mesh, and of
the bodies that a method says are pushed: what an engine touches is its own.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.figures import worst
from hhsim.bench.suite import Row
from hhsim.bench.trade_off import Cell, Run, Stage, TradeOff, Way, mark_frontier, median_percentile, placed_at
from hhsim.errors import InputError
from hhsim.hand.forward_kinematics import hand_shape
from hhsim.hand.model import HandModel
from hhsim.metrics.mesh_penetration import sampled
from hhsim.result.reader import Result
from hhsim.solver.method import FORCES, declared_methods, find_method
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import warm_up
from hhsim.system.progress import Progress
from hhsim.table.file import ALL
from hhsim.trees.cache import cached_sphere_tree

OURS: tuple[tuple[str, str], ...] = (("coupled", "mesh"), ("coupled", "spheres"), ("penalty", "spheres"))
"""Our methods, and the surfaces that they touch."""
PUSHED = 1e-2
"""Least force of a body that touches [N]: stiff engines ring."""


def is_ours(way: Way) -> bool:
    """Return True for a method of hhsim's own."""
    return find_method(way.solver.method).compiled


def capsule_hand() -> HandModel:
    """Return the default right hand, each finger with the mean of its radii."""
    hand = HandModel.default()
    return replace(hand, radius=np.repeat(hand.radius.mean(axis=1, keepdims=True), hand.radius.shape[1], axis=1))


def _errors(stage: Stage, hands: int) -> Callable[[Result], dict[str, float]]:
    """Return what measures a run at so many ticks: its depth in the mesh, and how far off it pushed bodies are."""
    shape = hand_shape(stage.hand)

    def measured(result: Result) -> dict[str, float]:
        push = pushes(result["force/phalanx"], result["force/total"])
        looked = sampled(np.flatnonzero(stage.contact | (push > PUSHED).any(axis=1)), hands)
        clearance = stage.referee.clearances(shape, placed_at(result, looked), np.inf)
        depth = np.maximum(0.0, -clearance.min(axis=1))
        apart = np.abs(clearance[push[looked] > PUSHED])
        return {
            "mesh_depth_max": worst(depth),
            "mesh_depth_p95": float(np.percentile(depth, 95.0)) if depth.size else np.nan,
            "contact_error_max": worst(apart),
            # NaN for a hand that nothing pushes, which would be perfect otherwise.
            "mesh_error": float(np.maximum(worst(depth), worst(apart))),
            "samples": float(len(looked)),
        }

    return measured


def pushes(phalanx: FloatArray, total: FloatArray) -> FloatArray:
    """Return the size of the contact force on each body [N], shape (T, 16): 15 phalanges, then the palm.

    Forces on phalanges have shape (T, 5, 3, 3), the sum of all (T, 3).
    """
    palm = np.linalg.norm(total - phalanx.sum(axis=(1, 2)), axis=1)
    return np.concatenate([np.linalg.norm(phalanx, axis=-1).reshape(len(phalanx), -1), palm[:, None]], axis=1)


@dataclass(frozen=True, kw_only=True)
class Peers(TradeOff):
    """Objects, motions and methods, each with each."""

    def check(self) -> None:
        """Fill in the methods; raise InputError for unknown names."""
        if self.methods is None:
            declared = (name for name, entry in declared_methods().items() if entry.dist and entry.dist.name == "hhsim")
            object.__setattr__(self, "methods", (*dict.fromkeys(name for name, _ in OURS), *sorted(declared)))
        super().check()
        for name in self.methods or ():
            if FORCES not in find_method(name).gives:
                raise InputError(f"method {name} gives no forces: what it touches cannot be known")

    def installed(self) -> tuple[list[Way], list[str]]:
        """Return the methods that can be run, on their surfaces, and a line about each that cannot."""
        found, notes = list[Way](), list[str]()
        for name in self.methods or ():
            missing = find_method(name).missing
            if missing:
                notes.append(f"left out: {name} {missing}")
                continue
            surfaces = [surface for ours, surface in OURS if ours == name] or ["mesh"]
            if find_method(name).refuses_surfaces:
                surfaces = ["spheres"]
            found += [Way(SolverOptions(method=name, surface=surface)) for surface in surfaces]
        return found, notes

    def cells(self, progress: Progress) -> list[Cell]:
        """Return all that is installed on every scene; InputError for nothing."""
        ways, notes = self.installed()
        if not ways:
            raise InputError("; ".join(notes))
        hand = capsule_hand()
        for way in ways:
            warm_up(hand, way.solver)
        found = []
        for stage in self.stages(hand, cached_sphere_tree, progress):
            scene, errors = stage.scene(cached_sphere_tree(stage.mesh)), _errors(stage, self.hands)
            # Of a method of ours its step is the whole tick.
            times = {way: "duration/total_cpu" if is_ours(way) else "duration/palm" for way in ways}
            found += [Cell(stage, way, scene, errors, times[way]) for way in ways]
        return found

    def of_way(self, runs: Sequence[Run]) -> Row:
        """Return what a row has of the method."""
        way = runs[0].way
        return {
            "method": way.solver.method,
            "surface": way.solver.surface if is_ours(way) else "its own",
            "ours": is_ours(way),
            "repetitions": min(len(run.cpu) for run in runs),
            "native_cpu_p50": median_percentile([run.other for run in runs], 50.0),
            "frontier": False,
            "times_ours": np.nan,
        }

    def mark(self, group: Sequence[Row]) -> None:
        """Mark the frontier, and say how many times as long each takes as our fastest that is as near."""
        mark_frontier(group, "frontier", "mesh_error")
        for row in group:
            as_good = [one["tick_cpu_p50"] for one in group if one["ours"] and one["mesh_error"] <= row["mesh_error"]]
            if as_good:
                row["times_ours"] = row["tick_cpu_p50"] / min(as_good)

    def is_shown(self, rows: Sequence[Row], row: Row) -> bool:
        """Return True for a method over all motions on an object."""
        return bool(row["object"] != ALL == row["motion"])

    def notes(self, figures: Sequence[Run]) -> list[str]:
        """Return remarks on the table, a sentence each."""
        return [
            *self.installed()[1],
            "every method has the same hand, its phalanges capsules; no contact has friction",
            "off the mesh is a body that the method says is pushed by 0.01 N and more",
            *super().notes(figures),
        ]

    def lines(self, rows: Sequence[Row]) -> list[str]:
        """Say in which scenes every method of ours is farther from the mesh than another, or slower than it."""
        single = [row for row in rows if ALL not in (row["object"], row["motion"]) and not row["ours"]]
        # times_ours is NaN if none of ours is as near.
        return [
            f"{row['object']}, {row['motion']}: none of ours is as near and as fast as {row['method']}"
            for row in single
            if not row["failed_runs"] and not row["times_ours"] >= 1.0 and not np.isnan(row["mesh_error"])
        ]


SUITE = Peers

"""Ablation of the tick: `python -m tools.ablation --out FOLDER` runs every scene with each safeguard switched off.

A safeguard is a constant or a kernel of the tick. In a process of its own it is replaced before anything is compiled,
so that the compiled tick is the one that a change of the source would give; each variant has its own folder of compiled
kernels. Every variant runs the same scenes: the hard cases, random targets, the catalogue's objects by five motions,
recordings of real hands (where `--recordings` names a folder), and free objects that are lifted. The work units and the
poses do not depend on the machine, so that variants may run beside each other.

The table has a row for each safeguard: in how many scenes the bytes change without it, and what gets worse and better.
"""

import argparse
import hashlib
import json
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.bench.robustness.failure import recorded_penetration
from hhsim.bench.robustness.hard import bench_hard, hard_cases, limit_excess
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.hand.pose import copy_configuration
from hhsim.kernels.jit import jit
from hhsim.kernels.kernel_cache import KERNEL_CACHE, PACKAGE, kernel_closure, module_cache, source_of
from hhsim.kernels.tick import method as tick_method
from hhsim.kernels.tick import restoration
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.evaluation import evaluate_pose
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK, WORK_LINEARISATIONS, WORK_UNITS
from hhsim.kernels.tick.step_length import WHOLE_TARGET
from hhsim.mesh.catalogue import object_description, object_names
from hhsim.metrics.metrics import tracking_energy
from hhsim.scene.body import CLEARANCE
from hhsim.scene.scene import Scene, open_scene
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.solver.scene_solver import seen_scene
from hhsim.trees.contact_surface import contact_surface

MOTIONS = ("grasp", "pinch", "slide", "touch", "whole-hand")
LIFTED = ("bunny", "cube", "cup", "rock", "teapot")
METHODS = ("coupled", "progressive")
SURFACES = ("spheres", "mesh")
RECORDING_OBJECTS = ("bunny", "cup")
RECORDED = ("dapg_door_00", "dapg_door_07", "dfki", "leap_grab", "leap_pinch-half", "leap_roll", "mediapipe")
RANDOM_SUITES = {"random": SolverOptions().linearisations, "few": 2}
"""Suites of random targets, with the linearisations that a tick of theirs may make."""
MOST_TICKS = 6000
"""Of a scene: all of a script, the beginning of a long recording."""
JUDGED = 8
"""One tick in so many is judged by the distances of brute force, which take ten times as long as the tick."""


@jit
def _no_clipping(hand: Any, options: Any, only_restore: bool, state: Any) -> float:
    return WHOLE_TARGET


@jit
def _no_prediction(method: Any, hand: Any, surface: Any, state: Any) -> None:
    state.prediction.is_predicted = False
    copy_configuration(state.pose, state.prediction.start)


@jit
def _never_only_restores(options: Any, state: Any, done: int) -> bool:
    return False


@jit
def _no_recovery(method: Any, hand: Any, surface: Any, state: Any) -> bool:
    return False


@jit
def _without_going_back(method: Any, hand: Any, surface: Any, state: Any) -> bool:
    if not state.program.is_relaxed:
        state.program.is_relaxed = True
        state.program.is_coupled = True
        return True
    if not state.program.holds_abduction:
        state.program.holds_abduction = True
        return True
    return False


@jit
def _without_holding(method: Any, hand: Any, surface: Any, state: Any) -> bool:
    if not state.program.is_relaxed:
        state.program.is_relaxed = True
        state.program.is_coupled = True
        return True
    if state.progress.differs_from_safe:
        state.progress.failed_steps = 0
        restoration.take_back(state)
        state.trust.radius *= restoration.TRUST_DECAY
        return evaluate_pose(hand, surface, method.options, state)
    return False


@jit
def _new_trust(options: Any, state: Any) -> None:
    state.progress.is_unfinished = False
    state.trust.radius = options.margin
    state.program.is_relaxed = False
    state.program.holds_abduction = False
    state.program.is_coupled = state.decoupling.is_suspended


@jit
def _no_suspension(state: Any) -> None:
    pass


@jit
def _not_stalled(method: Any, state: Any) -> bool:
    return False


@jit
def _not_strained(state: Any) -> bool:
    return False


@jit
def _no_correction(lagrangian: Any, step: Any, rows: Any, tolerance: float, longest: float, work: Any, qp: Any) -> None:
    pass


@jit
def _complete(hand: Any, surface: Any, options: Any, state: Any) -> bool:
    return False


@jit
def _keep_all(hand: Any, reach: float, contacts: Any, excess: Any) -> None:
    pass


@jit
def _no_settled_forces(hand: Any, surface: Any, options: Any, state: Any, qp: Any) -> None:
    pass


@dataclass(frozen=True)
class Safeguard:
    """Part of the tick that can be switched off.

    Attributes:
        name: Kebab-case.
        meaning: What it does, in one sentence.
        changes: What takes the place of which names in the modules of `hhsim.kernels`.
    """

    name: str
    meaning: str
    changes: Mapping[str, Any]


def _of_hand(generic: str, kernel: Any) -> dict[str, Any]:
    """Return what takes the place of a part of the tick for both methods of a hand alone."""
    return {f"{generic}:{method}": kernel for method in ("Coupled", "Progressive")}


SAFEGUARDS = (
    Safeguard(
        "prediction",
        "a tick begins where the last motion would take the hand",
        _of_hand("begin_motion", _no_prediction),
    ),
    Safeguard("reach", "a program holds only the pairs that the last steps let expect", {"REACH_FLOOR": np.inf}),
    Safeguard("reach-growth", "a step that was cut short lets the next one reach farther", {"REACH_GROWTH": 1.0}),
    Safeguard("trust-memory", "a tick that came nowhere hands on its trust radius", {"_carry_over_trust": _new_trust}),
    Safeguard("trust-growth", "the trust radius handed on grows by steps", {"TRUST_GROWTH": 1e30}),
    Safeguard(
        "stay-suspended", "palm and fingers share a program near where apart they failed", {"SUSPENSION_MARGINS": -1.0}
    ),
    Safeguard(
        "stalled",
        "palm and fingers share a program after a tick without progress",
        {"energy_stalled:Progressive": _not_stalled},
    ),
    Safeguard(
        "suspension", "palm and fingers share a program after they failed apart", {"suspend_decoupling": _no_suspension}
    ),
    Safeguard("clip", "a far target is brought nearer", {"clip_target": _no_clipping, "_clip_target": _no_clipping}),
    Safeguard("clip-clear", "a hand with its clearance goes a part of a step", {"CLEAR": np.inf}),
    Safeguard("free-share", "a tick ends at the free share of a step that penetrates", {"FREE_SHARE": 0.0}),
    Safeguard("only-restores", "a last step only leaves the object", {"only_restores": _never_only_restores}),
    Safeguard("recovery", "a program without solution is made easier", _of_hand("recover", _no_recovery)),
    Safeguard("take-back", "of it: going back with a smaller trust radius", _of_hand("recover", _without_going_back)),
    Safeguard("hold-abduction", "of it: keeping the abduction", _of_hand("recover", _without_holding)),
    Safeguard("idle", "ticks without time are stuck after ten", {"MOST_IDLE_TICKS": 0}),
    Safeguard(
        "strained", "forces of a palm that yielded come from a program of their own", {"palm_yielded": _not_strained}
    ),
    Safeguard(
        "settled-forces",
        "forces of a tick that lags come from a program of their own",
        {"settle_forces": _no_settled_forces},
    ),
    Safeguard("curvature", "the second-order correction", {"correct_for_curvature": _no_correction}),
    Safeguard("complete-lists", "lists that a step goes beyond are gathered anew", {"complete_lists": _complete}),
    Safeguard("redundant-contacts", "contacts that others imply are dropped", {"drop_redundant_contacts": _keep_all}),
    Safeguard("gather-ahead", "lists are gathered ahead of need", {"AHEAD": -1.0, "STALE": np.inf}),
)

BASE = Safeguard("base", "the tick as it is", {})


def switch_off(safeguards: Sequence[Safeguard]) -> None:
    """Replace what the safeguards are made of, in every module that has it by name.

    Raises:
        SystemExit: A name that no kernel has.
    """
    modules = [module for name, module in sys.modules.items() if name.startswith("hhsim.kernels.") and module]
    for safeguard in safeguards:
        for name, value in safeguard.changes.items():
            generic, _, method = name.partition(":")
            if method:
                getattr(tick_method, generic).of(getattr(tick_method, method))(value)
                continue
            having = [module for module in modules if name in vars(module)]
            if not having:
                raise SystemExit(f"{safeguard.name}: no kernel has the name {name}")
            for module in having:
                setattr(module, name, value)


def share_kernels(safeguards: Sequence[Safeguard], folder: Path) -> None:
    """Link the compiled kernels that do not depend on the safeguards into the cache of a variant."""
    names = {name.partition(":")[0] for safeguard in safeguards for name in safeguard.changes}
    changed = {
        name for name, module in sys.modules.items() if name.startswith(f"{PACKAGE}.") and names & set(vars(module))
    }
    for cached in KERNEL_CACHE.iterdir():
        module = f"{PACKAGE}.{cached.name.rpartition('-')[0]}"
        if source_of(module) is None:
            continue
        if cached == module_cache(module) and not changed & kernel_closure(module):
            shutil.copytree(cached, folder / "kernels" / cached.name, dirs_exist_ok=True)


def scenes(recordings: Path | None) -> Iterator[tuple[str, str, Scene]]:
    """Yield suite, name and scene of everything that is replayed."""
    for object_ in object_names():
        for motion in MOTIONS:
            yield "scene", f"{object_} {motion}", open_scene(object_, motion)
    for object_ in LIFTED:
        scene = open_scene(object_, "lift")
        known = object_description(object_)
        table = float(scene.solids[0].placed_mesh.bounds[0, 2]) - CLEARANCE
        freed = scene.freed(table=table, density=known["density"], friction=known["friction"])
        yield "free", f"{object_} lift", freed
    for path in sorted(recordings.iterdir()) if recordings else ():
        if not path.stem.startswith(RECORDED):
            continue
        for object_ in RECORDING_OBJECTS:
            try:
                scene = open_scene(object_, path)
            except HhsimError as error:
                print(f"{path.name} on {object_}: {error}", file=sys.stderr)
            else:
                yield "recorded", f"{object_} {path.stem}", scene


def digest(record: TickRecord) -> str:
    """Return a digest of the poses and forces of a run."""
    found = hashlib.sha256()
    for field in ("position", "orientation", "flexion", "abduction", "palm_wrench", "phalanx", "total"):
        found.update(np.ascontiguousarray(getattr(record, field)).tobytes())
    return found.hexdigest()[:16]


def figures(
    scene: Scene, options: SolverOptions, surface: Any, record: TickRecord, motion: HandConfiguration
) -> dict[str, Any]:
    """Compute figures of a run that do not depend on the machine, and its times [ns]."""
    near = record.work[:, WORK_LINEARISATIONS] > 0
    judged = TickRecord._make(values[::JUDGED] for values in record)
    units = np.sort(record.work[near, WORK_UNITS])
    cpu = np.sort(record.duration_cpu[near])
    lag = record.lag[np.isfinite(record.lag)]
    force = np.linalg.norm(np.diff(record.total, axis=0), axis=1)
    finite = np.isfinite(motion.position).all(axis=1) & np.isfinite(motion.flexion).all(axis=(1, 2))
    valid = np.flatnonzero(finite)
    shown = HandConfiguration.of(record)
    energy = 0.0
    if seen_scene(scene).free is None and valid.size:
        diagonal = options.stiffness.diagonal()
        energy = float(tracking_energy(motion.at(valid), shown.at(valid), diagonal).mean())

    def percentile(values: Any, share: float) -> float:
        return float(values[min(len(values) - 1, int(share * len(values)))]) if len(values) else 0.0

    return {
        "digest": digest(record),
        "ticks": len(record.status),
        "depth": float(recorded_penetration(scene.hands[0].model, surface, judged).depth.max()),
        "stuck": int(((record.status & STATUS_STUCK) > 0).sum()),
        "lagging": int(((record.status & STATUS_LAG) > 0).sum()),
        "lag": float(lag.max(initial=0.0)),
        "energy": energy,
        "force_step": float(force.max(initial=0.0)),
        "limits": float(limit_excess(scene.hands[0].model, record)),
        "units_mean": float(units.mean()) if len(units) else 0.0,
        "units_p50": percentile(units, 0.5),
        "units_p99": percentile(units, 0.99),
        "linearisations": float(record.work[near, WORK_LINEARISATIONS].mean()) if len(units) else 0.0,
        "cpu_p50": percentile(cpu, 0.5),
        "cpu_p99": percentile(cpu, 0.99),
    }


@cache
def _touched(surface: str, digest: str) -> Any:
    scene = _by_digest[digest]
    return contact_surface(surface, scene.solids[0].placed_mesh, scene.solids[0].placed_tree)


_by_digest: dict[str, Scene] = {}


def touched(surface: str, scene: Scene) -> Any:
    """Return the contact surface of a scene; scenes with the same object in the same place share it."""
    digest = hashlib.sha256(
        scene.solids[0].placed_mesh.vertices.tobytes() + scene.solids[0].placed_tree.center.tobytes()
    ).hexdigest()
    _by_digest.setdefault(digest, scene)
    return _touched(surface, digest)


def run_one(scene: Scene, options: SolverOptions) -> dict[str, Any]:
    """Replay a scene without writing anything."""
    options = options.at_rate(scene.ticks.rate)
    surface = touched(options.surface, scene)
    seen = seen_scene(scene)
    solver = HandSolver(scene.hands[0].model, surface, options, seen.free)
    motion = seen.haptic[0]
    motion = motion.part(0, min(motion.ticks, MOST_TICKS))
    record = solver.run(*motion)
    return figures(scene, options, surface.arrays, record, motion)


def run_random(scene: Scene, options: SolverOptions, ticks: int, seed: int) -> dict[str, Any]:
    """Random targets around the object of a scene."""
    surface = touched(options.surface, scene)
    center, radius = scene.solids[0].placed_tree.center[0], float(scene.solids[0].placed_tree.radius[0])
    targets = RandomTargets(scene.hands[0].model, seed, StressOptions(), center=center, height=max(0.25, radius + 0.2))
    motion = targets.take(ticks)
    record = HandSolver(scene.hands[0].model, surface, options).run(*motion)
    return figures(scene, options, surface.arrays, record, motion)


def measure(folder: Path, suites: Sequence[str], ticks: int) -> dict[str, Any]:
    """Run every suite by the kernels as they are in this process."""
    with (folder / "scenes.pickle").open("rb") as file:
        known: list[tuple[str, str, Scene]] = pickle.load(file)
    found: dict[str, Any] = {}
    variants = [SolverOptions(method=method, surface=surface) for surface in SURFACES for method in METHODS]
    for suite, name, scene in known:
        if suite not in suites:
            continue
        for options in variants:
            if suite == "free" and options.method != "coupled":
                continue
            try:
                found[f"{suite} {name} {options.method} {options.surface}"] = run_one(scene, options)
            except HhsimError as error:
                found[f"{suite} {name} {options.method} {options.surface}"] = {"digest": str(error)}
    grasped = [(name, scene) for suite, name, scene in known if suite == "scene" and name.endswith("grasp")]
    for suite, linearisations in RANDOM_SUITES.items():
        if suite not in suites:
            continue
        for options in variants:
            options = replace(options, linearisations=linearisations)
            for seed, (name, scene) in enumerate(grasped):
                key = f"{suite} {name.split()[0]} {options.method} {options.surface}"
                found[key] = run_random(scene, options, ticks // len(grasped), seed)
    if "hard" in suites:
        for result in bench_hard(hard_cases(surfaces=SURFACES), variants):
            values = {figure.name: float(figure.value) for figure in result.figures}
            found[f"hard {result.case} {result.method} {result.surface}"] = {
                "digest": hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16],
                "passed": result.passed,
                "failed": [figure.name for figure in result.figures if not figure.passed],
                "depth": result.penetration,
                "stuck": result.safety.stuck,
                "lagging": result.safety.lagging,
                "lag": result.safety.lag if np.isfinite(result.safety.lag) else 0.0,
            }
    return found


SUITES = ("scene", *RANDOM_SUITES, "free", "recorded", "hard")


def table(found: Mapping[str, Mapping[str, Any]]) -> str:
    """Markdown: a row for each variant and suite that it changes, against the base."""
    base = found["base"]
    lines = [
        "| without | suite | runs that differ | hard cases failed | deepest [µm] | stuck ticks | lagging ticks"
        " | longest lag [mm] | energy | largest force step [N] | work mean | p50 | p99 | p99, worst |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, runs in found.items():
        for suite in SUITES:
            keys = [key for key in runs if key.startswith(suite + " ") and key in base]
            differ = [key for key in keys if runs[key]["digest"] != base[key]["digest"]]
            if not keys or (name != "base" and not differ):
                continue

            def total(key: str, source: Mapping[str, Any], keys: Sequence[str] = keys) -> float:
                return float(sum(source[run].get(key, 0.0) for run in keys))

            def most(key: str, source: Mapping[str, Any], keys: Sequence[str] = keys) -> float:
                return float(max(source[run].get(key, 0.0) for run in keys))

            def ratio(key: str, keys: Sequence[str] = keys, runs: Mapping[str, Any] = runs) -> str:
                shares = [runs[run][key] / base[run][key] for run in keys if base[run].get(key) and runs[run].get(key)]
                return f"{np.exp(np.mean(np.log(shares))):.3f}" if shares else ""

            shares = [
                runs[run]["units_p99"] / base[run]["units_p99"]
                for run in keys
                if base[run].get("units_p99") and runs[run].get("units_p99")
            ]
            failed = [run for run in keys if not runs[run].get("passed", True)]
            lines.append(
                f"| {name} | {suite} | {len(differ)} of {len(keys)} | {len(failed) if suite == 'hard' else ''} "
                f"| {1e6 * most('depth', runs):.3f} | {total('stuck', runs):,.0f} | {total('lagging', runs):,.0f} "
                f"| {1e3 * most('lag', runs):.2f} | {ratio('energy')} | {most('force_step', runs):.2f} "
                f"| {ratio('units_mean')} | {ratio('units_p50')} | {ratio('units_p99')} "
                f"| {f'{max(shares):.2f}' if shares else ''} |"
            )
    return "\n".join(lines)


def main() -> int:
    """Run the variants that are asked for, each in a process, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for scenes, kernels and figures")
    parser.add_argument(
        "--without", action="append", help="a safeguard, or several joined by +; default: each one alone"
    )
    parser.add_argument("--suites", default=",".join(SUITES), help="of " + ", ".join(SUITES))
    parser.add_argument("--ticks", type=int, default=100_000, help="random ticks of each method on each surface")
    parser.add_argument("--recordings", type=Path, help="folder of recordings")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--again", action="store_true", help="run variants again whose figures are there")
    parser.add_argument("--variant", help=argparse.SUPPRESS)
    given = parser.parse_args()
    by_name = {safeguard.name: safeguard for safeguard in (BASE, *SAFEGUARDS)}
    if given.variant:
        switch_off([by_name[name] for name in given.variant.split("+")])
        found = measure(given.out, given.suites.split(","), given.ticks)
        (given.out / f"{given.variant}.json").write_text(json.dumps(found, indent=1))
        return 0
    given.out.mkdir(parents=True, exist_ok=True)
    if not (given.out / "scenes.pickle").exists():
        with (given.out / "scenes.pickle").open("wb") as file:
            pickle.dump(list(scenes(given.recordings)), file)
    variants = ["base", *(given.without or [safeguard.name for safeguard in SAFEGUARDS])]

    def run(variant: str) -> int:
        if (given.out / f"{variant}.json").exists() and not given.again:
            return 0
        environment = dict(os.environ)
        if variant != "base":
            cache = given.out / "kernels" / variant
            cache.mkdir(mode=0o700, parents=True, exist_ok=True)
            share_kernels([by_name[name] for name in variant.split("+")], cache)
            environment["HHSIM_CACHE_DIR"] = str(cache)
        command = [sys.executable, "-m", "tools.ablation", "--out", str(given.out), "--variant", variant]
        command += ["--suites", given.suites, "--ticks", str(given.ticks)]
        return subprocess.run(command, env=environment, check=False).returncode

    with ThreadPoolExecutor(given.jobs) as pool:
        codes = [run("base"), *pool.map(run, variants[1:])]
    found = {
        variant: json.loads((given.out / f"{variant}.json").read_text())
        for variant in variants
        if (given.out / f"{variant}.json").exists()
    }
    text = table(found)
    (given.out / "table.md").write_text(text + "\n")
    print(text)
    return max(codes)


if __name__ == "__main__":
    sys.exit(main())

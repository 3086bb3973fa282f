"""`hhsim bench stress`: random targets against objects, every tick measured from the hand that it shows.

A run of any length takes the same memory: ticks are run, measured and dropped block by block.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from hhsim.bench.robustness.delta_debugging import Shrunk, delta_debug
from hhsim.bench.robustness.failure import Provenance, failure_of, keep_failure, make_trial, recorded_penetration
from hhsim.bench.robustness.stress_measurement import StressCase, StressMeasure
from hhsim.bench.robustness.stress_metrics import KeptFailure, StressFigures
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.motion.tick_motion import replayed
from hhsim.solver.compile import warm_up
from hhsim.solver.hand_solver import HandSolver
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.output_path import free_name
from hhsim.system.progress import Progress, silent

MakeSolver = Callable[[StressCase], HandSolver]

BLOCK = 2048
"""Ticks that are run and measured at a time."""
STRETCH_BLOCKS = 4
"""Blocks up to a failure that are kept to shrink it from."""


def run_case(
    case: StressCase, *, make_solver: MakeSolver = StressCase.new_solver, check: Callable[[], None] = lambda: None
) -> StressFigures:
    """Run one case.

    Args:
        make_solver: Makes the solver, for the run and for every candidate of the shrinking.
        check: Called between blocks.

    Raises:
        HhsimError: More pairs were near than the solver holds, or a failure could not be written.
    """
    warm_up(case.hand, case.solver)
    measure = StressMeasure(case)
    solver = make_solver(case)
    stretch: deque[tuple[HandConfiguration, HandConfiguration]] = deque(maxlen=STRETCH_BLOCKS)
    kept: dict[str, KeptFailure] = {}
    for motion in case.targets().blocks(case.ticks, BLOCK):
        first = measure.ticks
        record = solver.run(*motion)
        depth = recorded_penetration(case.hand, solver.workspace.surface, record)
        stretch.append((motion, HandConfiguration.of(record).copy()))
        failing = measure.add(motion, record, depth)
        for kind, ticks in failing.items():
            if case.keep is not None and kind not in kept and ticks.any():
                tick = int(np.argmax(ticks))
                kept[kind] = _keep(case, make_solver, kind, first + tick, tick, list(stretch))
        check()
    return measure.figures(tuple(kept.values()))


def run_stress(cases: Sequence[StressCase], *, jobs: int = 1, progress: Progress = silent) -> Iterator[StressFigures]:
    """Run cases, `jobs` of them at a time in processes of their own; yield their figures in order.

    Raises:
        HhsimError: As `run_case`.
    """
    with interruptible_between() as check:
        for done, figures in enumerate(_run_all(cases, jobs, check)):
            progress("cases", done + 1, len(cases))
            yield figures


def _run_all(cases: Sequence[StressCase], jobs: int, check: Callable[[], None]) -> Iterator[StressFigures]:
    if jobs <= 1 or len(cases) <= 1:
        for case in cases:
            yield run_case(case, check=check)
        return
    # Spawned, not forked: a fork of a process with threads copies locks that nobody will release.
    pool = ProcessPoolExecutor(min(jobs, len(cases)), mp_context=get_context("spawn"))
    try:
        for future in [pool.submit(run_case, case) for case in cases]:
            yield future.result()
            check()
    finally:
        pool.shutdown(cancel_futures=True)


def _keep(
    case: StressCase,
    make_solver: MakeSolver,
    kind: str,
    tick: int,
    tick_in_block: int,
    stretch: list[tuple[HandConfiguration, HandConfiguration]],
) -> KeptFailure:
    assert case.keep is not None
    behind = stretch[-1][0].ticks - tick_in_block - 1
    motion, graphic = (sequence(*pieces) for pieces in zip(*stretch))
    end = motion.ticks - behind
    trial = make_trial(case.hand, lambda: make_solver(case), failure_of(kind, case.hand, case.pieces, case.solver))
    reproduced = True
    try:
        shrunk = delta_debug(motion.part(0, end), trial, graphic=graphic.part(0, end))
    except InputError:
        # The solver's memory of what came before the stretch decides: keep the whole way there.
        whole = replayed(case.targets().take(tick + 1))
        shrunk = Shrunk(whole, trial(whole), tick + 1, 1)
        reproduced = bool(shrunk.trace.failed.any())
    last = shrunk.tick if reproduced else shrunk.motion.ticks - 1
    solver = make_solver(case)
    record = solver.run(*shrunk.motion)
    depth = float(recorded_penetration(case.hand, solver.workspace.surface, record).depth[last])
    provenance = Provenance(
        kind=kind,
        object=case.object,
        object_options=case.object_options,
        method=case.solver.method,
        seed=case.seed,
        tick=tick,
        failing_tick=last,
        depth=depth,
        stress=case.stress.to_json(),
        solver=case.solver.to_json(),
        hand=case.hand.side,
    )
    case.keep.mkdir(parents=True, exist_ok=True)
    stem = Path(case.object).stem
    touched = "" if case.solver.surface == "spheres" else f"-{case.solver.surface}"
    name = f"{stem}-{case.solver.method}{touched}-{kind.replace(' ', '-')}-seed{case.seed}-tick{tick}.h5"
    path = free_name(case.keep / name)
    command = keep_failure(path, shrunk, provenance)
    return KeptFailure(kind, tick, str(path), shrunk.motion.ticks, last, depth, reproduced, command)

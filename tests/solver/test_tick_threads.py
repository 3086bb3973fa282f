"""Ticks shared among threads: the same bytes with any number, and no thread left behind."""

import signal
import threading
import time

import numpy as np
import pytest
from sampled import sampled
from sphere_scenes import UNTIMED, bumpy_ball, engine_of, random_targets

import hhsim.solver.workspace
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.parallel.thread_team import NUMBER_SHIFT, TICKET
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import WORK_CANDIDATES
from hhsim.mesh.catalogue import load_object
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import make_scene
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree


@pytest.fixture(scope="module")
def hand() -> HandModel:
    return HandModel.default()


def assert_same_bytes(one: TickRecord, other: TickRecord) -> None:
    for name in UNTIMED:
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


def helpers() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name.startswith(hhsim.solver.workspace.HELPER)]


def posted(solver: HandSolver) -> int:
    """How many tasks the thread team of a solver has been given."""
    return int(solver.workspace.states[0].thread_team.word[TICKET]) >> NUMBER_SHIFT


def run(hand: HandModel, tree: SphereTree, motion: HandConfiguration, threads: int = 1) -> tuple[TickRecord, int]:
    """A motion in two blocks, and how many tasks were posted."""
    solver = HandSolver(hand, tree.arrays(), SolverOptions(method="progressive", threads=threads))
    half = len(motion.position) // 2
    first = solver.run(*motion.part(0, half))
    second = solver.run(*motion.part(half, len(motion.position)))
    return TickRecord(*(np.concatenate(pair) for pair in zip(first, second))), posted(solver)


@pytest.mark.parametrize(
    ("name", "script"),
    sampled(
        [(name, script) for name in ("cup", "bunny") for script in ("grasp", "whole-hand", "slide")],
        lambda place, case: case in (("cup", "grasp"), ("bunny", "whole-hand")),
    ),
)
def test_any_number_of_threads_gives_the_same_bytes(hand: HandModel, name: str, script: str) -> None:
    mesh = load_object(name).mesh
    scene = make_scene(mesh, cached_sphere_tree(mesh, TreeOptions(level=4)), hand, load_script(script), rate=500.0)
    motion = HandConfiguration.of(scene.hands[0].ticks)
    alone, _ = run(hand, scene.solids[0].placed_tree, motion)
    assert alone.work[:, WORK_CANDIDATES].max() > 40
    for threads in (2, 3):
        shared, tasks = run(hand, scene.solids[0].placed_tree, motion, threads)
        assert_same_bytes(alone, shared)
        assert tasks > 100
    assert helpers() == []


def test_no_helper_outlives_an_interrupt(hand: HandModel) -> None:
    solver = HandSolver(hand, bumpy_ball(300).arrays(), SolverOptions(method="progressive", threads=3))
    solver.run(*random_targets(hand, 2, seed=0))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        engine = engine_of(solver)
        with pytest.raises(KeyboardInterrupt), engine.thread_team.at_work(engine.method):
            assert len(helpers()) == 2
            signal.raise_signal(signal.SIGINT)
            time.sleep(60.0)
    finally:
        signal.signal(signal.SIGINT, before)
    assert helpers() == []
    assert solver.workspace.states[0].thread_team.members == 1

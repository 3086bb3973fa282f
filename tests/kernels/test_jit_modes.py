"""The kernels give the same results compiled, compiled with bounds checks, and as plain Python; each is compiled once.

Bounds checks keep loops off the vector unit, and plain Python fuses no multiplication with an addition: floats agree to
rounding, integers exactly. With bounds checks the cache is a new one: a kernel from a cache does not tell what its
callees were compiled for.
"""

import json
import os
import pickle
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from sphere_scenes import CURL, bumpy_ball

from hhsim.arrays import AnyArray
from hhsim.hand.model import HandModel
from hhsim.kernels.cache_folder import cache_root
from hhsim.kernels.tick.state import STATUS_START_INSIDE
from hhsim.motion.analytic_motion import still
from hhsim.solver.method import METHODS
from hhsim.trees.file import save_tree

TICKS = 24
SCRIPT = textwrap.dedent(
    f"""
    import importlib, json, pickle, pkgutil, sys
    from pathlib import Path
    sys.path.insert(0, {str(Path(__file__).parents[1])!r})
    import numpy as np
    from sphere_scenes import bumpy_ball, random_targets
    import hhsim.kernels
    from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
    from hhsim.kernels.callee import Kernel
    from hhsim.metrics.metrics import penetration
    from hhsim.motion.analytic_motion import still
    from hhsim.solver.hand_solver import HandSolver
    from hhsim.solver.hand_solver import warm_up
    from hhsim.solver.method import METHODS
    from hhsim.solver.options import SolverOptions
    from hhsim.trees.file import load_tree

    folder, expected = Path(sys.argv[1]), sys.argv[2]
    import numba
    mode = "python" if numba.config.DISABLE_JIT else "checked" if numba.config.BOUNDSCHECK else "compiled"
    assert mode == expected, mode
    motion = np.load(folder / "motion.npz")
    # Its palm's mesh takes 20 s in plain Python.
    hand, tree = pickle.loads((folder / "hand.pickle").read_bytes()), load_tree(folder / "tree.h5")
    results = {{}}
    for method, force in (("coupled", "kkt"), ("progressive", "paper"), ("paper", "kkt")):
        solver = HandSolver(hand, tree.arrays(), SolverOptions(method=method, force=force))
        record = solver.run(*(motion[n] for n in ("position", "orientation", "flexion", "abduction")))
        for name, values in record._asdict().items():
            if not name.startswith("duration"):
                results[f"{{method}} {{force}} {{name}}"] = values
    shown = PlacedHand(record.joints, record.position, record.orientation)
    depth = penetration(tree.arrays(), hand_shape(hand), shown)
    results.update(depth._asdict())
    np.savez(folder / f"{{mode}}.npz", **results)

    if mode == "checked":
        for method, promised in METHODS.items():
            options = SolverOptions(method=method, threads=2 if promised.takes_threads else 1)
            warm_up(hand, options)
            solver = HandSolver(hand, bumpy_ball(300).arrays(), options)
            solver.place(*still([0.0, 0.0, 0.2]).at(0))
            solver.run(*random_targets(hand, 200, 0))
        signatures = {{}}
        for module in pkgutil.walk_packages(hhsim.kernels.__path__, "hhsim.kernels."):
            for name, kernel in vars(importlib.import_module(module.name)).items():
                if isinstance(kernel, Kernel) and kernel.__module__ == module.name:
                    kernel_name = f"{{module.name.removeprefix('hhsim.kernels.')}}.{{name}}"
                    signatures[kernel_name] = [str(signature[:1]) for signature in kernel.signatures]
        (folder / "signatures.json").write_text(json.dumps(signatures))
    """
)
MODES = {"compiled": {}, "checked": {"NUMBA_BOUNDSCHECK": "1", "NUMBA_OPT": "0"}, "python": {"NUMBA_DISABLE_JIT": "1"}}
"""Settings of numba. What a mode leaves out is not set, not even to 0: the kernels are then those in the cache."""
UNSET = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
"""Environment without settings of numba."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of what each mode computes of a short grasp, from free space to pressed on the ball."""
    folder = tmp_path_factory.mktemp("modes")
    start = still([0.0, -0.045, 0.08], flexion=0.3 * CURL)
    end = still([0.001, -0.046, 0.052], flexion=CURL, abduction=0.05)
    motion = start.line(end, TICKS - 6 - 1).hold(6)
    save_tree(bumpy_ball(60), folder / "tree.h5")
    (folder / "hand.pickle").write_bytes(pickle.dumps(HandModel.default()))
    np.savez(folder / "motion.npz", **motion._asdict())
    return folder


def computed(folder: Path, mode: str) -> dict[str, AnyArray]:
    """What a mode computes, in a process of its own, once."""
    if not (folder / f"{mode}.npz").exists():
        cache = folder / "cache" if mode == "checked" else cache_root()
        subprocess.run(
            [sys.executable, "-c", SCRIPT, str(folder), mode],
            env={**UNSET, "HHSIM_CACHE_DIR": str(cache), **MODES[mode]},
            check=True,
            timeout=900,
        )
    with np.load(folder / f"{mode}.npz") as file:
        return {name: file[name] for name in file.files}


@pytest.mark.slow
@pytest.mark.soak
def test_the_run_exercises_contact(folder: Path) -> None:
    compiled = computed(folder, "compiled")
    assert not (compiled["coupled kkt status"] & STATUS_START_INSIDE).any()
    assert np.linalg.norm(compiled["coupled kkt total"][-1]) > 1.0
    assert np.linalg.norm(compiled["progressive paper total"][-1]) > 0.5
    assert np.linalg.norm(compiled["paper kkt total"][-1]) > 0.5
    assert not compiled["coupled kkt total"][0].any()


@pytest.mark.slow
@pytest.mark.parametrize("mode", [pytest.param("checked", marks=pytest.mark.soak), "python"])
@pytest.mark.soak
def test_results_are_equal_to_rounding(folder: Path, mode: str) -> None:
    compiled, other = computed(folder, "compiled"), computed(folder, mode)
    assert compiled.keys() == other.keys()
    assert len(compiled) > 35
    for name, values in compiled.items():
        if values.dtype == np.int64:
            np.testing.assert_array_equal(other[name], values, err_msg=name)
        else:
            np.testing.assert_allclose(other[name], values, rtol=1e-9, atol=1e-9, err_msg=name)


FOR_TWO = {
    "sphere_tree.node_distance": "indices with and without a sign",
    "surfaces.spheres.write_palm_pair": "indices with and without a sign",
    "contact.self_pairs.nothing": "whatever it is given, with which it does nothing",
    "tick.step.take_multipliers": "the record of a step, and that of a finger's part of one",
}
"""Kernels that are compiled more than once, and for what: they are put into their callers, and small."""


@pytest.mark.soak
def test_every_kernel_of_a_replay_is_compiled_for_one_signature(folder: Path) -> None:
    # A second signature would cost seconds at the first run of each user, for nothing. What is generic in the method is
    # compiled once for each: its type is that of the first argument.
    computed(folder, "checked")
    signatures = json.loads((folder / "signatures.json").read_text())
    assert len(signatures["tick.block.run_block"]) == len(METHODS)
    assert len(signatures["tick.progressive.help_out"]) == 1
    assert {name: kinds for name, kinds in signatures.items() if len(kinds) > len(set(kinds))}.keys() == FOR_TWO.keys()

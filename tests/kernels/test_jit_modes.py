"""The kernels give the same results compiled, compiled with bounds checks, and as plain Python.

Bounds checks change no arithmetic, but keep loops off the vector unit, where sums are taken in another order; plain
Python also fuses no multiplication with an addition. Hence results agree to rounding and not to the bit, and counters,
which are whole numbers, exactly.
"""

import os
import subprocess
import sys
import textwrap
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sphere_scenes import Motion, bumpy_ball, still, straight_line

from hhsim.hand.model import HandModel
from hhsim.kernels.jit import cache_root
from hhsim.kernels.tick.state import STATUS_START_INSIDE
from hhsim.trees.file import save_tree
from hhsim.trees.sphere_tree import SphereTree

Array = NDArray[Any]

TICKS = 24
SCRIPT = textwrap.dedent(
    """
    import sys
    from pathlib import Path
    import numpy as np
    import hhsim.kernels.jit as jit
    from hhsim.hand.model import HandModel
    from hhsim.metrics.metrics import penetration
    from hhsim.solver.hand_solver import HandSolver
    from hhsim.solver.options import SolverOptions
    from hhsim.trees.sphere_tree import SphereTree

    folder, expected = Path(sys.argv[1]), sys.argv[2]
    import numba
    mode = "python" if numba.config.DISABLE_JIT else "checked" if numba.config.BOUNDSCHECK else "compiled"
    assert mode == expected, mode
    motion = np.load(folder / "motion.npz")
    hand, tree = HandModel.default(), load_tree(folder / "tree.h5")
    results = {}
    for method in ("coupled", "progressive", "paper"):
        for force in ("kkt", "paper"):
            solver = HandSolver(hand, tree.arrays(), SolverOptions(method=method, force=force))
            record = solver.run(*(motion[n] for n in ("position", "orientation", "flexion", "abduction")))
            for name, values in record._asdict().items():
                if not name.startswith("duration"):
                    results[f"{method} {force} {name}"] = values
    palm = hand.palm_tree
    depth = penetration(tree.arrays(), hand.radius, palm.leaf_center, palm.leaf_radius,
                        record.joints, record.position, record.orientation)
    results.update(depth._asdict())
    np.savez(folder / f"{mode}.npz", **results)
    """
)
MODES = {
    "compiled": {"NUMBA_DISABLE_JIT": "0", "NUMBA_BOUNDSCHECK": "0"},
    "checked": {"NUMBA_DISABLE_JIT": "0", "NUMBA_BOUNDSCHECK": "1"},
    "python": {"NUMBA_DISABLE_JIT": "1", "NUMBA_BOUNDSCHECK": "0"},
}


def scene() -> tuple[SphereTree, Motion]:
    """A short grasp that begins in free space and ends pressed on the ball."""
    curl = np.array([[0.3, 0.5, 0.4], [0.6, 0.7, 0.5], [0.7, 0.7, 0.5], [0.6, 0.7, 0.5], [0.5, 0.7, 0.4]])
    start = still(1, [0.0, -0.045, 0.08], flexion=0.3 * curl)
    end = still(1, [0.001, -0.046, 0.052], flexion=curl, abduction=np.full(5, 0.05))
    motion = straight_line(start, end, TICKS - 6).then(still(6, *(values[0] for values in end)))
    return bumpy_ball(60), motion


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Array]]:
    folder = tmp_path_factory.mktemp("modes")
    tree, motion = scene()
    save_tree(tree, folder / "tree.h5")
    np.savez(folder / "motion.npz", **motion._asdict())
    HandModel.default()  # leaves the palm's tree in the cache: building it takes plain Python very long
    found = {}
    for mode, environment in MODES.items():
        subprocess.run(
            [sys.executable, "-c", SCRIPT, str(folder), mode],
            env={**os.environ, "HHSIM_CACHE_DIR": str(cache_root()), **environment},
            check=True,
            timeout=600,
        )
        with np.load(folder / f"{mode}.npz") as file:
            found[mode] = {name: file[name] for name in file.files}
    return found


@pytest.mark.slow
def test_the_run_exercises_contact(results: dict[str, dict[str, Array]]) -> None:
    compiled = results["compiled"]
    assert not (compiled["coupled kkt status"] & STATUS_START_INSIDE).any()
    assert np.linalg.norm(compiled["coupled kkt total"][-1]) > 1.0
    assert np.linalg.norm(compiled["coupled paper total"][-1]) > 1.0
    assert np.linalg.norm(compiled["progressive kkt total"][-1]) > 0.5
    assert np.linalg.norm(compiled["paper paper total"][-1]) > 0.5
    assert not compiled["coupled kkt total"][0].any()


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["checked", "python"])
def test_results_are_equal_to_rounding(results: dict[str, dict[str, Array]], mode: str) -> None:
    compiled, other = results["compiled"], results[mode]
    assert compiled.keys() == other.keys()
    assert len(compiled) > 40
    for name, values in compiled.items():
        if values.dtype == np.int64:
            np.testing.assert_array_equal(other[name], values, err_msg=name)
        else:
            np.testing.assert_allclose(other[name], values, rtol=1e-9, atol=1e-9, err_msg=name)

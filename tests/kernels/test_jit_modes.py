"""The kernels give the same results compiled, compiled with bounds checks, and as plain Python.

Bounds checks keep loops off the vector unit, and plain Python fuses no multiplication with an addition: floats agree to
rounding, integers exactly.
"""

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
from hhsim.trees.file import save_tree

TICKS = 24
SCRIPT = textwrap.dedent(
    f"""
    import pickle, sys
    from pathlib import Path
    sys.path.insert(0, {str(Path(__file__).parents[1])!r})
    import numpy as np
    from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
    from hhsim.metrics.metrics import penetration
    from hhsim.solver.hand_solver import HandSolver
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

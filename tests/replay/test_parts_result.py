"""Result of a thing of several parts: what its file holds, its second run, and what the referee says of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hhsim.kernels.tick.state import STATUS_NO_PLACE
from hhsim.replay.repeat import run_again
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import load_result
from hhsim.scene.scene import open_scene
from hhsim.solver.options import SolverOptions


def test_a_result_holds_the_parts_and_is_judged_part_by_part(tmp_path: Path) -> None:
    pytest.importorskip("coal")
    from hhsim.verify.verify import verify

    scene = open_scene("laptop", "close", solid=False, level=2)
    assert scene.parts is not None
    first, ticks = 1900, 400
    parts = replace(
        scene.parts,
        world=scene.parts.world[first : first + ticks],
        values={name: values[first : first + ticks] for name, values in scene.parts.values.items()},
    )
    path = tmp_path / "close.h5"
    # The hand comes down onto the base while the lid closes.
    summary = replay_scene(
        replace(scene, ticks=scene.ticks.first(ticks), parts=parts), SolverOptions(surface="mesh"), path
    )
    assert summary.ticks == ticks
    result = load_result(path)
    assert result.parts == ("things/laptop/base", "things/laptop/lid")
    assert np.array_equal(result["things/laptop/lid/joint"], parts.values["lid"])
    assert np.array_equal(result["things/laptop/lid/position"], parts.world[:, 1, :3])
    assert np.array_equal(result["things/laptop/base/orientation"], parts.world[:, 0, 3:])
    assert not (np.asarray(result["status"]) & STATUS_NO_PLACE).any()
    assert run_again(result).identical
    found = verify(result, every=5)
    assert found.passed, [claim for claim in found.claims if claim.failed]
    assert {claim.name for claim in found.claims} >= {"poses of parts", "depth", "non-penetration", "mesh"}

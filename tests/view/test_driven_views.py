"""A driven object in the viewer: where the world has it, tick by tick."""

from pathlib import Path

import numpy as np
import pytest
from driven_scenes import swung_result
from rerun_files import Recording
from short_grasp import short_grasp, short_scene

from hhsim.result.reader import Result
from hhsim.view.sink import parse_target
from hhsim.view.viewer import view_result


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return swung_result(short_scene(short_grasp(hold=0.03)), tmp_path_factory.mktemp("driven") / "driven.h5")


def test_the_viewer_moves_the_object_and_finds_the_contacts_on_it(result: Result, tmp_path: Path) -> None:
    path = tmp_path / "driven.rrd"
    view_result(result, parse_target(str(path)), spheres=True)
    recording, moved = Recording(path), result.moved_since_first()
    for entity in ("/world/object", "/world/spheres"):
        quaternion = recording.array(entity, "Transform3D:quaternion")[:, 0][:, [3, 0, 1, 2]]
        np.testing.assert_allclose(quaternion, moved.turn, atol=1e-6)
        np.testing.assert_allclose(recording.array(entity, "Transform3D:translation")[:, 0], moved.shift, atol=1e-6)
    points = recording.rows("/world/contacts/points", "Points3D:positions")
    assert [len(row or []) for row in points] == result["contacts/touching"].tolist()
    level = result.body.static["tree/level"]
    leaves = level == level.max()
    center, radius = result.body.static["tree/center"][leaves], result.body.static["tree/radius"][leaves]
    for tick in np.flatnonzero(result["contacts/touching"])[::10]:
        one = type(moved)(moved.turn[tick : tick + 1], moved.shift[tick : tick + 1])
        away = np.linalg.norm(one.points(center[None])[0][:, None] - np.array(points[tick]), axis=2) - radius[:, None]
        assert np.abs(away).min(axis=0).max() < 1.1e-5

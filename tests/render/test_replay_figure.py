"""The picture of a replay: drawn from the result file, at the hold, with the forces at the contacts."""

from pathlib import Path

import numpy as np
import pytest
from mesh_oracle import to_cone
from short_grasp import short_grasp, short_result

from hhsim.render import replay_figure
from hhsim.render.rasterizer import frame, look_from
from hhsim.render.replay_figure import PhalanxForce, arrow, draw_replay, label, phalanx_forces, shown_tick
from hhsim.render.viewpoint import View
from hhsim.report.figure import new_figure
from hhsim.result.reader import Result


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("replay") / "short.h5", short_grasp(release=0.05))


def test_each_force_begins_where_its_phalanx_touches(result: Result) -> None:
    forces = phalanx_forces(result, shown_tick(result))
    assert len(forces) >= 3
    level = result.static["object/tree/level"]
    leaves = level == level.max()
    spheres = list(zip(result.static["object/tree/center"][leaves], result.static["object/tree/radius"][leaves]))
    joints = result["graphic/joints"][shown_tick(result)]
    for force in forces:
        finger = ("thumb", "index", "middle", "ring", "little").index(force.name.split(",")[0])
        k = ("proximal", "middle", "distal").index(force.name.split(", ")[1])
        ends, radii = joints[finger, k : k + 2], result.static["hand/phalanx_radius"][finger, k : k + 2]
        assert abs(to_cone(force.contact[None], *ends, *radii)[0]) < 1e-3
        assert min(np.linalg.norm(force.contact - center) - radius for center, radius in spheres) < 2e-3
    total = np.sum([force.force for force in forces], axis=0)
    np.testing.assert_allclose(total, result["force/phalanx"][shown_tick(result)].sum(axis=(0, 1)), atol=0.15)


def test_arrows_grow_with_the_root_of_the_force(result: Result) -> None:
    force = phalanx_forces(result, shown_tick(result))[0]
    size = np.linalg.norm(force.force)
    assert np.linalg.norm(arrow(force)) == pytest.approx(0.02 * np.sqrt(size))
    assert arrow(force) @ force.force > 0.0


@pytest.mark.parametrize(("newtons", "size"), [(2.4, 9.0), (374.3, 9.0), (374.3, 12.5), (1445.0, 11.0)])
def test_a_number_at_the_edge_is_whole(newtons: float, size: float) -> None:
    rows, columns = shape = (544, 612)
    camera = frame(np.array([[-0.1, -0.1, -0.1], [0.1, 0.1, 0.1]]), look_from(View(0.0, 0.0).towards), shape)
    forces = [
        PhalanxForce("index, distal", np.array([0.0, side, 0.0]), np.array([0.0, np.sign(side) * newtons, 0.0]))
        for side in (-0.5, 0.5)
    ]
    with new_figure(columns / 170, rows / 170) as figure:
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.imshow(np.ones((*shape, 3)), aspect="auto")
        axes.set_axis_off()
        label(axes, forces, camera, size=size, pixel=100.0 / 170)
        boxes = [text.get_window_extent() for text in axes.texts]
        assert len(boxes) == 2
        assert min(box.x0 for box in boxes) >= 0.0
        assert max(box.x1 for box in boxes) <= figure.bbox.width


def test_writes_the_picture(result: Result, tmp_path: Path) -> None:
    import matplotlib.image

    draw_replay(result, tmp_path / "replay.png", View(60.0, 20.0))
    picture = matplotlib.image.imread(tmp_path / "replay.png")[:, :, :3]
    assert picture.shape[:2] == (640, 1240)
    half = picture.shape[1] // 2
    red = (picture[:, :, 0] > 0.6) & (picture[:, :, 1] < 0.25) & (picture[:, :, 2] < 0.25)
    blue = picture[:, :, 2] - picture[:, :, 0] > 0.2
    for mark in (red, blue):
        assert not mark[:, :half].any()
        assert mark[:, half:].sum() > 50


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "usage"),
        (["none.h5", "picture.png"], "none.h5: no such file; expected a result"),
        (["none.h5", "picture.png", "north"], "expected AZIMUTH,ELEVATION"),
    ],
)
def test_bad_arguments_are_one_line(arguments: list[str], says: str) -> None:
    with pytest.raises(SystemExit, match=says):
        replay_figure.draw_from_arguments(arguments, draw_replay, "hhsim.render.replay_figure", View(125.0, 12.0))

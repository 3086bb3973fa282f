"""Numbers at the arrows of a picture of the hand."""

import numpy as np
import pytest

from hhsim.render.hand_picture import PieceForce, label
from hhsim.render.rasterizer import frame, look_from
from hhsim.render.viewpoint import View
from hhsim.report.figure import new_figure


@pytest.mark.parametrize(("newtons", "size"), [(2.4, 9.0), (374.3, 9.0), (374.3, 12.5), (1445.0, 11.0)])
def test_a_number_at_the_edge_is_whole(newtons: float, size: float) -> None:
    rows, columns = shape = (544, 612)
    camera = frame(np.array([[-0.1, -0.1, -0.1], [0.1, 0.1, 0.1]]), look_from(View(0.0, 0.0).towards), shape)
    forces = [
        PieceForce("index/distal", np.array([0.0, side, 0.0]), np.array([0.0, np.sign(side) * newtons, 0.0]))
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

import numpy as np
import pytest
from sampled import sampled

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.scene.closure_search import best_slide, plan_finger_closure
from hhsim.scene.finger_closure import body_distances, make_work
from hhsim.scene.motion_catalogue import load_script
from hhsim.trees.sphere_tree import SphereTree

HAND = HandModel.default()


def row(axis: FloatArray, count: int = 41, length: float = 0.2) -> SphereTree:
    """Balls of 20 mm radius in a row."""
    center = np.linspace(-length / 2, length / 2, count)[:, None] * axis
    return SphereTree(
        np.vstack([np.zeros(3), center]),
        np.concatenate([[0.5 * length + 0.03], np.full(count, 0.02)]),
        np.concatenate([[0], np.ones(count, dtype=np.int64)]),
        np.concatenate([[-1], np.zeros(count, dtype=np.int64)]),
    )


@pytest.mark.parametrize(
    "axis", sampled([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.8, 0.0]], lambda place, _: place == 2)
)
def test_a_hand_on_a_bar_slides_along_the_bar(axis: list[float]) -> None:
    closure = plan_finger_closure(load_script("slide"), HAND, row(np.array(axis)))
    assert np.linalg.norm(closure.slide) == pytest.approx(1.0)
    assert abs(closure.slide @ closure.rotation[:, 2]) < 1e-12
    # 16 directions: the nearest one is at most 11.25 degrees off.
    assert abs(closure.slide @ axis) > np.cos(np.radians(12.0)) * np.linalg.norm(closure.rotation[:, :2].T @ axis)


def test_nothing_changes_along_a_bar_without_an_end_in_reach() -> None:
    # A bar a metre long feels the same all along a slide of 30 mm.
    script = load_script("slide")
    tree = row(np.array([0.0, 1.0, 0.0]), count=201, length=1.0)
    closure = plan_finger_closure(script, HAND, tree)
    direction, score = best_slide(script, closure, HAND.arrays(), tree.arrays())
    assert score > 0.9
    end = closure.position + script.slide_distance * direction
    near = body_distances(
        HAND.arrays(), tree.arrays(), end, closure.rotation, closure.command, closure.abduction, make_work()
    )
    fingers = near[:PALM_BODY].reshape(5, 3).min(axis=1)
    assert (fingers < 0.0).sum() == len(closure.reached) == len(FINGERS)


def test_a_script_without_a_slide_has_no_direction() -> None:
    closure = plan_finger_closure(load_script("grasp"), HAND, row(np.array([0.0, 1.0, 0.0])))
    assert closure.slide.tolist() == [0.0, 0.0, 0.0]

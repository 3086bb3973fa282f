"""Radii and palm around a skin: shapes that are known come back, nothing is left outside, and the solver takes them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled import sampled
from skin_samples import FLESH, SkinSample, skin_sample

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.repair.skin import cone_coordinates
from hhsim.repair.skin_hull import Palm, ball_cover, fit_radii, hand_with_skin
from hhsim.repair.written_hand import bone_frames
from hhsim.verify.tree_checks import outside_spheres

LENGTH = np.array([0.045, 0.028, 0.02])
JOINTS = np.stack([np.zeros(4), np.append(0.0, np.cumsum(LENGTH)), np.zeros(4)], axis=1)
PALMS: tuple[Palm, ...] = ("none", "thin", "fitted")


def depth_in_spheres(along: FloatArray, across: FloatArray, radius: FloatArray, length: FloatArray) -> FloatArray:
    """Least distance of points to 2,001 spheres of each cone: no less than the cones' own."""
    share = np.linspace(0.0, 1.0, 2001)[:, None, None]
    gap = np.hypot(along - share * length, across) - ((1.0 - share) * radius[:3] + share * radius[1:])
    return np.asarray(gap.min(axis=(0, 2)))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_all_points_are_inside_and_none_of_the_radius_is_idle(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 200))
    points = JOINTS[random.integers(0, 4, count)] + random.normal(0.0, 0.008, (count, 3))
    along, across = (each[0] for each in cone_coordinates(JOINTS[None], points[None]))
    radius = fit_radii(along, across, random.integers(0, 3, count), LENGTH)
    assert (np.diff(radius) <= 0.0).all() and radius[3] >= 1e-3 * (1.0 - 1e-6)
    gap = depth_in_spheres(along, across, radius, LENGTH)
    assert gap.max() <= 1e-8
    # Smaller by a hundredth of a millimetre it would leave a point outside, unless its least size bounds it.
    smaller = depth_in_spheres(along, across, radius - 1e-5, LENGTH)
    assert smaller.max() > 0.0 or radius.max() < 1.02e-3


@given(st.integers(0, 2**32 - 1), st.integers(1, 64))
@settings(max_examples=20)
def test_balls_cover_all_points(seed: int, most: int) -> None:
    random = np.random.default_rng(seed)
    points = random.normal(0.0, 0.02, (int(random.integers(1, 150)), 3))
    normal = random.normal(size=points.shape) * random.integers(0, 2, (len(points), 1))
    center, radius = ball_cover(points, normal, most)
    assert 1 <= len(radius) <= most
    assert (np.linalg.norm(points[:, None] - center, axis=2) - radius).min(axis=1).max() <= 1e-12


@pytest.mark.parametrize("palm", PALMS)
@pytest.mark.parametrize("side", sampled(["right", "left"], lambda _, side: side == "left"))
def test_the_hand_contains_its_skin(side: str, palm: Palm) -> None:
    sample = skin_sample("left" if side == "left" else "right")
    hand, fit = hand_with_skin(sample.hand, sample.skin, sample.fitted, palm)
    assert (
        outside_spheres(
            hand.palm_mesh.vertices, hand.palm_mesh.faces, hand.palm_tree.leaf_center, hand.palm_tree.leaf_radius
        ).max()
        <= 1e-9
    )
    # The flesh's rings lie on round cones; between rings that straddle a joint these are a little larger.
    assert np.abs(hand.radius - FLESH).max() < 2e-5
    assert hand.palm_tree.leaf_count <= sample.hand.palm_tree.leaf_count
    outside, inside = own_gaps(sample, hand, palm)
    assert fit.contained == (outside == 0.0).mean()
    np.testing.assert_allclose(
        [fit.excess_mean, fit.excess_max, fit.slack_mean], [outside.mean(), outside.max(), inside.mean()], atol=1e-6
    )
    assert fit.excess[1:].max() == 0.0
    if palm == "fitted":
        assert fit.contained == 1.0 and fit.excess_max == 0.0 and fit.slack_mean < 1e-3
    elif palm == "thin":
        assert fit.excess_max == fit.excess[0] > 0.0
        assert np.ptp(hand.palm_mesh.vertices[:, 2]) == pytest.approx(
            0.5 * np.ptp(sample.hand.palm_mesh.vertices[:, 2]), rel=1e-9
        )
    else:
        assert np.isnan(fit.excess[0]) and fit.excess_max == 0.0


def own_gaps(sample: SkinSample, hand: HandModel, palm: Palm) -> tuple[FloatArray, FloatArray]:
    """Distances of all vertices outside and inside the bodies of their bones, by sampled spheres."""
    found = []
    share = np.linspace(0.0, 1.0, 401)[:, None]
    for t, vertices in enumerate(sample.skin.vertices):
        joints = hand.joints(*sample.fitted.at(t))
        for finger in range(5):
            own = vertices[(sample.skin.bone - 1) // 3 == finger][:, None, None]
            cones = []
            for k in range(3):
                center = (1.0 - share) * joints[finger, k] + share * joints[finger, k + 1]
                radius = (1.0 - share[:, 0]) * hand.radius[finger, k] + share[:, 0] * hand.radius[finger, k + 1]
                cones.append((np.linalg.norm(own[:, 0] - center, axis=2) - radius).min(axis=1))
            found.append(np.min(cones, axis=0))
        if palm != "none":
            turn = rotation_matrix(sample.fitted.orientation[t])
            center = hand.palm_tree.leaf_center @ turn.T + sample.fitted.position[t]
            own = vertices[sample.skin.bone == 0][:, None]
            found.append((np.linalg.norm(own - center, axis=2) - hand.palm_tree.leaf_radius).min(axis=1))
    gap = np.concatenate(found)
    # Sampled spheres miss the nearest one by a fraction of a micrometre.
    gap[np.abs(gap) < 1e-6] = 0.0
    return np.maximum(gap, 0.0), np.maximum(-gap, 0.0)


def test_a_skin_without_frames_or_palm_is_refused() -> None:
    sample = skin_sample()
    nowhere = replace(sample.skin, vertices=np.full_like(sample.skin.vertices, np.nan))
    with pytest.raises(InputError, match="no frame has finite vertices"):
        hand_with_skin(sample.hand, nowhere, sample.fitted, "none")
    fingers = replace(sample.skin, weights=np.eye(16)[np.maximum(sample.skin.bone, 1)])
    with pytest.raises(InputError, match="no vertex belongs to the palm; choose a palm that is none or thin"):
        hand_with_skin(sample.hand, fingers, sample.fitted, "fitted")


def test_frames_that_are_missing_do_not_count() -> None:
    sample = skin_sample()
    vertices = sample.skin.vertices.copy()
    vertices[4, 100] = np.nan
    position = sample.fitted.position.copy()
    position[7] = np.nan
    holed = hand_with_skin(
        sample.hand, replace(sample.skin, vertices=vertices), sample.fitted._replace(position=position), "none"
    )
    kept = [t for t in range(12) if t not in (4, 7)]
    whole = hand_with_skin(
        sample.hand, replace(sample.skin, vertices=vertices[kept]), sample.fitted.at(np.array(kept)), "none"
    )
    assert np.array_equal(holed[0].radius, whole[0].radius) and holed[1].slack_mean == whole[1].slack_mean
    assert np.isfinite(bone_frames(holed[0], sample.fitted)).all()


def test_a_misfitted_frame_swells_no_hand() -> None:
    sample = skin_sample()
    whole = hand_with_skin(sample.hand, sample.skin, sample.fitted, "fitted")[0]
    vertices = np.tile(sample.skin.vertices, (17, 1, 1))
    vertices[100] += [0.0, 0.0, 0.02]
    skin = replace(sample.skin, vertices=vertices)
    fitted = HandConfiguration(*(np.concatenate([values] * 17) for values in sample.fitted))
    hand, fit = hand_with_skin(sample.hand, skin, fitted, "fitted", 0.99)
    np.testing.assert_allclose(hand.radius, whole.radius, atol=1e-6)
    assert hand.palm_tree.leaf_radius.max() < whole.palm_tree.leaf_radius.max() + 1e-3
    assert 1.0 - 1.0 / 204 <= fit.contained < 1.0 and 0.01 < fit.excess_max <= 0.02
    assert hand_with_skin(sample.hand, skin, fitted, "none", 1.0)[1].contained == 1.0

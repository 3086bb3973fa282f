"""The hand of a recording: bones as medians, radii as recorded or in proportion."""

import numpy as np
import pytest
from joint_samples import Side, joint_sample, openxr_csv
from recording_samples import read_as, smooth_recording
from sampled import sampled

from hhsim.errors import TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.recordings.joint_fit import fitted_hand


@pytest.mark.parametrize(
    ("side", "radii"),
    sampled([(side, radii) for side in ("right", "left") for radii in (True, False)], lambda place, _: place in (0, 3)),
)
@pytest.mark.quick("right-True")
def test_a_hand_of_another_size_is_found(side: Side, radii: bool) -> None:
    sample = joint_sample(side, length=0.17)
    moved, text = fitted_hand(read_as("openxr", openxr_csv(sample, side, radii=radii)), "take.csv")
    assert ("radius" in text.split("\n", 1)[1]) is radii
    # A hand file has micrometres.
    hand = HandModel.of_text(text, "take.toml", side)
    assert hand.hand_length == pytest.approx(0.17, abs=1e-3 if radii else 0.008)
    assert hand.hand_breadth == pytest.approx(sample.hand.hand_breadth, abs=2e-6)
    bones = slice(None) if radii else slice(2)
    assert np.allclose(hand.length[:, bones], sample.hand.length[:, bones], atol=1e-6)
    assert np.allclose(hand.radius, sample.hand.radius, atol=1e-6) or not radii
    k = 11
    joints = hand.joints(moved.position[k], moved.orientation[k], moved.flexion[k], moved.abduction[k])
    own = sample.hand.joints(
        sample.motion.position[k], sample.motion.orientation[k], sample.motion.flexion[k], sample.motion.abduction[k]
    )
    assert np.abs(joints[:, :3] - own[:, :3]).max() < 5e-6


@pytest.mark.soak
def test_a_tracker_whose_bones_breathe_gives_one_hand() -> None:
    still, noisy = (
        HandModel.of_text(fitted_hand(read_as("openxr", openxr_csv(joint_sample(count=400, noise=noise))), "")[1], "")
        for noise in (0.0, 0.001)
    )
    assert np.abs(noisy.length - still.length).max() < 3.0 * 1e-3 * np.sqrt(2.0 * np.pi / 400.0) + 1e-4


def test_what_gives_no_hand_is_refused() -> None:
    with pytest.raises(TrajectoryError, match="needs the centres of the joints, and test holds"):
        fitted_hand(smooth_recording(), "")

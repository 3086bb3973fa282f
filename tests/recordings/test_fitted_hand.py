"""The hand of a recording: bones as medians, radii as recorded or in proportion."""

from pathlib import Path

import numpy as np
import pytest
from joint_samples import Side, joint_sample, openxr_csv
from recording_samples import read_as, smooth_recording
from sampled import sampled

from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.recordings.fitted_hand import fitted_hand, for_hand, format_fitted_hand


@pytest.mark.parametrize(
    ("side", "radii"),
    sampled([(side, radii) for side in ("right", "left") for radii in (True, False)], lambda place, _: place in (0, 3)),
)
def test_a_hand_of_another_size_is_found(side: Side, radii: bool, tmp_path: Path) -> None:
    sample = joint_sample(side, length=0.17)
    recording = read_as("openxr", openxr_csv(sample, side, radii=radii))
    fitted = fitted_hand(recording)
    assert fitted.hand_length == pytest.approx(0.17, abs=1e-3 if radii else 0.008)
    assert fitted.hand_breadth == pytest.approx(sample.hand.hand_breadth, abs=1e-6)
    assert np.allclose(fitted.length[:, :2], sample.hand.length[:, :2], atol=1e-9)
    if radii:
        assert np.allclose(fitted.length, sample.hand.length) and np.allclose(fitted.radius, sample.hand.radius)
    path = tmp_path / "hand.toml"
    path.write_text(format_fitted_hand(fitted, "take.csv"))
    assert ("radius" in path.read_text().split("\n", 1)[1]) is radii
    hand, moved = HandModel.from_toml(path, side), for_hand(recording, fitted)
    k = 11
    joints = hand.joints(moved.position[k], moved.orientation[k], moved.flexion[k], moved.abduction[k])
    own = sample.hand.joints(
        sample.motion.position[k], sample.motion.orientation[k], sample.motion.flexion[k], sample.motion.abduction[k]
    )
    assert np.abs(joints[:, :3] - own[:, :3]).max() < 5e-6


def test_a_tracker_whose_bones_breathe_gives_one_hand() -> None:
    still = fitted_hand(read_as("openxr", openxr_csv(joint_sample(count=400))))
    noisy = fitted_hand(read_as("openxr", openxr_csv(joint_sample(count=400, noise=0.001))))
    assert np.abs(noisy.length - still.length).max() < 3.0 * 1e-3 * np.sqrt(2.0 * np.pi / 400.0) + 1e-4


def test_what_gives_no_hand_is_refused() -> None:
    with pytest.raises(TrajectoryError, match="needs the centres of the joints, and test holds"):
        fitted_hand(smooth_recording())
    hand = fitted_hand(read_as("openxr", openxr_csv(joint_sample())))
    with pytest.raises(InputError, match=r"--fit-hand: hand_length = 0\.9; expected"):
        format_fitted_hand(hand._replace(hand_length=0.9), "take.csv")

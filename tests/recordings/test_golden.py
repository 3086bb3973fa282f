"""Every format reads its tiny file as the golden one has it, to the last word, and has our own hand in it."""

import json
from pathlib import Path

import numpy as np
import pytest
from joint_samples import Y_UP, joint_sample
from leap_document import document, packed
from lzstring import LZString
from recorded_files import CASES, COUNT, GOLDEN, PLACE, TURN, imported, laid_out

from hhsim.hand.quaternion import rotation_matrix
from hhsim.recordings.formats import FORMATS
from hhsim.recordings.registry import read_recording


def test_every_format_has_a_case() -> None:
    assert {name.partition(",")[0] for name in CASES} == set(FORMATS.names())


@pytest.mark.parametrize("name", CASES)
def test_an_import_gives_what_it_gave(name: str, tmp_path: Path) -> None:
    found = imported(CASES[name], tmp_path)
    with np.load(GOLDEN) as held:
        golden = {key.removeprefix(f"{name}/"): held[key] for key in held.files if key.startswith(f"{name}/")}
    assert set(found) == set(golden)
    assert str(found.pop("said")) == str(golden.pop("said"))
    for key, values in golden.items():
        np.testing.assert_allclose(found[key], values, rtol=0.0, atol=1e-12, err_msg=key)


OTHERS = (
    "aria",
    "csv, Euler",
    "csv, mapped",
    "csv, own and",
    "dexmo",
    "keypoints, no scale",
    "leap",
    "lerobot, mapped",
    "mano, coefficients",
    "npz, degrees",
)
"""Files of something else than the whole of our sample."""
ROUNDED = {"bvh": 1e-3, "mcap": 4e-5}
"""Errors of flexions by numbers of few digits [rad]: an MCAP rounds centres to 2⁻²⁵ of half a metre."""


@pytest.mark.parametrize("name", [name for name in CASES if not name.startswith(OTHERS)])
def test_our_own_hand_comes_back(name: str, tmp_path: Path) -> None:
    recording = read_recording(*laid_out(CASES[name], tmp_path))
    side = "left" if recording.hand == "left" else "right"
    motion, form = joint_sample(side, count=COUNT, bend=CASES[name].bend).motion, name.partition(",")[0]
    assert recording.form == form or form == "csv"
    atol = ROUNDED.get(form, 1e-6)
    for key in ("flexion", "abduction"):
        assert np.nanmax(np.abs(getattr(recording, key) - getattr(motion, key))) < atol, key
    if form == "keypoints" and recording.object_motion is not None and "mirror" not in name:
        np.testing.assert_allclose(recording.object_motion.position, PLACE @ Y_UP, atol=1e-9)
        np.testing.assert_allclose(
            rotation_matrix(recording.object_motion.orientation), Y_UP.T @ TURN.as_matrix(), atol=1e-9
        )
    if recording.joints is not None and CASES[name].options.get("world_up", "y") == "y":
        assert np.nanmax(np.abs(recording.position - motion.position)) < max(1e-9, atol * (form in ROUNDED))


def test_every_packing_of_leap_is_the_same(tmp_path: Path) -> None:
    whole, path = document(count=12), tmp_path / "take.json"
    path.write_text(json.dumps(whole))
    plain = read_recording(path)
    for text in (
        json.dumps(packed(whole)),
        json.dumps(whole["frames"]),
        "\n".join(json.dumps(frame) for frame in [{"version": 6}, *whole["frames"]]),
        LZString.compressToBase64(json.dumps(packed(whole))),
        json.dumps(whole).replace("btipPosition", "tipPosition"),
    ):
        path.write_text(text)
        other = read_recording(path)
        assert (other.form, other.name) == ("leap", "take")
        assert other.flexion.tobytes() == plain.flexion.tobytes() and other.time.tobytes() == plain.time.tobytes()

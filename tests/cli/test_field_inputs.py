"""Files that strangers brought: the command that each stands for, and what it has to say."""

import re
import shlex
from pathlib import Path

import pytest
from conftest import Run

INPUTS = {
    # A command on the files of a folder, by its exit code and what it says.
    "import bvh-ring-mid/c6_mid.bvh": (0, "middle .*\n *ring "),
    "import bvh-unsided-hand/c4_unsided.bvh --hand right": (0, "right hand of 203 mm"),
    "import bvh-xsens-names/c5_xsens.bvh": (0, "right hand at 'RightHand'"),
    "import bvh-zero-positions/c2_zero6.bvh": (0, "0 in every frame: each stands at its OFFSET"),
    "import filled-called-held/a2_m1.npy --rate 30 --hand right": (0, "no hand was seen, so missing"),
    "import hdf5-of-others/r_generic.hdf5 --hand right --rate 30": (2, r"joints3d_right \(60, 21, 3\), object/pose"),
    "import joint-order-26-unity/s26_unity.npy --rate 30 --hand right": (
        2,
        "their order, --joint-order openxr or unity",
    ),
    "import npz-quat-xyzw/f4_xyzw.npz": (0, "no name tells the order of the quaternions, .*--pose-order"),
    "import openxr-location-flags/b1_flags.csv": (0, "without a valid position, says the device: missing"),
    "import ros-sec-nanosec/q_ros.csv --world-up y": (0, "right hand of 203 mm"),
    "build-tree obj-negative-indices/o_rel.obj --leaves 8": (0, "o_rel: 24 triangles"),
    "build-tree stl-ascii-no-endsolid/i2_two_noend.stl --leaves 8": (0, "no 'endsolid'(.|\n)*24 triangles"),
    "build-tree tree-spheres-of-metres/u_fan.stl --level 2": (0, r"\n +2 +64 +6\.(.|\n)*proved and checked"),
    "build-tree srdf-from/arm.urdf --from srdf-from/arm.srdf --as json": (0, "arm: 3 links"),
}


@pytest.mark.parametrize("line", INPUTS)
def test_a_file_that_somebody_brought_is_read_or_refused_for_what_it_is(
    line: str, run: Run, shared_data: Path, tmp_path: Path
) -> None:
    folder = shared_data / "field" / "inputs"
    words = [str(folder / word) if (folder / word).is_file() else word for word in shlex.split(line)]
    out = tmp_path / f"o.{'json' if 'json' in words else 'h5'}"
    expected, said = INPUTS[line]
    code, shown, told = run(*words, "--out", str(out))
    assert code == expected and re.search(said, told + shown), told + shown
    assert out.exists() == (code == 0) and (code == 0 or told.count("\n") == 1)

"""Repair of a LeRobot data set, episode by episode: its hands come out of the object, all else stays as it is.

python repair_lerobot.py DATASET OBJECT OUT [right|left]

Episodes have joints in a feature `hand_joints`, and the object's pose (docs/recordings.md has the names of both).
Needs pyarrow. Both layouts: an episode a file (v2.1), and several in a file (v3).
"""

import shutil
import sys
import tempfile
from pathlib import Path

from pyarrow import parquet

from hhsim.motion.trajectory import HandSide
from hhsim.repair.repair import repair_recording
from hhsim.repair.request import RepairRequest


def repair_data_set(data_set: Path, thing: str, out: Path, hand: HandSide = "") -> None:
    """Copy a data set to `out`, and repair each episode of it there; one that cannot be repaired ends the work."""
    shutil.copytree(data_set, out)
    for path in sorted(out.glob("data/**/*.parquet")):
        for episode in sorted(set(parquet.read_table(path, columns=["episode_index"])[0].to_pylist())):
            # Beside the file, so that meta/info.json of the data set is found.
            with tempfile.TemporaryDirectory(dir=path.parent) as folder:
                repaired = Path(folder) / path.name
                options = {"episode": int(episode)}
                outcome = repair_recording(
                    RepairRequest(path, thing, repaired, hand=hand, pictures=False, options=options)
                )
                repaired.replace(path)
            depth = [1e3 * outcome.figures[f"depth_cones_max_{when}"] for when in ("before", "after")]
            print(f"episode {episode}: {outcome.frames} frames, {depth[0]:.2f} mm deep, {depth[1]:.3f} mm repaired")


if __name__ == "__main__":
    source, thing, target, *side = sys.argv[1:]
    repair_data_set(Path(source), thing, Path(target), "left" if side == ["left"] else "right" if side else "")

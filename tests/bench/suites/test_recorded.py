"""The suite `recorded`: its rows are replays, and what cannot be replayed is told."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import smooth_recording

from hhsim.bench.suite import run_cells
from hhsim.bench.suites.recorded import Recorded
from hhsim.errors import InputError
from hhsim.motion.file import save_trajectory
from hhsim.recordings.cleaning import clean_recording
from hhsim.table.file import load_table

Run = Callable[..., Any]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two recordings of a hand that closes in the middle, one of them as CSV, and what is none."""
    inside = tmp_path / "recordings"
    inside.mkdir()
    for name, samples in (("a.h5", 60), ("b.csv", 40)):
        motion = clean_recording(smooth_recording(samples, rate=50.0)).trajectory
        closure = np.interp(np.arange(samples), [0, samples // 3, samples // 2, samples - 1], [0.0, 0.0, 1.1, 1.0])
        flexion = np.clip(0.1 + closure[:, None, None] * np.array([0.7, 1.0, 0.6]) + 0.0 * motion.flexion, -0.2, 1.5)
        motion = replace(motion, flexion=flexion, position=0.3 * motion.position, name=name[0], flags=None)
        save_trajectory(motion, inside / name)
    (inside / "README.md").write_text("about them")
    return inside


def test_a_row_is_what_a_replay_of_the_same_words_says(folder: Path, run: Run) -> None:
    swept = {"objects": ("cup",), "methods": ("coupled",), "surfaces": ("spheres", "mesh")}
    suite = Recorded.planned(recordings=(str(folder / "a.h5"),), **swept, rate=250.0, level=3)
    (spheres,), (mesh,) = list(run_cells(suite))
    words = ("replay", "cup", str(folder / "a.h5"), "--rate", "250", "--level", "3", "--place-object", "auto")
    document = json.loads(run(*words, "--json").out)
    for name in ("penetration_max", "contact_error_max", "force_contact_mean", "stuck_ticks", "lag_ticks"):
        assert spheres[name] == document[name], name
    assert spheres["verdict"] == document["verdict"]["word"]
    assert spheres["reason"] == ", ".join(document["verdict"]["missed"])
    assert (spheres["surface"], mesh["surface"]) == ("spheres", "mesh")
    assert mesh["contact_error_max"] < 2e-6 < 1e-3 < spheres["contact_error_max"], "the spheres are off the thin wall"


@pytest.mark.soak
def test_the_command_tells_what_cannot_be_run(run: Run, folder: Path, tmp_path: Path) -> None:
    where = ("bench", "recorded", "recordings", "--object", "cup", "--method", "paper")
    answer = run(*where, "--out", "t.json")
    assert answer.code == 0, answer.err
    assert "recorded hands, 1000 ticks a second" in answer.out and "no limit missed" in answer.out
    table = load_table(tmp_path / "t.json")
    assert table.suite == "recorded" and [row["motion"] for row in table.rows] == ["a", "b"]
    (folder / "c.npz").write_bytes(b"nothing")
    document = json.loads((failed := run(*where, "--json")).out)
    assert failed.code == 1 and len(document["rows"]) == 3
    (missed,) = document["missed"]
    assert missed.startswith("c, cup, paper, failed, ") and "c.npz" in missed


def test_no_recordings_are_refused(folder: Path) -> None:
    (folder / "empty").mkdir()
    for words in ((), (str(folder / "empty"),), (str(folder / "none"),)):
        with pytest.raises(InputError, match="recordings"):
            Recorded.planned(recordings=words)

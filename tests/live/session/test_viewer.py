"""The viewer's process: what it shows of a session that the test plays, and what it makes of a viewer that leaves."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_peers import until
from live_rings import make_setup, pour, session_process, solved_ticks
from rerun_files import PATIENCE, Recording, listening

from hhsim.kernels.tick.state import WORK_TOUCHING
from hhsim.live.processes import RingReader, Stage
from hhsim.live.session.memory import SessionMemory
from hhsim.live.session.recorder import SessionWriter
from hhsim.live.session.setup import LiveSetup
from hhsim.live.session.viewer import LiveViewer
from hhsim.render.triangle_soup import piece_poses
from hhsim.result.reader import load_result
from hhsim.result.safety import Safety
from hhsim.result.schema import WARNING
from hhsim.view.plots import LIVE_PLOTS
from hhsim.view.sink import parse_target
from hhsim.view.viewer import view_result

Records = np.ndarray[Any, Any]


@pytest.fixture(scope="module")
def played() -> tuple[LiveSetup, Records]:
    """A session's setup, and 200 ticks that a loop would publish."""
    setup = make_setup(None)
    records = solved_ticks(setup)[-200:]
    count = np.arange(len(records))
    records["wakeup_ns"] = 5_000 + count
    records["latency_ns"] = np.where(count % 5 == 0, 90_000 + count, -1)
    records["safety"] = np.where(count < 60, Safety.NO_INPUT_YET, 0)
    records["command_stiffness"] = 0.002 * count[:, None] * [1.0, 0.5, 0.25, 0.0, 0.1]
    return setup, records


def shown(setup: LiveSetup, target: str) -> LiveSetup:
    return replace(setup, rerun=target)


@pytest.fixture
def memory() -> Iterator[SessionMemory]:
    memory = SessionMemory.create()
    memory.status["stage"] = Stage.RUNNING
    yield memory
    memory.status["stage"] = Stage.ENDED


def test_frames_are_the_newest_ticks_and_their_plots_the_worst_since(
    played: tuple[LiveSetup, Records], memory: SessionMemory, tmp_path: Path
) -> None:
    setup, records = played
    path = tmp_path / "live.rrd"
    viewer = LiveViewer(shown(setup, str(path)), memory)
    parts = [slice(0, 50), slice(50, 51), slice(51, 120), slice(120, 200)]
    memory.log(WARNING, "before the first tick")
    pour(memory.ticks, records[parts[0]])
    thread = threading.Thread(target=viewer.run, daemon=True)
    thread.start()
    for part in parts[1:]:
        # Twice: the sign of life may be of a frame that looked into the ring before.
        for _ in range(2):
            before = int(memory.status["viewer_ns"])
            until(lambda before=before: int(memory.status["viewer_ns"]) > before)
        pour(memory.ticks, records[part])
    memory.status["stage"] = Stage.ENDED
    thread.join(PATIENCE)
    assert not thread.is_alive()

    recording = Recording(path)
    newest = [part.stop - 1 for part in parts]
    np.testing.assert_allclose(recording.times("/world/graphic/palm"), 1e-3 * np.array(newest), atol=1e-9)
    for whose, prefix in (("graphic", ""), ("haptic", "haptic_")):
        names = ("position", "orientation", "flexion", "abduction")
        poses = piece_poses(setup.worn[0].model, *(records[f"{prefix}{name}"][newest] for name in names))
        index = recording.array(f"/world/{whose}/index/distal", "Transform3D:translation")[:, 0]
        np.testing.assert_allclose(index, poses.translation[:, 5], atol=1e-7)
    points = recording.rows("/world/contacts/points", "Points3D:positions")
    assert [len(row or []) for row in points] == records["work"][newest, WORK_TOUCHING].tolist()
    assert len(points[-1]) > 3

    plots = {plot.path: recording.array(f"/{plot.path}", "Scalars:scalars") for plot in LIVE_PLOTS}
    whole = [1e-3 * records["duration_total"][part].max() for part in parts]
    np.testing.assert_allclose(plots["plots/time"][:, -1], whole)
    np.testing.assert_allclose(plots["plots/force"][:, 0], np.linalg.norm(records["total"][newest], axis=1))
    np.testing.assert_allclose(plots["plots/glove"], records["command_stiffness"][newest])
    np.testing.assert_allclose(plots["plots/loop"][:, 0], [5.0 + 1e-3 * tick for tick in newest])
    np.testing.assert_allclose(plots["plots/loop"][:, 1], [90.045, 90.050, 90.115, 90.195])
    assert plots["plots/depth"][:, 0].max() == 0.0
    states = recording.rows("/states/fingers", "StateChange:state")
    assert states == [["no input yet"], ["held where they touch"]]
    assert recording.rows("/log", "TextLog:text") == [["before the first tick"]]
    assert recording.rows("/log", "TextLog:level") == [["WARN"]]


def test_a_recorded_session_shows_the_same_later(
    played: tuple[LiveSetup, Records], memory: SessionMemory, tmp_path: Path
) -> None:
    setup, records = played
    memory.log(WARNING, "no fresh input", time_ns=int(records["time_ns"][20]))
    facts = {"device": {"name": "glove", "channels": ["bend"]}}
    with SessionWriter(tmp_path / "session.h5", setup, setup.options, facts) as writer:
        taken = {"ticks": (0, records), "events": RingReader(memory.events).read(10)}
        writer.write([taken], memory.status["counters"])
    path = tmp_path / "session.rrd"
    view_result(load_result(tmp_path / "session.h5"), parse_target(str(path)))
    recording = Recording(path)
    stiffness = recording.array("/plots/glove", "Scalars:scalars")
    np.testing.assert_allclose(stiffness, records["command_stiffness"])
    loop = recording.array("/plots/loop", "Scalars:scalars")
    np.testing.assert_allclose(loop[:, 0], 1e-3 * records["wakeup_ns"])
    np.testing.assert_array_equal(np.isnan(loop[:, 1]), records["latency_ns"] < 0)
    states = recording.rows("/states/fingers", "StateChange:state")
    assert states == [["no input yet"], ["held where they touch"]]
    begin = recording.times("/plots/loop")[0]
    np.testing.assert_allclose(recording.times("/states/fingers") - begin, [0.0, 0.06], atol=1e-9)
    np.testing.assert_allclose(recording.times("/log") - begin, [0.02], atol=1e-9)
    assert recording.rows("/log", "TextLog:text") == [["no fresh input"]]


def test_a_hand_that_is_no_number_is_shown_without_contacts(
    played: tuple[LiveSetup, Records], memory: SessionMemory, tmp_path: Path
) -> None:
    setup, records = played
    broken = records[-2:].copy()
    broken["joints"][1], broken["position"][1] = np.nan, np.nan
    pour(memory.ticks, broken)
    memory.status["stage"] = Stage.ENDED
    path = tmp_path / "live.rrd"
    LiveViewer(shown(setup, str(path)), memory).run()
    assert Recording(path).rows("/world/contacts/points", "Points3D:positions") == [[]]


@contextmanager
def viewer_process(setup: LiveSetup, memory: SessionMemory, port: int, *how: str) -> Iterator[Callable[[Records], str]]:
    """The process of a viewer at a port, by default as the supervisor starts it; how to wait for its last line."""
    words = how or ("-m", "hhsim.live.session.viewer")
    with session_process(shown(setup, f"connect={port}"), memory, *words) as process:

        def last_line(fed: Records) -> str:
            def is_over() -> bool:
                pour(memory.ticks, fed)
                return process.poll() is not None

            until(is_over)
            assert process.returncode == 0
            return process.stderr.read().splitlines()[-1]

        until(lambda: int(memory.status["viewer_ns"]) > 0)
        yield last_line


def test_a_viewer_that_is_closed_ends_the_process_and_nothing_else(
    played: tuple[LiveSetup, Records], memory: SessionMemory, tmp_path: Path
) -> None:
    setup, records = played
    pour(memory.ticks, records[:100])
    with listening(tmp_path / "got.rrd") as (port, viewer), viewer_process(setup, memory, port) as last_line:
        viewer.kill()
        assert last_line(records[:0]) == "hhsim: the viewer was closed"
    # The writer of the ring never waits for a reader.
    pour(memory.ticks, np.repeat(records, 100))
    assert memory.ticks.written == 20_100


@pytest.mark.soak
def test_a_viewer_that_stalls_is_given_up(
    played: tuple[LiveSetup, Records], memory: SessionMemory, tmp_path: Path
) -> None:
    setup, records = played
    impatient = "import sys; import hhsim.live.session.viewer as v; v.LONGEST_STALL = 2.0; sys.exit(v.main())"
    with (
        listening(tmp_path / "got.rrd") as (port, viewer),
        viewer_process(setup, memory, port, "-c", impatient) as last_line,
    ):
        viewer.send_signal(signal.SIGSTOP)
        # More than the connection takes.
        assert last_line(records) == "hhsim: the viewer has taken nothing for 2 s"

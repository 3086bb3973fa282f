"""The gloves that there are, and one more: a driver and its record are all that it takes."""

import contextlib
import importlib
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run
from live_scripted import FIST, FREE, FakeClock, InStep, make_setup

from hhsim.live.device import DeviceError, FingerRelease
from hhsim.live.drivers.played import Playback
from hhsim.live.drivers.poses import make_pose_source
from hhsim.live.gloves import GLOVES, POSES, PoseConfig, configure, open_device, open_release
from hhsim.live.session.memory import SessionMemory
from hhsim.live.session.setup import OutputLimits, SafetyLimits
from hhsim.motion.trajectory import Trajectory

TEXT_GLOVE = '''
"""Bends read from a file of text: five numbers a line, a line a sample."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hhsim.live.device import LIMITS, DeviceCounters, DeviceError, FingerCommand, GloveDevice, GloveInfo
from hhsim.live.gloves import GLOVES, Glove, GloveConfig, GloveOptions, setting


@dataclass(frozen=True)
class TextOptions(GloveOptions):
    file: str = setting("", "File of bends", "FILE")
    fist: float = setting(90.0, "Angle of every joint of a fist", "DEG", unit="deg", least=1.0, most=120.0)


class TextGlove(GloveDevice):
    def __init__(self, config: GloveConfig) -> None:
        self.options = config.options
        self.clock = lambda: 0
        self.stiffness: list[float] = []

    def open(self, timeout: float = 5.0) -> None:
        if not Path(self.options.file).is_file():
            raise DeviceError(f"no file {self.options.file}")
        self.lines = [line.split() for line in Path(self.options.file).read_text().splitlines()]
        self.info = GloveInfo("text", ("bend",) * 5, LIMITS)
        self.counters = DeviceCounters()

    def read(self, samples_out: np.ndarray) -> int:
        if self.counters.samples == len(self.lines):
            return 0
        bends = np.array(self.lines[self.counters.samples], float)
        flexion = np.radians(self.options.fist) * np.tile(bends[:, None], 3)
        self._write_sample(samples_out[0], self.clock(), True, bends, (flexion, np.zeros(5)))
        return 1

    def send(self, command: FingerCommand) -> bool:
        self.stiffness.append(float(command.stiffness.max()))
        return True

    def release(self, timeout: float = 0.05) -> bool:
        self.stiffness.append(0.0)
        return True

    def reconnect(self) -> bool:
        return True

    def close(self) -> None:
        pass


GLOVE = Glove("bends from a file of text", driver=f"{__name__}:TextGlove", options=TextOptions)
'''


@pytest.fixture
def text_glove(installed: Callable[..., None]) -> None:
    """The glove, as an installed package declares it."""
    installed("hhsim.gloves", "text = their_glove:GLOVE", their_glove=TEXT_GLOVE)


BOUND: list[Any] = []
"""Addresses that sockets of this process were bound to."""


def test_nothing_listens_beyond_the_loopback_unless_told() -> None:
    sys.addaudithook(lambda event, values: BOUND.append(values[1]) if event == "socket.bind" else None)
    BOUND.clear()
    level = np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    motion = Playback(Trajectory(np.arange(2.0), np.zeros((2, 3)), level, np.zeros((2, 5, 3)), np.zeros((2, 5))))
    for name in GLOVES:
        glove = open_device(configure(name, playback=motion))
        with contextlib.closing(glove), contextlib.suppress(DeviceError):
            glove.open(0.0)
    knowing = open_device(configure("openxr"))
    for kind in POSES:
        source = make_pose_source(PoseConfig(kind, playback=motion), SessionMemory.create().status, knowing)
        with contextlib.closing(source), contextlib.suppress(DeviceError):
            source.open()
    ports = {port for _, port in BOUND}
    assert {24170, 24172} <= ports, "those that listen were opened"
    assert {host for host, _ in BOUND} == {"127.0.0.1"}
    BOUND.clear()
    with contextlib.suppress(DeviceError):
        open_device(configure("udp", host="192.0.2.1")).open(0.0)
    assert BOUND == [("", 24170)], "told that its peer is another machine"


def test_what_the_watchdog_opens_knows_nothing_of_readings() -> None:
    config = configure("dexmo", port=1)
    assert config.calibration is not None
    bare = make_setup(device=config).for_watchdog([0])[0].device
    assert (bare.calibration, bare.playback, bare.options) == (None, None, config.options)
    assert isinstance(open_release(bare), FingerRelease)
    assert type(open_release(configure("sim"))) is FingerRelease


def test_a_glove_in_one_file_drives_the_loop_and_is_stopped(text_glove: None, tmp_path: Path) -> None:
    bends = tmp_path / "bends.txt"
    closure = np.linspace(FREE, FIST / np.pi * 2.0, 100)
    bends.write_text("\n".join(" ".join([f"{bend:.6f}"] * 5) for bend in [*closure, *[closure[-1]] * 200]))
    assert "text" in GLOVES
    limits = {"safety": SafetyLimits(watchdog=False), "output": OutputLimits(ramp=0.02)}
    setup = make_setup(device=configure("text", file=str(bends)), duration=0.25, **limits)
    memory, clock = SessionMemory.create(), FakeClock()
    glove: Any = open_device(setup.worn[0].device)
    glove.clock = clock.now
    glove.open()
    assert InStep(setup, memory, glove, clock).run() == "duration"
    ticks = memory.ticks.records[: memory.ticks.written]
    assert len(ticks) == 250
    np.testing.assert_allclose(ticks["haptic_flexion"][120], FIST, atol=1e-6)
    assert max(glove.stiffness) == pytest.approx(0.3)
    assert glove.stiffness[-1] == 0.0


def test_our_own_gloves_keep_their_names(installed: Callable[..., None]) -> None:
    installed("hhsim.gloves", "dexmo = their_glove:GLOVE", their_glove=TEXT_GLOVE)
    assert list(GLOVES).count("dexmo") == 1 and GLOVES["dexmo"].driver.startswith("hhsim.")


def test_a_glove_in_one_file_is_in_the_help_with_its_settings(
    text_glove: None, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = importlib.import_module("hhsim.cli.live.glove")
    try:
        importlib.reload(module)
        shown = " ".join(run("live", "glove", "--help").out.split())
        assert "text: bends from a file of text" in shown
        assert "--file FILE With --device text: file of bends." in shown
        assert "--fist DEG With --device text: angle of every joint of a fist [deg]. [default: 90.0;" in shown
        refused = run("live", "glove", "--device", "sim", "--fist", "80")
        assert refused.err.startswith("hhsim: error: --fist is for --device text, not sim")
        answer = run("live", "glove", "cube", "--device", "text", "--file", "gone", "--no-record", "--fist", "0")
        assert "0.0 is not in the range 1<=x<=120" in answer.err
    finally:
        monkeypatch.undo()
        importlib.reload(module)


def test_the_help_imports_no_driver_and_nothing_heavy() -> None:
    program = "import sys, hhsim.cli.live.glove; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert {"numpy", "numba", "h5py", "scipy", "trimesh"}.isdisjoint(loaded)
    assert not [name for name in loaded if name.startswith("hhsim.live.drivers")]


@pytest.mark.parametrize("driver", ["dexmo", "udp"])
def test_the_watchdog_is_small(driver: str) -> None:
    program = f"import sys, hhsim.live.session.watchdog, hhsim.live.drivers.{driver}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert len([name for name in loaded if name.split(".")[0] == "hhsim"]) <= 22
    assert {"numba", "trimesh", "h5py", "scipy"}.isdisjoint(loaded)

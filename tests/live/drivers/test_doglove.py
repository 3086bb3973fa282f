"""A DOGlove in another process that knows the published format alone: joints, silence, a torn line."""

import os
import pty
import socket
import subprocess
import sys
import threading
import tty
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest
from doglove_peer import datagram, published_angles, uart_frame
from live_peers import PATIENCE, Reader, free_ports, until_listened_to

from hhsim.errors import InputError
from hhsim.live.device import GLOVE_SAMPLE, Capability, DeviceError, FingerCommand, GloveDevice
from hhsim.live.devices.registry import configure, open_device
from hhsim.live.drivers import doglove
from hhsim.live.drivers.doglove import hand_angles, servo_zero

PEER = Path(__file__).parents[2] / "doglove_peer.py"
SERVO_ZERO = servo_zero("182.2,165.2,150.29,151.44,145.9")


@contextmanager
def peer(port: int, *line: int) -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, str(PEER), str(port), *map(str, line)], pass_fds=line) as process:
        try:
            yield process
        finally:
            process.kill()


def test_a_bent_hand_is_bent_in_every_joint_as_its_makers_model_says() -> None:
    for bend in (0.0, 35.0, 90.0):
        encoders, servos = published_angles(bend)
        flexion, abduction = hand_angles(np.array(encoders), np.array(servos) - SERVO_ZERO)
        np.testing.assert_allclose(flexion, bend, atol=1e-9)
        np.testing.assert_allclose(abduction, 0.0, atol=1e-9)


def test_each_channel_moves_the_joint_that_it_is_of() -> None:
    encoders, servos = map(np.array, published_angles(0.0))
    flat = hand_angles(encoders, servos - SERVO_ZERO)
    moved = {}
    for index in range(16):
        other = encoders.copy()
        other[index] += 10.0
        flexion, abduction = hand_angles(other, servos - SERVO_ZERO)
        changed = (
            np.argwhere(np.abs(flexion - flat[0]) > 1.0).tolist(),
            np.flatnonzero(np.abs(abduction) > 1.0).tolist(),
        )
        moved[doglove.CHANNELS[index]] = changed
    assert moved["thumb_rotate"] == ([], [])
    for finger, name in enumerate(("thumb", "index", "middle", "ring", "little")):
        assert moved[f"{name}_pip"] == ([[finger, 1]], [])
        assert moved[f"{name}_dip"] == ([[finger, 2]], [])
        assert moved[f"{name}_split"] == ([], [finger])


@pytest.fixture
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """A peer, or who reads it, may have to wait for a processor between two datagrams."""
    monkeypatch.setattr(doglove, "SERVO_STALE_NS", int(1e9 * PATIENCE))
    monkeypatch.setattr(doglove, "SILENCE_NS", int(1e9 * PATIENCE))


@pytest.mark.usefixtures("unhurried")
def test_the_glove_of_another_process_is_read_by_its_datagrams() -> None:
    port = free_ports(socket.SOCK_DGRAM)
    with peer(port), closing(open_device(configure("doglove", port=port))) as glove:
        glove.open(PATIENCE)
        assert glove.info.capabilities == Capability.JOINTS | Capability.SPLAY
        reader = Reader(glove)
        reader.until(lambda: reader.count() >= 40)
        samples = reader.samples
        assert samples["good"].all()
        assert (np.diff(samples["seq"]) == 1).all()
        # All joints of a finger move as one; the servos' datagram comes right before that of the encoders.
        spread = np.ptp(np.degrees(samples["flexion"]).reshape(-1, 15), axis=1)
        assert np.median(spread) < 1.0
        assert np.ptp(samples["flexion"]) > 0.1
        assert glove.counters.samples == glove.counters.frames == len(samples)
        assert glove.send(FingerCommand()) and glove.release()
        assert glove.counters.commands == 0, "nothing is sent, and nothing is counted"


@pytest.mark.usefixtures("unhurried")
def test_the_glove_of_another_process_is_read_by_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_ports(socket.SOCK_DGRAM)
    end, line = pty.openpty()
    tty.setraw(line)
    with (
        peer(port, end) as process,
        closing(open_device(configure("doglove", port=port, path=os.ttyname(line)))) as glove,
    ):
        glove.open(PATIENCE)
        assert glove.info.capabilities == Capability.JOINTS | Capability.SPLAY | Capability.STAMPS
        reader = Reader(glove)
        reader.until(lambda: reader.count() >= 40)
        samples = reader.samples
        assert samples["good"].all()
        # Every frame from the first on, by the board's own clock.
        assert set(np.diff(samples["device_time_ns"])) == {8_000_000}
        assert glove.counters.malformed == 0
        process.kill()
        monkeypatch.setattr(doglove, "SILENCE_NS", 500_000_000)
        assert "no reading of the encoders came for 0.5 s" in reader.until_lost()
        assert not glove.reconnect()
        os.write(end, b"torn" + uart_frame(3_300_000, [0] * 16, 5))
        reader.until(glove.reconnect)
        assert glove.counters.resyncs == 1, "what was torn was passed over, once"
    os.close(end)
    os.close(line)


@pytest.fixture
def opened() -> Iterator[tuple[GloveDevice, int, socket.socket]]:
    """A glove whose scripts are a socket of the test's."""
    port = free_ports(socket.SOCK_DGRAM)
    encoders, servos = published_angles(20.0)
    with (
        closing(open_device(configure("doglove", port=port))) as glove,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as scripts,
    ):

        def speak() -> None:
            until_listened_to(port, port + 1)
            scripts.sendto(datagram(servos), ("127.0.0.1", port + 1))
            scripts.sendto(datagram(encoders), ("127.0.0.1", port))

        helper = threading.Thread(target=speak)
        helper.start()
        glove.open(PATIENCE)
        helper.join()
        yield glove, port, scripts


def test_readings_of_no_hand_are_not_used_and_those_of_others_not_read(
    opened: tuple[GloveDevice, int, socket.socket],
) -> None:
    glove, port, scripts = opened
    reader = Reader(glove)
    reader.until(lambda: reader.count() >= 1)
    encoders = published_angles(20.0)[0]
    for other in (np.nan, 999.0):
        scripts.sendto(datagram([*encoders[:4], other, *encoders[5:]]), ("127.0.0.1", port))
        # Another program of this machine.
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            out.sendto(datagram(published_angles(60.0)[0]), ("127.0.0.1", port))
    scripts.sendto(b"three", ("127.0.0.1", port))
    reader.until(lambda: glove.counters.rejected >= 2 and glove.counters.malformed >= 1)
    assert glove.counters.frames == glove.counters.samples + glove.counters.rejected + glove.counters.malformed == 4


def test_old_angles_of_the_servos_make_no_good_sample(
    opened: tuple[GloveDevice, int, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    reader = Reader(opened[0])
    monkeypatch.setattr(doglove, "SERVO_STALE_NS", 0)
    reader.until(lambda: reader.count() >= 1)
    assert not reader.samples["good"].any()


def test_what_is_missing_is_told_in_one_line() -> None:
    port = free_ports(socket.SOCK_DGRAM)
    glove = open_device(configure("doglove", port=port))
    with pytest.raises(DeviceError, match=r"no reading of the encoders came within 0\.05 s: do its scripts run"):
        glove.open(0.05)
    with pytest.raises(DeviceError, match="not open"):
        glove.read(np.zeros(1, GLOVE_SAMPLE))


@pytest.mark.parametrize("text", ["", "1e300,0,0,0,0", "1,2,3,4", "1,2,3,4,five", "1,2,3,4,inf"])
def test_zeros_that_are_not_five_numbers_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="expected five numbers from -360 to 360 in degrees"):
        open_device(configure("doglove", servo_zero=text))

"""A MANUS glove: the powers of its motors, as FlatBuffers' own builder writes them and as any reader reads them."""

import math
import socket
from contextlib import closing

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_peers import PATIENCE
from openxr_peer import Haptic, read_haptic

from hhsim.errors import InputError
from hhsim.live.device import Capability, FingerCommand
from hhsim.live.devices.registry import configure, for_release, open_device, open_release
from hhsim.live.drivers.openxr import ManusGlove, encode_haptic_command

BUILT = {
    "left": "0c000000 08000c00 04000800 08000000 20000000 04000000 05000000 00000000 0000803e 0000003f 0000403f"
    " 0000803f 04000000 6c656674 00000000",
    "right": "0c000000 08000c00 04000800 08000000 20000000 04000000 05000000 00000000 0000803e 0000003f 0000403f"
    " 0000803f 05000000 72696768 74000000",
}
"""What flatbuffers 25.12.19 builds of the endpoint and of 0, 0.25, 0.5, 0.75, 1, its parts in the order of its C++."""
PAYLOAD = 256
"""Most bytes that Isaac Teleop's tracker pushes by default."""


@pytest.mark.parametrize("endpoint", ["left", "right"])
def test_the_bytes_are_those_of_flatbuffers_own_builder(endpoint: str) -> None:
    data = encode_haptic_command(endpoint, [0.0, 0.25, 0.5, 0.75, 1.0])
    assert data == bytes.fromhex(BUILT[endpoint])
    assert len(data) <= PAYLOAD


@given(st.sampled_from(["left", "right"]), st.lists(st.floats(0.0, 1.0, width=32), min_size=5, max_size=5))
def test_a_reader_of_the_format_reads_them(endpoint: str, powers: list[float]) -> None:
    assert read_haptic(encode_haptic_command(endpoint, powers)) == Haptic(endpoint, powers)


def test_a_finger_is_shaken_as_hard_as_it_is_pressed() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plugin:
        plugin.bind(("127.0.0.1", 0))
        plugin.settimeout(PATIENCE)
        config = configure("manus", hand="left", port=plugin.getsockname()[1] - 1, full_force=4.0)
        with closing(open_device(config)) as glove:
            assert isinstance(glove, ManusGlove)
            assert glove.TAKES is Capability.POWER
            glove.open_for_release()
            command = FingerCommand()
            # Two phalanges of the thumb that are pressed together; a middle finger beyond the full force.
            command.force[0, 1:] = (0.0, 0.0, 1.0), (0.0, 0.0, 2.0)
            command.force[2, 0] = 3.0, 4.0, 0.0
            assert glove.send(command)
            assert read_haptic(plugin.recv(512)) == Haptic("left", [0.75, 0.0, 1.0, 0.0, 0.0])
            command.force[4, 0, 0] = math.nan
            assert glove.send(command)
            assert read_haptic(plugin.recv(512)) == Haptic("left", [0.0] * 5)
            assert glove.counters.commands == 2
        with closing(open_release(for_release(config))) as watchdog:
            watchdog.open_for_release()
            assert watchdog.release(), "a motor that nobody stops goes on"
            assert read_haptic(plugin.recv(512)) == Haptic("left", [0.0] * 5)


@pytest.mark.parametrize("force", [0.0, -1.0, math.nan, math.inf])
def test_a_full_force_that_is_none_is_refused(force: float) -> None:
    with pytest.raises(InputError, match="expected more than 0"):
        open_device(configure("manus", full_force=force))


def test_its_hand_is_that_of_openxr() -> None:
    glove = open_device(configure("manus"))
    assert glove.palm is not None
    assert np.isnan(glove.palm.position).sum() == 0

"""The open packet: its bytes, what is lost and late, a fake glove and the example bridge in other processes."""

import re
import signal
import socket
import struct
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from live_peers import PATIENCE, Bridge, Reader, example, free_ports, until

from hhsim.live.device import FORCES, LIMITS, DeviceError, FingerCommand
from hhsim.live.drivers.poses import make_pose_source
from hhsim.live.drivers.udp import UdpGlove
from hhsim.live.gloves import GloveConfig, PoseConfig, configure, open_device
from hhsim.live.open_packet import COUNT, HEADER, Kind, PacketError, PacketOrder, UdpPort, decode_packet, encode_packet
from hhsim.recordings.dexmo_regression import BEND, DexmoRegression

BRIDGE = Path(__file__).resolve().parents[3] / "examples" / "udp_bridge.py"
KINDS = st.sampled_from(list(Kind))


def test_the_bytes_are_those_of_the_table() -> None:
    data = encode_packet(Kind.BENDS, [0, 0.25, 0.5, 0.75, 1], session=7, seq=9, t_ns=11, answers=13, battery=15)
    assert data[0:4] == b"HHGL"
    assert list(data[4:6]) == [1, 1]
    assert [int.from_bytes(data[a:b], "little") for a, b in ((6, 8), (8, 12), (12, 16))] == [5, 7, 9]
    assert [int.from_bytes(data[a:b], "little") for a, b in ((16, 24), (24, 28), (28, 32))] == [11, 13, 15]
    assert struct.unpack("<5f", data[32:]) == (0.0, 0.25, 0.5, 0.75, 1.0)


@settings(max_examples=300)
@given(st.binary(max_size=140), KINDS, st.integers(0, 200), st.integers(0, 10))
def test_other_bytes_are_a_packet_error_or_a_packet(junk: bytes, kind: Kind, cut: int, place: int) -> None:
    whole = encode_packet(kind, np.zeros(COUNT[kind]), session=1, seq=2, t_ns=3)
    long = HEADER.pack(b"HHGL", 1, kind, 65535, 0, 0, 0, 0, 0) + junk
    for data in (junk, whole[:cut], whole + junk, whole[:place] + junk[:1] + whole[place + 1 :], long):
        with suppress(PacketError):
            assert len(data) == 32 + 4 * COUNT[decode_packet(data).kind]


@settings(max_examples=200)
@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.integers(1, 80))
def test_what_is_new_is_newer_than_all_before_and_the_rest_is_late_or_lost(seed: int, begin: int, count: int) -> None:
    random = np.random.default_rng(seed)
    sent = np.arange(count)[random.random(count) > 0.2]
    arrived = sent[np.argsort(sent + random.uniform(0.0, 6.0, len(sent)))]
    order, newest, taken = PacketOrder(), -1, 0
    for number in map(int, arrived):
        taken += number > newest
        assert order.take(5, (begin + number) % 2**32, 0) == (number > newest)
        newest = max(newest, number)
    assert not taken or order.lost == newest + 1 - arrived[0] - taken


def test_another_session_is_taken_only_when_the_one_before_is_silent() -> None:
    order = PacketOrder()
    assert order.take(1, 10, 0)
    assert not order.take(2, 0, 50_000_000)
    assert order.take(1, 11, 60_000_000)
    assert not order.take(2, 1, 150_000_000)
    assert order.take(2, 2, 170_000_000)
    assert (order.sessions, order.lost) == (2, 0)


def test_a_flood_does_not_keep_the_reader() -> None:
    number = free_ports(socket.SOCK_DGRAM)
    with closing(UdpPort("127.0.0.1", number)) as port, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for seq in range(100):
            data = encode_packet(Kind.BENDS, np.zeros(5), session=1, seq=seq, t_ns=0)
            sender.sendto(data, ("127.0.0.1", number))
        assert [len(port.read(1000, [Kind.BENDS])) for _ in range(3)] == [64, 36, 0]


@pytest.fixture
def bridge() -> Iterator[Bridge]:
    made = Bridge()
    yield made
    made.socket.close()


@contextmanager
def opened(bridge: Bridge, kind: Kind, values: object, config: GloveConfig | None = None) -> Iterator[UdpGlove]:
    """A device to which a bridge sends its packet 0 until it hears it; nothing is read yet."""
    with bridge.opened(UdpGlove(config or bridge.config()), bridge.packet(kind, values, 0)) as device:
        yield device


def test_samples_come_in_order_and_every_frame_is_counted(bridge: Bridge, monkeypatch: pytest.MonkeyPatch) -> None:
    # Who reads may have to wait for a processor meanwhile; a bridge that is silent has tests of its own.
    monkeypatch.setattr("hhsim.live.open_packet.SESSION_SILENCE_NS", int(1e9 * PATIENCE))
    monkeypatch.setattr("hhsim.live.drivers.udp.SILENCE_NS", int(1e9 * PATIENCE))
    bends = np.full(5, 0.4)
    with opened(bridge, Kind.BENDS, bends) as device:
        reader = Reader(device)
        reader.read()
        # What else was sent until it was heard.
        while (seen := device.counters.frames) < (reader.read(), device.counters.frames)[1]:
            assert seen > 0
        before = replace(device.counters)
        assert device.info.channels[0] == "thumb_bend"
        bad, far = bends.copy(), bends.copy()
        bad[4], far[1] = np.nan, 2000.0
        for seq in (1, 2, 4, 3, 3, 9):
            bridge.send(Kind.BENDS, bends + 0.01 * seq, seq, battery=77)
        bridge.send(Kind.BENDS, bad, 10)
        bridge.send(Kind.BENDS, far, 11)
        bridge.send(Kind.JOINTS, np.zeros(20), 12)
        bridge.send(Kind.POSE, np.zeros(7), 13)
        bridge.send(Kind.BENDS, bends, 1, session=99)
        bridge.socket.sendto(b"HHGL and so on", ("127.0.0.1", bridge.port))
        reader.until(lambda: device.counters.malformed > before.malformed)
        samples = reader.samples[1:]
        assert samples["device_seq"].tolist() == [1, 2, 4, 9, 10, 11]
        assert samples["seq"].tolist() == [1, 2, 3, 4, 5, 6]
        assert samples["good"].tolist() == [True] * 4 + [False] * 2
        assert samples["battery"].tolist() == [77] * 4 + [-1] * 2
        assert samples["device_time_ns"].tolist() == [1000 * seq for seq in (1, 2, 4, 9, 10, 11)]
        assert np.isfinite(samples["flexion"]).all(), "not even a sample that is not to be used holds a NaN"
        slope, offset = DexmoRegression.default().bend_lines()
        expected = [offset + (bends + 0.01 * seq).astype(np.float32)[:, None] * slope for seq in (1, 2, 4, 9)]
        np.testing.assert_allclose(samples["flexion"][:4], expected, atol=1e-15)
        now = device.counters
        more = [getattr(now, key) - getattr(before, key) for key in ("samples", "rejected", "other", "malformed")]
        assert (more, now.dropped) == ([4, 2, 5, 1], 5)
        assert now.frames == now.samples + now.rejected + now.other + now.malformed


@pytest.mark.parametrize("kind", [Kind.BENDS, Kind.JOINTS])
def test_bends_and_joints_are_the_same_hand(bridge: Bridge, kind: Kind) -> None:
    regression = DexmoRegression.default()
    channels = np.zeros(11)
    channels[list(BEND)] = (0.1, 0.2, 0.3, 0.4, 0.5)
    flexion, abduction = regression.angles(channels)
    values = channels[list(BEND)] if kind is Kind.BENDS else np.concatenate([flexion.ravel(), abduction])
    with opened(bridge, kind, values) as device:
        sample = Reader(device).read()[0]
        assert np.allclose(sample["flexion"], flexion, atol=1e-6)
        assert np.allclose(sample["abduction"], abduction, atol=1e-6)


@pytest.mark.parametrize(
    ("takes", "kind", "told"),
    [
        ("limits", 16, (0.1, 0.2, 0.3, 0.4, 0.5, 0.2, 0.5, 0.8, 1.0, 1.0)),
        # As the palm feels it; one that is too long is shortened; what only a phalanx before the tip feels is not told.
        ("forces", 17, (0.5, -0.25, 1.0, 0.0, 1.2, -1.6, *[0.0] * 9)),
    ],
)
def test_commands_and_releases_go_to_the_next_port_byte_by_byte(
    bridge: Bridge, takes: str, kind: int, told: tuple[float, ...]
) -> None:
    config = configure("udp", port=bridge.port, takes=takes, most_force=2.0)

    def heard() -> tuple[bytes, tuple[float, ...]]:
        data = bridge.socket.recv(512)
        assert (data[:4], list(data[4:8])) == (b"HHGL", [1, kind, len(told), 0])
        return data, struct.unpack(f"<{len(told)}f", data[32:])

    with opened(bridge, Kind.BENDS, np.full(5, 0.2), config) as device:
        assert device.info.capabilities == (FORCES if takes == "forces" else LIMITS)
        Reader(device).read()
        command = FingerCommand(np.linspace(0.1, 0.5, 5), np.linspace(0.2, 1.4, 5))
        command.force[0, 2], command.force[1, 2], command.force[2, 0] = (0.5, -0.25, 1.0), (0.0, 6.0, -8.0), 9.0
        assert device.send(command)
        first, numbers = heard()
        assert numbers == pytest.approx(told)
        assert decode_packet(first)[2:5:2] == (0, 0), "its number, and that of the sample that it answers"
        command.stiffness[2] = command.force[4, 2, 1] = np.nan
        assert device.send(command)
        assert not any(heard()[1]), "a command that is not finite frees the fingers"
        watchdog = UdpGlove(config)
        assert not watchdog.release()
        watchdog.open_for_release()
        assert watchdog.release()
        freed, numbers = heard()
        assert freed[8:12] != first[8:12] and not any(numbers), "in a session of its own"
        watchdog.close()
        bridge.send(Kind.BENDS, np.full(5, 0.3), 1)
        Reader(device).until(lambda: device.counters.samples > 1)


def test_a_bridge_that_is_not_there_is_said_so(bridge: Bridge) -> None:
    device = UdpGlove(bridge.config())
    with pytest.raises(DeviceError, match="is the bridge running"):
        device.open(0.05)
    with closing(UdpPort("127.0.0.1", bridge.port)) as port:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.bind(("127.0.0.3", 0))
            stranger.sendto(b"", ("127.0.0.1", bridge.port))
        bridge.socket.sendto(b"HH", ("127.0.0.1", bridge.port))
        assert port.wait(PATIENCE)
        assert port.read(1, Kind) == []
        while port.counters.malformed == 0:
            assert port.hint == "packets come from 127.0.0.3 instead" and port.read(1, Kind) == []
        assert "no open packet: 2 bytes" in port.hint
    with pytest.raises(DeviceError, match="no host"):
        UdpGlove(configure("udp", port=bridge.port, host="no.such.host.invalid")).open(0.05)
    with (
        opened(bridge, Kind.BENDS, np.zeros(5)),
        pytest.raises(DeviceError, match="cannot listen: Address already in use"),
    ):
        UdpGlove(bridge.config()).open(0.05)


def test_a_bridge_is_back_with_a_sample_and_not_with_what_is_none(bridge: Bridge) -> None:
    with opened(bridge, Kind.BENDS, np.zeros(5)) as device:
        reader = Reader(device)
        reader.read()
        assert reader.until_lost().endswith("nothing came for 0.5 s")
        assert not device.reconnect()
        for junk in (b"XXXX" + bytes(48), encode_packet(Kind.POSE, np.zeros(7), session=1, seq=1, t_ns=0)):
            bridge.socket.sendto(junk, ("127.0.0.1", bridge.port))
            assert not device.reconnect()
        assert "no sample came for 0.5 s: packets of kind 4 come; expected kind 1" in reader.until_lost()
        bridge.send(Kind.BENDS, np.zeros(5), 1)
        assert device.reconnect()
        assert len(reader.read()) == 1


@pytest.mark.parametrize("stop", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.soak)])
def test_the_example_bridge_speaks_the_packet(stop: signal.Signals) -> None:
    port = free_ports(socket.SOCK_DGRAM)
    with example(BRIDGE, port) as bridge:
        device = open_device(configure("udp", port=port))
        device.open(PATIENCE)
        reader = Reader(device)
        reader.until(lambda: reader.count() >= 20)
        assert reader.samples["good"].all()
        assert device.counters.dropped == 0
        assert device.send(FingerCommand(np.full(5, 0.25), np.full(5, 0.5)))
        at_first = reader.samples["flexion"]
        assert np.ptp(at_first, axis=0).max() == 0.0 and abs(at_first).max() < 0.1, "flat until the first command"
        assert bridge.stdout.readline().split() == ["0.25/0.50"] * 5
        assert bridge.stdout.readline().split() == ["0.00/0.00"] * 5, "nobody told it more for 100 ms"
        for _ in range(3):
            assert device.send(FingerCommand(np.full(5, 0.25), np.full(5, 0.5)))
        assert bridge.stdout.readline().split() == ["0.25/0.50"] * 5, "once, however often it is told"
        bridge.send_signal(stop)
        assert bridge.wait(PATIENCE) == 0
        assert bridge.stdout.readline().split() == ["0.00/0.00"] * 5, "it lets go when it is stopped"
        device.close()


def test_the_pose_of_a_tracker_is_the_newest_and_grows_old(bridge: Bridge) -> None:
    source = make_pose_source(PoseConfig(kind="udp", port=bridge.port))
    source.open()
    assert source.read(0)[0] == -1
    good = [0.1, 0.2, 0.3, 0.0, 1.01, 0.0, 0.0]
    bridge.send(Kind.POSE, good, 5)
    for seq, values in (
        (6, [np.nan, *good[1:]]),
        (7, [0.1, 0.2, 400.0, 1.0, 0.0, 0.0, 0.0]),
        (8, [0.0] * 7),
        (9, [0.0, 0.0, 0.0, 0.0, np.inf, 0.0, 0.0]),
        (4, [0.5] * 3 + [1.0, 0.0, 0.0, 0.0]),
    ):
        bridge.send(Kind.POSE, values, seq)
    bridge.send(Kind.BENDS, np.zeros(5), 3)
    until(lambda: source.read(0)[0] >= 0)
    came, position, orientation = source.read(0)
    assert np.allclose(position, good[:3])
    assert orientation.tolist() == [0.0, 1.0, 0.0, 0.0]
    assert source.read(0)[0] == came, "no other pose was taken"
    source.close()


def test_the_page_and_the_example_say_what_the_packet_is() -> None:
    page = (BRIDGE.parent.parent / "docs" / "live-protocols.md").read_text(encoding="utf-8").replace("`HHGL`", '"HHGL"')
    assert [kind for kind in Kind if f"| {kind} {kind.name.lower()} | {COUNT[kind]} |" not in page] == []
    sizes = {"char[4]": 4, "u8": 1, "u16": 2, "u32": 4, "u64": 8, "i32": 4}
    rows = re.findall(r"^\| (\d+) \| ([a-z0-9\[\]]+) \| \w+ \|", page, re.MULTILINE)
    ends = [int(offset) + sizes[kind] for offset, kind in rows]
    assert [int(offset) for offset, _ in rows] == [0, *ends[:-1]] and ends[-1] == HEADER.size
    assert f'"{HEADER.format}"' in BRIDGE.read_text(encoding="utf-8")

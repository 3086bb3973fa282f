"""Gloves of the letter format: the lines, the driver, and a fake glove on a pseudo-terminal and over TCP."""

import math
import os
import pty
import tty
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_gloves import FakeGlove
from hypothesis import given, settings
from hypothesis import strategies as st
from live_peers import PATIENCE, Reader

from hhsim.errors import InputError
from hhsim.live.device import Capability, DeviceError, FingerCommand
from hhsim.live.devices.registry import GloveConfig, configure, open_device
from hhsim.live.drivers.opengloves import OpenGlovesGlove, limits
from hhsim.live.link.opengloves_codec import LONGEST_LINE, GloveLine, LineError, LineStream, format_limits, parse_line
from hhsim.recordings.dexmo_regression import CHANNELS, DexmoRegression
from tools.opengloves_board import format_line, parse_limits

COUNT = st.integers(0, 4095).map(float)
CURLS = st.tuples(*[COUNT] * 5)
MAYBE = st.one_of(COUNT, st.just(math.nan))


@given(CURLS, st.tuples(*[MAYBE] * 5), st.tuples(*[st.tuples(*[MAYBE] * 4)] * 5), st.randoms())
def test_a_line_is_read_as_it_was_written_in_any_order(curl, splay, joints, random) -> None:  # type: ignore[no-untyped-def]
    line = format_line(GloveLine(curl, splay, joints)).strip()
    read = parse_line(line)
    assert read is not None
    assert np.array_equal(read.curl, curl)
    assert np.array_equal(read.splay, splay, equal_nan=True)
    assert np.array_equal(read.joints, joints, equal_nan=True)


@pytest.mark.parametrize(
    "line",
    [
        b"A1023B2047C0D0E4095F2047G2047P0",
        b"A1023B2047C0D0E4095F2047G2047P0HIJKLMNO",
        b"E4095D0C0B2047A1023JK(AB)2047",
        b"A1023(AAB)1(AAC)2B2047C0D0E4095(ZZ)3",
        b"A1023.0B2047C0D0E4095",
    ],
)
def test_lines_of_several_firmwares_give_the_same_curls(line: bytes) -> None:
    read = parse_line(line)
    assert read is not None
    assert read.curl == (1023.0, 2047.0, 0.0, 0.0, 4095.0)


def test_a_line_without_fingers_is_something_else_and_a_part_of_one_an_error() -> None:
    assert parse_line(b"(ZV)3(ZG)0(ZH)1") is None
    for line in (b"A1B2C3D4", b"A1B2C3D4E5A6B7C8D9E1", b"A1B2C3D4E", b"a1", b"A1 B2", b"(A)1", b"1234", b"\xff"):
        with pytest.raises(LineError):
            parse_line(line)


@settings(max_examples=400)
@given(st.binary(max_size=80), st.integers(0, 70))
def test_other_bytes_are_an_error_or_finite_fingers(junk: bytes, cut: int) -> None:
    whole = b"A1023B2047C0D0E4095F2047G2047P0JK(AB)2047(BB)2047(CB)2047"
    for line in (junk, whole[:cut] + junk, whole[:cut] + whole[cut + 1 :], junk + whole[cut:]):
        try:
            read = parse_line(line)
        except LineError:
            continue
        assert read is None or all(map(math.isfinite, read.curl))


@given(st.lists(st.integers(0, 1000), min_size=5, max_size=5))
def test_a_command_is_read_as_it_was_written(values: list[int]) -> None:
    assert parse_limits(format_limits(values).strip()) == tuple(values)


@given(st.lists(st.binary(max_size=12), max_size=30), st.booleans())
def test_lines_are_cut_alike_however_the_bytes_arrive(parts: list[bytes], whole: bool) -> None:
    data = b"\n".join(parts) + b"\n"
    pieces = LineStream(whole=whole)
    found = [line for k in range(len(data)) for line in pieces.feed(data[k : k + 1])]
    assert found == LineStream(whole=whole).feed(data)
    expected = [line.strip(b"\r \t\0") for line in data.split(b"\n")[0 if whole else 1 :]]
    assert found == [line for line in expected if line]


def test_a_line_without_end_is_left_out_and_the_next_one_read() -> None:
    stream = LineStream(whole=True)
    for _ in range(100):
        assert stream.feed(b"x" * LONGEST_LINE) == []
    assert stream.overlong == 1
    assert stream.feed(b"x\nA1\n") == [b"A1"]
    assert stream.feed(b"y" * (LONGEST_LINE + 1) + b"\nB2\n") == [b"B2"]
    assert stream.overlong == 2


def test_what_the_glove_is_told() -> None:
    command = FingerCommand(np.array([0.0, 0.3, 1.0, 0.3, 0.3]), np.array([1.0, 0.3, 1.0, 0.125, 0.0]))
    assert limits(command) == [1000, 700, 0, 350, 0]
    command.bend[3] = np.nan
    assert limits(command) == [0] * 5


class Line:
    """The glove's end of a pseudo-terminal in the same process."""

    def __init__(self) -> None:
        self.main, self.other = pty.openpty()
        tty.setraw(self.other)

    def close(self) -> None:
        os.close(self.main)
        os.close(self.other)

    def config(self, **settings: Any) -> GloveConfig:
        return configure("opengloves", path=os.ttyname(self.other), **settings)

    def opened(self, first: bytes = b"\nA0B0C0D0E0\n", **settings: Any) -> OpenGlovesGlove:
        device = OpenGlovesGlove(self.config(**settings))
        os.write(self.main, first)
        device.open(PATIENCE)
        return device


def test_every_line_is_counted_and_the_numbers_become_angles() -> None:
    regression = DexmoRegression.default()
    with closing(Line()) as line, closing(line.opened(b"half of one\nA0B0C0D0E0(BB)4095\n")) as device:
        assert device.info.capabilities == Capability.POSITION_LIMIT | Capability.SPLAY
        reader = Reader(device)
        reader.until(lambda: reader.count() == 1)
        os.write(line.main, b"A4095B2048C1024D512E0F1G2P3JK\r\n\r\n?\n(ZV)1\nA99999B0C0D0E0\nA1B2\nA1B1C1D1E1\n")
        reader.until(lambda: reader.count() == 4)
        samples, counters = reader.samples, device.counters
        assert samples["good"].tolist() == [True, True, False, True]
        assert (counters.samples, counters.rejected, counters.other, counters.malformed) == (3, 1, 1, 2)
        assert counters.frames == 7
        channels = np.zeros(11)
        channels[2::2] = np.array([4095, 2048, 1024, 512, 0]) / 4095
        assert np.allclose(samples["flexion"][1], regression.angles(channels)[0], atol=1e-12)
        assert samples["channels"][1, :5].tolist() == [4095.0, 2048.0, 1024.0, 512.0, 0.0]
        assert np.isnan(samples["channels"][1, 5:]).all()
        spread = np.zeros(11)
        spread[CHANNELS.index("index_split")] = 1.0
        assert np.allclose(samples["abduction"][0], regression.angles(spread)[1])


def test_each_joint_goes_its_own_way_where_the_glove_sends_it() -> None:
    regression = DexmoRegression.default()
    four = b"".join(b"(%cAA)0(%cAB)4095(%cAC)0(%cAD)2048" % (key, key, key, key) for key in b"BCDE")
    with (
        closing(Line()) as line,
        closing(line.opened(b"\nA0B2048C2048D2048E2048" + four + b"(AAA)4095(AAB)0(AAC)0\n")) as device,
    ):
        assert Capability.JOINTS in device.info.capabilities
        sample = Reader(device).read()[0]
        full = regression.angles(np.ones(11) * (np.arange(11) % 2 == 0) * (np.arange(11) > 0))[0]
        assert np.allclose(sample["flexion"][1:], full[1:] * [1.0, 0.0, 2048 / 4095])
        assert np.allclose(sample["flexion"][0], full[0] * [1.0, 0.0, 0.0])


def test_a_board_with_10_bits_and_a_calibration(tmp_path: Path) -> None:
    ends = "\n".join(
        f"{name} = {{ open = 100.0, closed = {900.0 if name != 'little_bend' else 137.0} }}" for name in CHANNELS
    )
    file = tmp_path / "me.toml"
    file.write_text(f"[channel]\n{ends}\n")
    half = DexmoRegression.default().angles(np.full(11, 0.5) * (np.arange(11) % 2 == 0) * (np.arange(11) > 0))[0]
    with closing(Line()) as line, closing(line.opened(full_scale=1023.0)) as device:
        reader = Reader(device)
        os.write(line.main, b"A511.5B511.5C511.5D511.5E511.5\n")
        reader.until(lambda: reader.count() == 2)
        assert np.allclose(reader.samples["flexion"][1], half)
    with closing(Line()) as line, closing(line.opened(b"\nA500B500C500D500E118.5\n", calibration=str(file))) as device:
        assert np.allclose(Reader(device).read()["flexion"], half)
        assert device.info.kept_free == (4,), "37 counts are no bend"
        assert "_bend spans 37 counts" in device.info.doubtful[0]


def test_what_is_no_glove_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match="is the glove plugged in"):
        OpenGlovesGlove(configure("opengloves", path=str(tmp_path / "ttyUSB7"))).open(0.1)
    (tmp_path / "file").write_text("")
    with pytest.raises(DeviceError, match="not a serial line"):
        OpenGlovesGlove(configure("opengloves", path=str(tmp_path / "file"))).open(0.1)
    with pytest.raises(InputError, match="12345 baud; expected one of"):
        OpenGlovesGlove(configure("opengloves", path="/dev/null", baud=12345))
    with pytest.raises(DeviceError, match="cannot connect"):
        OpenGlovesGlove(configure("opengloves", port=1)).open(0.1)
    with closing(Line()) as line:
        with pytest.raises(DeviceError, match="sent nothing within"):
            OpenGlovesGlove(line.config()).open(0.05)
        os.write(line.main, b"\x80\x91\n\x92\n")
        with pytest.raises(DeviceError, match="is the baud rate right"):
            OpenGlovesGlove(line.config()).open(1.0)


@pytest.mark.parametrize("tcp", [False, True], ids=["pty", "tcp"])
def test_a_fake_glove_in_another_process_every_line_accounted_for(tmp_path: Path, tcp: bool) -> None:
    link = tmp_path / "glove"
    arguments = () if tcp else ("--link", link)
    with FakeGlove("tools.opengloves_board", tmp_path / "peer.log", "--format", "splay", *arguments) as peer:
        where = configure("opengloves", port=int(peer.where)) if tcp else configure("opengloves", path=peer.where)
        with closing(open_device(where)) as device, closing(open_device(where)) as watchdog:
            device.open(PATIENCE)
            watchdog.open_for_release(PATIENCE)
            reader, command = Reader(device), FingerCommand(np.full(5, 0.4), np.ones(5))

            def answer() -> None:
                device.send(command)
                watchdog.drain()

            reader.until(lambda: reader.count() >= 100, answer)
            peer.order("garbage")
            peer.order("nan")
            reader.until(lambda: device.counters.rejected == 1 and device.counters.malformed == 1)

            def heard() -> bool:
                return len(peer.record().command) == device.counters.commands + watchdog.counters.commands

            # A release takes back what the glove was not yet told; here nothing is to be missing.
            reader.until(heard)
            # The loop is gone: the watchdog frees the fingers on its own connection.
            assert watchdog.release()
            reader.until(heard)
            assert not peer.record().command[-1].any()
            # Unplugged and back.
            peer.order("leave")
            assert "gone" in reader.until_lost()
            assert not device.reconnect()
            with pytest.raises(DeviceError, match="gone"):
                watchdog.drain()
            assert not watchdog.release(), "nobody is there"
            before = reader.count()
            peer.order("back")
            reader.until_back()
            assert watchdog.release(), "on a connection of its own, made anew"
            reader.until(lambda: reader.count() > before + 20)
            assert device.send(command)
            reader.until(heard)
            assert device.release()
            reader.until(heard)
            peer.end()
            reader.until_lost()
    record, counters, samples = peer.record(), device.counters, reader.samples
    assert counters.frames == counters.samples + counters.rejected + counters.other + counters.malformed
    assert (counters.malformed, counters.rejected, counters.resyncs) == (1, 1, 1)
    assert len(samples) == counters.samples + counters.rejected
    # Each sample is one that was sent, in order; none is missing but those on their way at the cut.
    sent = np.round(4095 * record.sent[:, :5]).tolist()
    found = [sent.index(row) for row in samples["channels"][:, :5].tolist()]
    assert (np.diff(found) > 0).all() and np.count_nonzero(np.diff(found) > 1) <= 1
    commands = [tuple(row) for row in np.round(1000 * record.command).astype(int).tolist()]
    assert set(commands) == {(600,) * 5, (0,) * 5}
    assert commands[-1] == (0,) * 5
    assert len(commands) == counters.commands + watchdog.counters.commands

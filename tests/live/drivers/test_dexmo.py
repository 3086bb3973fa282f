"""The Dexmo driver: the bytes of its messages, a server in another process that misbehaves, and its calibration."""

import math
import random
import socket
import struct
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import chain, product, repeat
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import live_peers
import numpy as np
import pytest
from fake_gloves import FakeDexmo
from live_peers import PATIENCE, until
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.live.device import GLOVE_SAMPLE, DeviceError, FingerCommand
from hhsim.live.drivers.dexmo import (
    CHANNELS,
    MOST_MALFORMED,
    DexmoGlove,
    GloveMessage,
    decode_frame,
    encode_impedance,
    framed,
    glove_calibration,
)
from hhsim.live.gloves import DexmoOptions, configure, open_device
from hhsim.recordings.dexmo_regression import BEND, DexmoRegression
from hhsim.recordings.dexmo_regression import CHANNELS as OURS
from tools.dexmo_server import encode_frame, fake_channels

RIGHT = 337785601
DEFAULT = DexmoRegression.default()
HALF = (0.5,) * 11
MADE: list[DexmoGlove] = []


def floats(first: int, *values: float) -> bytes:
    """Fields of floats by ascending number, as proto3 writes them."""
    return b"".join(bytes([first + k << 3 | 5]) + struct.pack("<f", value) for k, value in enumerate(values))


def within(tag: int, body: bytes) -> bytes:
    return bytes([tag, len(body)]) + body


def test_the_bytes_are_those_of_the_published_format() -> None:
    channels = tuple((k + 1) / 16 for k in range(len(CHANNELS)))
    glove = b"\x08\x05" + within(0x12, floats(3, *channels)) + within(0x1A, b"\x10\x01\x18\x57")
    whole = GloveMessage(5, channels, True, 87)
    assert encode_frame([whole]) == within(0x12, glove)
    five = [0.5, 0.25, 0.75, 1.0, 0.125]
    fingers = b"".join(within(k + 1 << 3 | 2, floats(1, hard, -hard)) for k, hard in enumerate(five))
    command = b"\x08\x07" + within(0x12, fingers + b"\x30\x01")
    assert encode_impedance(7, five, [-hard for hard in five], kept=True) == framed(command)
    # A finger at zero is named all the same.
    free = b"\x08\x07" + within(0x12, b"".join(bytes([k + 1 << 3 | 2, 0]) for k in range(5)))
    assert encode_impedance(7, [0.0] * 5, [0.0] * 5, kept=False) == framed(free)
    gloves = [whole, GloveMessage(5, channels[::-1], False, 0), GloveMessage(-7), GloveMessage(6, None, True, 3)]
    assert decode_frame(encode_frame(gloves)) == gloves


@pytest.fixture
def server(tmp_path: Path) -> Iterator[FakeDexmo]:
    with FakeDexmo(tmp_path / "log", "--seed", "4") as fake:
        yield fake


@pytest.fixture(autouse=True)
def no_glove_stays_open() -> Iterator[None]:
    yield
    while MADE:
        MADE.pop().close()


def glove_at(port: int, **settings: Any) -> DexmoGlove:
    glove = open_device(configure("dexmo", port=port, **settings))
    MADE.append(glove)
    return glove


class Reader(live_peers.Reader):
    """A glove that is open, and all samples that it gives."""

    def __init__(self, server: FakeDexmo, room: int = 64, **settings: Any) -> None:
        self.glove = glove_at(server.port, **settings)
        self.glove.open(PATIENCE)
        super().__init__(self.glove)
        self._buffer = self._buffer[:room]

    def more(self, count: int) -> None:
        wanted = self.count() + count
        self.until(lambda: self.count() >= wanted)


def heard(server: FakeDexmo, count: int) -> NDArray[Any]:
    """What the server was told, once it is so many commands."""
    until(lambda: len(server.commands) >= count)
    commands = server.commands
    assert len(commands) == count
    return commands


def assert_freed(command: Any) -> None:
    """A command that the server may not drop frees all fingers."""
    assert not command["stiffness"].any() and not command["set_point"].any() and command["kept"]


def command(stiffness: float | list[float], bend: float | list[float] = 0.5) -> FingerCommand:
    made = FingerCommand()
    made.stiffness[:], made.bend[:] = stiffness, bend
    return made


@pytest.mark.parametrize("way", ["frames", "bytes"])
def test_every_frame_arrives_once_and_as_it_was_sent(server: FakeDexmo, way: str) -> None:
    server.order(way)
    reader = Reader(server)
    assert (reader.glove.info.channels, reader.glove.info.hand, reader.glove.info.unit) == (CHANNELS, "right", "")
    reader.more(60)
    server.order("stall")
    sent, counters = server.frames, reader.glove.counters
    reader.until(lambda: counters.frames >= len(sent))
    # What came before the glove was found is counted, and not handed on.
    before = counters.other
    assert counters.values() == [len(sent), len(sent) - before, 0, before, 0, 0, 0, 0, 0]
    sent = sent[before:]
    assert reader.count() == len(sent)
    wanted = np.array([fake_channels(4, int(k) / 200.0) for k in sent["number"]]).astype(np.float32).astype(float)
    samples = reader.samples
    assert np.array_equal(samples["channels"][:, :11], wanted) and np.isnan(samples["channels"][:, 11:]).all()
    flexion, abduction = DEFAULT.angles(wanted)
    assert np.allclose(samples["flexion"], flexion) and np.allclose(samples["abduction"], abduction)
    assert np.array_equal(samples["seq"], np.arange(len(sent)))
    assert samples["good"].all() and (samples["battery"] == 87).all()
    assert (samples["device_seq"] == -1).all() and (samples["device_time_ns"] == -1).all()
    assert (samples["time_ns"] >= sent["time_ns"]).all(), "nothing is read before it was sent"


def test_commands_arrive_as_they_were_given(server: FakeDexmo) -> None:
    glove = Reader(server).glove
    stiffness, bend = [0.0, 0.25, 0.5, 0.75, 1.0], [1.0, 0.0, 0.125, 0.5, 0.25]
    assert glove.send(command(stiffness, bend))
    assert glove.send(command([0.0, 0.25, 0.5, 0.75, 0.5], bend))
    assert glove.send(command(stiffness, bend))
    assert glove.send(command([2.0] * 5, [-1.0, 2.0, 0.5, 0.5, 0.5]))
    assert glove.release()
    received = heard(server, 5)
    assert (received["number"] == RIGHT).all() and glove.counters.commands == 5
    assert np.array_equal(received["stiffness"][0], np.array(stiffness, np.float32))
    # A direction has a sign.
    assert np.array_equal(received["set_point"][0], np.array([1.0, 1e-3, 0.125, 0.5, 0.25], np.float32))
    assert np.array_equal(received["stiffness"][3], np.ones(5))
    assert np.array_equal(received["set_point"][3], np.array([1e-3, 1.0, 0.5, 0.5, 0.5], np.float32))
    assert_freed(received[4])
    # The server must keep the first one, and what lets go of a finger.
    assert received["kept"].tolist() == [1, 1, 0, 0, 1]
    for bad, which in product((math.nan, math.inf, -math.inf), ("stiffness", "bend")):
        broken = command(0.5)
        getattr(broken, which)[2] = bad
        assert glove.send(command(0.5)) and glove.send(broken)
    for freed in heard(server, 17)[6::2]:
        assert_freed(freed)


@pytest.mark.parametrize("counts", [False, True])
def test_readings_and_set_points_go_by_the_calibration(tmp_path: Path, counts: bool) -> None:
    low, high = (700.0, 3100.0) if counts else (0.25, 0.75)
    ours = written(tmp_path, np.full(11, low), np.full(11, high))
    with FakeDexmo(tmp_path / "log", "--seed", "4", *(["--counts"] if counts else [])) as server:
        reader = Reader(server, calibration=str(ours))
        assert reader.glove.info.unit == ("count" if counts else "")
        reader.glove.send(command(0.5, [0.0, 0.25, 0.5, 0.75, 1.0]))
        told = heard(server, 1)["set_point"][0]
        # A server that sends counts still takes set points from 0 to 1.
        wanted = [1e-3, 0.25, 0.5, 0.75, 1.0] if counts else [0.25, 0.375, 0.5, 0.625, 0.75]
        assert np.array_equal(told, np.array(wanted, np.float32))
        reader.more(5)
        share = (reader.samples["channels"][:, :11] - low) / (high - low)
        assert np.allclose(reader.samples["flexion"], DEFAULT.angles(np.clip(share, -0.5, 1.5))[0])
        if counts:
            plain = Reader(server)
            plain.more(5)
            assert not plain.samples["good"].any(), "counts are no numbers from 0 to 1"


def test_which_of_several_gloves_must_be_clear(tmp_path: Path) -> None:
    with FakeDexmo(tmp_path / "log", "--gloves", "7:left,8:right,9:right") as server:
        for number, seconds, said in (
            (None, PATIENCE, r"has 2 right gloves: 7 \(left\), 8 \(right\), 9 \(right\); name one"),
            (7, PATIENCE, "glove 7 is not a right hand's"),
            (6, 1.0, r"no glove 6 within 1 s; gloves there: 7 \(left\), 8"),
        ):
            with pytest.raises(DeviceError, match=said):
                glove_at(server.port, device_id=number).open(seconds)
        glove = glove_at(server.port, device_id=9)
        glove.open(PATIENCE)
        glove.release()
        assert heard(server, 1)["number"].tolist() == [9]
        server.order("unplug")
        with pytest.raises(DeviceError, match=r"no right glove within 0\.2 s; gloves there: none"):
            glove_at(server.port).open(0.2)


@contextmanager
def speaking(data: bytes) -> Iterator[int]:
    """A server that says this to the first client, and then listens; its port."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def answer() -> None:
            link, _ = listener.accept()
            with link, suppress(OSError):
                link.sendall(data)
                while link.recv(1 << 16):
                    pass

        thread = threading.Thread(target=answer)
        thread.start()
        yield listener.getsockname()[1]
        thread.join()


def frame_of(*gloves: GloveMessage) -> bytes:
    return framed(encode_frame(gloves))


@pytest.mark.parametrize(
    ("said", "found"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "a message of 1347703880 bytes: expected 0 to 8192"),
        (struct.pack("<i", 3) + b"\x08\xff\xff", "3 bytes that are no Frame"),
        (frame_of(GloveMessage(5, HALF)), 5),
        (frame_of(GloveMessage(5, HALF), GloveMessage(6, HALF, True)), 6),
        (frame_of(GloveMessage(6, None, True), GloveMessage(5, HALF)), 5),
        (frame_of(GloveMessage(6, (math.nan,) * 11, True), GloveMessage(7, HALF, True)), 7),
        (frame_of(GloveMessage(5, HALF, False), GloveMessage(-9, HALF, True)), -9),
    ],
)
def test_which_glove_is_ours_and_what_is_no_server(said: bytes, found: str | int) -> None:
    with speaking(said) as port:
        glove = glove_at(port)
        if isinstance(found, str):
            with pytest.raises(DeviceError, match=f"what answers there is no Dexmo server: {found}"):
                glove.open(PATIENCE)
            return
        glove.open(PATIENCE)
        assert glove._device_id == found
        glove.close()


def test_a_glove_that_changes_hands_is_freed_and_used_again_when_it_is_ours(server: FakeDexmo) -> None:
    reader = Reader(server)
    glove, counters = reader.glove, reader.glove.counters
    reader.more(5)
    assert glove.send(command(0.75))
    server.order("swap")
    assert f"glove {RIGHT} says that it is a left hand's now" in reader.until_lost()
    assert_freed(heard(server, 2)[-1])
    assert glove.reconnect(), "its connection is sound"
    used, other = reader.count(), counters.other
    reader.until(lambda: counters.other > other + 20)
    assert reader.count() == used, "nothing of the other hand is used, and it is said once"
    server.order("swap")
    reader.more(5)
    assert np.array_equal(reader.samples["seq"], np.arange(reader.count()))
    assert counters.samples + counters.other == counters.frames and counters.malformed == counters.resyncs == 0


def test_the_server_dies_and_comes_back(server: FakeDexmo) -> None:
    reader = Reader(server)
    glove = reader.glove
    reader.more(5)
    assert glove.send(command(0.75))
    server.kill()
    assert "gone" in reader.until_lost()
    seen = reader.count()
    for _ in range(3):
        assert not glove.reconnect()
        with pytest.raises(DeviceError):
            reader.read()
        with pytest.raises(DeviceError):
            glove.send(command(0.75))
    assert not glove.release(), "it never raises"
    before = len(server.commands)
    server.start()
    until(glove.reconnect)
    assert glove.reconnect(), "and stays"
    reader.more(10)
    assert np.array_equal(reader.samples["seq"], np.arange(reader.count())) and reader.count() >= seen + 10
    assert len(server.commands) == before, "nothing from before is sent late"
    assert glove.send(command(0.25))
    assert (heard(server, before + 1)[-1]["stiffness"] == 0.25).all() and glove.counters.resyncs == 1


def test_what_came_before_the_end_is_handed_on_and_a_release_takes_a_fresh_connection(server: FakeDexmo) -> None:
    reader = Reader(server, room=3)
    until(lambda: len(server.frames) > 20)
    server.order("leave")
    sent, counters = len(server.frames), reader.glove.counters
    reader.until_lost()
    assert reader.count() == sent - counters.other == counters.samples
    server.order("back")
    assert reader.glove.release(PATIENCE)
    told = heard(server, 1)
    assert told["client"][0] == 1 and told["kept"][0]
    assert reader.glove.reconnect(), "the fresh connection is the connection now"
    reader.more(5)


@pytest.mark.parametrize("order", ["length -5", "length 8193", f"garbage {MOST_MALFORMED}"])
@pytest.mark.quick("length -5", f"garbage {MOST_MALFORMED}")
def test_a_stream_that_makes_no_sense_frees_the_fingers_and_begins_anew(server: FakeDexmo, order: str) -> None:
    reader = Reader(server)
    reader.more(5)
    assert reader.glove.send(command(0.75))
    server.order(order)
    wanted = "frames in a row cannot be read" if order.startswith("garbage") else "makes no sense: a message of"
    assert wanted in reader.until_lost()
    assert_freed(heard(server, 2)[-1])
    until(reader.glove.reconnect)
    reader.more(5)
    assert reader.glove.counters.resyncs == 1
    assert reader.glove.counters.malformed == (MOST_MALFORMED if order.startswith("garbage") else 0)


def test_a_watchdog_beside_the_loop(server: FakeDexmo) -> None:
    loop, watchdog = Reader(server), glove_at(server.port)
    assert not watchdog.release(), "nobody to tell"
    watchdog.open_for_release(PATIENCE)
    for _ in range(20):
        watchdog.drain()
        loop.more(1)
    assert loop.glove.send(command(0.5)) and watchdog.release()
    assert heard(server, 2)["client"].tolist() == [0, 1]
    server.order("leave")

    def gone() -> bool:
        try:
            watchdog.drain()
        except DeviceError:
            return True
        return False

    until(gone)
    server.order("back")
    until(watchdog.reconnect)
    assert watchdog.release()
    heard(server, 3)


def glove_on(*chunks: bytes) -> DexmoGlove:
    """A glove that is open, on a link that gives what it was given, and takes everything."""
    glove = DexmoGlove(configure("dexmo"))
    glove.describe()
    glove._device_id = RIGHT
    glove._link = link = Mock(connection=0)
    link.receive.side_effect = chain(chunks, repeat(None))

    def connect(*given: object) -> bool:
        link.connection += 1
        return True

    link.send_within.side_effect = connect
    return glove


def test_a_fresh_connection_begins_with_a_new_message_and_a_charge_that_is_none_is_unknown() -> None:
    frames = [frame_of(GloveMessage(RIGHT, HALF, True, charge)) for charge in (80, -3, 101, 0, 100)]
    reader = live_peers.Reader(glove := glove_on(frame_of(GloveMessage(RIGHT, HALF)), frames[0][:30], *frames))
    for count in (1, 0):
        assert len(reader.read()) == count
    assert glove.release()
    for _ in frames:
        # The half message of the old connection is no part of the new one's.
        assert len(reader.read()) == 1
    assert reader.samples["battery"].tolist() == [-1, 80, -1, -1, 0, 100] and glove.counters.resyncs == 1


def test_nothing_that_is_not_finite_comes_out_of_broken_frames() -> None:
    source, found = random.Random(5), Counter[str]()
    good = frame_of(GloveMessage(RIGHT, tuple(fake_channels(1, 0.3).tolist()), True, 87))
    out = np.zeros(16, GLOVE_SAMPLE)
    for _ in range(1200):
        data = bytearray(good * 8)
        for _ in range(source.randrange(1, 12)):
            data[source.randrange(len(data))] = source.choice((0xFF, 0x7F, 0x80, 0, source.randrange(256)))
        cuts = sorted(source.sample(range(len(data)), 3))
        glove = glove_on(*(bytes(data[a:b]) for a, b in zip([0, *cuts], [*cuts, len(data)])))
        try:
            for _ in range(8):
                rows = out[: glove.read(out)]
                assert np.isfinite(rows["flexion"]).all() and np.isfinite(rows["abduction"]).all()
                channels = rows["channels"][rows["good"], :11]
                assert np.isfinite(channels).all() and (np.abs(channels[:, BEND]) <= 1.5).all()
                found.update(good=len(channels), bad=len(rows) - len(channels))
        except DeviceError:
            found["gone"] += 1
        found["malformed"] += glove.counters.malformed
    assert len(found) == 4 and min(found.values()) > 100, "all of it happens"


LOW = np.linspace(600.0, 1600.0, 11)
HIGH = LOW + np.where(np.isin(np.arange(11), BEND), 2200.0, 400.0)


def load(path: Path | None) -> DexmoRegression:
    return glove_calibration(DexmoOptions(calibration=str(path or "")), "right")


def written(folder: Path, low: FloatArray, high: FloatArray) -> Path:
    path = folder / "calibration.toml"
    rows = [f"{name} = {{ open = {a}, closed = {b} }}" for name, a, b in zip(OURS, low, high)]
    path.write_text("[channel]\n" + "\n".join(rows))
    return path


def test_the_channels_are_those_of_the_regression() -> None:
    assert tuple(name.replace("pinky", "little") for name in CHANNELS) == OURS


def test_channels_that_say_little_are_named_and_their_fingers_kept_free(tmp_path: Path) -> None:
    ends = {"index_split": 37.0, "middle_split": -20.0, "ring_bend": 60.0, "little_bend": 4200.0}
    high = HIGH.copy()
    for name, span in ends.items():
        high[OURS.index(name)] = LOW[OURS.index(name)] + span
    doubtful, kept_free = load(written(tmp_path, LOW, high)).doubtful()
    assert doubtful == (
        "index_split spans 37 counts of 4095: it says little",
        "middle_split spans 20 counts of 4095: it says little",
        "ring_bend spans 60 counts of 4095: it says little",
        "counts beyond 0 to 4095: little_bend",
    )
    assert kept_free == (3,)


@pytest.mark.parametrize(
    ("low", "high", "other"), [(LOW, HIGH, 0.4), (np.full(11, 0.1), np.full(11, 0.9), 2000.0)], ids=["counts", "0 to 1"]
)
def test_our_file_is_for_what_its_ends_are_in(tmp_path: Path, low: FloatArray, high: FloatArray, other: float) -> None:
    calibration = load(written(tmp_path, low, high))
    found = calibration.hand_angles(high)
    assert np.allclose(found[0], DEFAULT.angles(np.ones(11))[0])
    assert calibration.hand_angles(np.full(11, other)) is None and load(None).hand_angles(LOW) is None
    assert calibration.in_counts == (high is HIGH)

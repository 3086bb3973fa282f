"""The Dexmo driver against a server in another process that misbehaves when told to."""

import json
import math
import random
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import product
from pathlib import Path
from typing import Any

import live_peers
import numpy as np
import pytest
from fake_gloves import FakeDexmo
from live_peers import PATIENCE, until
from numpy.typing import NDArray
from sampled import sampled

from hhsim.live.device import GLOVE_SAMPLE, Capability, DeviceError, FingerCommand
from hhsim.live.devices.registry import configure, open_device
from hhsim.live.drivers.dexmo import MOST_MALFORMED, DexmoGlove
from hhsim.live.link.dexmo_codec import CHANNELS, GloveMessage, framed
from hhsim.recordings.dexmo_regression import BEND, DexmoRegression
from tools.dexmo_server import COUNT_LOW, COUNT_SPAN, encode_frame
from tools.fake_peer import fake_channels

RIGHT = 337785601
DEFAULT = DexmoRegression.default()
MADE: list[DexmoGlove] = []


@pytest.fixture
def server(tmp_path: Path) -> Iterator[FakeDexmo]:
    with FakeDexmo(tmp_path / "log", "--seed", "4") as fake:
        yield fake


@pytest.fixture(autouse=True)
def no_glove_stays_open() -> Iterator[None]:
    yield
    while MADE:
        MADE.pop().close()


def glove_of(server: FakeDexmo, **settings: Any) -> DexmoGlove:
    glove = open_device(configure("dexmo", port=server.port, **settings))
    assert isinstance(glove, DexmoGlove)
    MADE.append(glove)
    return glove


def opened(server: FakeDexmo, **settings: Any) -> DexmoGlove:
    glove = glove_of(server, **settings)
    glove.open(PATIENCE)
    return glove


class Reader(live_peers.Reader):
    """All samples that a glove gives, `room` a call."""

    def __init__(self, glove: DexmoGlove, room: int = 64) -> None:
        super().__init__(glove)
        self.glove = glove
        self._buffer = self._buffer[:room]

    def more(self, count: int) -> None:
        wanted = self.count() + count
        self.until(lambda: self.count() >= wanted)

    def all_of(self, server: FakeDexmo) -> None:
        """The server sends no more, and all that it sent was read."""
        server.order("stall")
        sent = len(server.frames)
        self.until(lambda: self.glove.counters.frames >= sent)

    def column(self, name: str) -> NDArray[Any]:
        return np.asarray(self.samples[name])


def heard(server: FakeDexmo, count: int) -> None:
    until(lambda: len(server.commands) == count)


def command(stiffness: float | list[float], bend: float | list[float] = 0.5) -> FingerCommand:
    made = FingerCommand()
    made.stiffness[:], made.bend[:] = stiffness, bend
    return made


def motion(first: int, count: int, seed: int = 4, rate: float = 200.0) -> NDArray[np.float64]:
    rows = [fake_channels(seed, (first + k) / rate) for k in range(count)]
    return np.array(rows).astype(np.float32).astype(np.float64)


@pytest.mark.parametrize("way", ["frames", "bytes"])
def test_every_frame_arrives_once_and_as_it_was_sent(server: FakeDexmo, way: str) -> None:
    server.order(way)
    reader = Reader(opened(server))
    info = reader.glove.info
    assert (info.channels, info.hand, info.unit) == (CHANNELS, "right", "")
    assert Capability.STAMPS not in info.capabilities
    reader.more(60)
    reader.all_of(server)
    sent = server.frames
    counters = reader.glove.counters
    assert counters.frames == counters.samples == len(sent) == reader.count()
    assert counters.rejected == counters.other == counters.malformed == counters.resyncs == counters.dropped == 0
    wanted = np.array([motion(int(k), 1)[0] for k in sent["number"]])
    assert np.array_equal(reader.column("channels")[:, :11], wanted)
    assert np.isnan(reader.column("channels")[:, 11:]).all()
    flexion, abduction = DEFAULT.angles(wanted)
    assert np.allclose(reader.column("flexion"), flexion) and np.allclose(reader.column("abduction"), abduction)
    assert np.array_equal(reader.column("seq"), np.arange(len(sent)))
    assert reader.column("good").all() and (reader.column("battery") == 87).all()
    assert (reader.column("device_seq") == -1).all() and (reader.column("device_time_ns") == -1).all()
    assert (reader.column("time_ns") >= sent["time_ns"]).all(), "nothing is read before it was sent"


def test_commands_arrive_as_they_were_given(server: FakeDexmo) -> None:
    glove = opened(server)
    stiffness, bend = [0.0, 0.25, 0.5, 0.75, 1.0], [1.0, 0.0, 0.125, 0.5, 0.25]
    assert glove.send(command(stiffness, bend))
    assert glove.send(command([0.0, 0.25, 0.5, 0.75, 0.5], bend))
    assert glove.send(command(stiffness, bend))
    assert glove.send(command([2.0] * 5, [-1.0, 2.0, 0.5, 0.5, 0.5]))
    assert glove.release()
    heard(server, 5)
    received = server.commands
    assert (received["number"] == RIGHT).all() and glove.counters.commands == 5
    assert np.array_equal(received["stiffness"][0], np.array(stiffness, np.float32))
    assert np.array_equal(received["set_point"][0], np.array([1.0, 1e-3, 0.125, 0.5, 0.25], np.float32)), (
        "a direction has a sign"
    )
    assert np.array_equal(received["stiffness"][3], np.ones(5))
    assert np.array_equal(received["set_point"][3], np.array([1e-3, 1.0, 0.5, 0.5, 0.5], np.float32))
    assert not received["stiffness"][4].any() and not received["set_point"][4].any()
    assert received["kept"].tolist() == [1, 1, 0, 0, 1], (
        "the server must keep the first one, and what lets go of a finger"
    )


def test_a_command_that_is_not_finite_frees_all_fingers(server: FakeDexmo) -> None:
    glove, sent = opened(server), 0
    for bad, which in product((math.nan, math.inf, -math.inf), ("stiffness", "bend")):
        assert glove.send(command(0.5))
        broken = command(0.5)
        getattr(broken, which)[2] = bad
        assert glove.send(broken)
        sent += 2
        heard(server, sent)
        last = server.commands[-1]
        assert not last["stiffness"].any() and not last["set_point"].any() and last["kept"], (bad, which)


def test_set_points_are_the_servers_bends(server: FakeDexmo, tmp_path: Path) -> None:
    ours = tmp_path / "ours.toml"
    names = [name.replace("pinky", "little") for name in CHANNELS]
    ours.write_text("[channel]\n" + "\n".join(f"{name} = {{ open = 0.25, closed = 0.75 }}" for name in names))
    glove = opened(server, calibration=str(ours))
    glove.send(command(0.5, [0.0, 0.25, 0.5, 0.75, 1.0]))
    heard(server, 1)
    assert np.array_equal(server.commands[0]["set_point"], np.array([0.25, 0.375, 0.5, 0.625, 0.75], np.float32))
    reader = Reader(glove)
    reader.more(3)
    wanted, _ = DEFAULT.angles((reader.column("channels")[:, :11] - 0.25) / 0.5)
    assert np.allclose(reader.column("flexion"), wanted)


def test_which_of_several_gloves_must_be_clear(tmp_path: Path) -> None:
    with FakeDexmo(tmp_path / "log", "--gloves", "7:left,8:right,9:right") as server:
        with pytest.raises(DeviceError, match=r"has 2 right gloves: 7 \(left\), 8 \(right\), 9 \(right\); name one"):
            glove_of(server).open(PATIENCE)
        with pytest.raises(DeviceError, match="glove 7 is not a right hand's"):
            glove_of(server, device_id=7).open(PATIENCE)
        with pytest.raises(DeviceError, match=r"no glove 6 within 3 s; gloves there: 7 \(left\), 8"):
            glove_of(server, device_id=6).open(3.0)
        reader = Reader(opened(server, device_id=9))
        reader.more(5)
        reader.glove.release()
        until(lambda: server.commands["number"].tolist() == [9])


def test_a_server_without_gloves(server: FakeDexmo) -> None:
    server.order("unplug")
    with pytest.raises(DeviceError, match=r"no right glove within 0\.2 s; gloves there: none"):
        glove_of(server).open(0.2)


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


HALF = (0.5,) * 11


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "a message of 1347703880 bytes: expected 0 to 8192"),
        (struct.pack("<i", 3) + b"\x08\xff\xff", "3 bytes that are no Frame"),
        (frame_of(GloveMessage(5, HALF, False)) * 20_000, "more than 1 MB without its glove"),
    ],
)
def test_a_server_that_speaks_otherwise(text: bytes, reason: str) -> None:
    with speaking(text) as port:
        glove = open_device(configure("dexmo", port=port))
        with pytest.raises(DeviceError, match=f"what answers there is no Dexmo server: {reason}"):
            glove.open(PATIENCE)


@pytest.mark.parametrize(
    ("gloves", "number"),
    [
        ([GloveMessage(5, HALF)], 5),
        ([GloveMessage(5, HALF), GloveMessage(6, HALF, True)], 6),
        ([GloveMessage(6, None, True), GloveMessage(5, HALF)], 5),
        ([GloveMessage(6, (math.nan,) * 11, True), GloveMessage(7, HALF, True)], 7),
        ([GloveMessage(5, HALF, False), GloveMessage(-9, HALF, True)], -9),
    ],
)
def test_which_glove_is_ours(gloves: list[GloveMessage], number: int) -> None:
    with speaking(frame_of(*gloves)) as port:
        glove = open_device(configure("dexmo", port=port))
        assert isinstance(glove, DexmoGlove)
        glove.open(PATIENCE)
        assert glove._device_id == number
        glove.close()


def test_a_charge_that_is_none_is_unknown() -> None:
    frames = [frame_of(GloveMessage(RIGHT, HALF, True, charge)) for charge in (None, 80, -3, 101, 0, 100)]
    frames[0] = frame_of(GloveMessage(RIGHT, HALF))
    reader = Reader(glove_on(frames))
    while len(reader.read()):
        pass
    assert reader.column("battery").tolist() == [-1, 80, -1, -1, 0, 100]


def test_counts_need_a_calibration(tmp_path: Path) -> None:
    profile = tmp_path / "vendor.json"
    low, high = (dict.fromkeys(CHANNELS, value) for value in (COUNT_LOW, COUNT_LOW + COUNT_SPAN))
    low["index_split"] = high["index_split"] - 37.0
    profile.write_text(json.dumps({"RIGHT": {"anna": {"min": low, "max": high}}}))
    with FakeDexmo(tmp_path / "log", "--counts", "--seed", "4") as server:
        with pytest.raises(DeviceError, match="the glove sends raw counts"):
            glove_of(server).open(PATIENCE)
        reader = Reader(opened(server, calibration=str(profile)))
        assert reader.glove.info.unit == "count"
        assert reader.glove.info.doubtful == ("index_split spans 37 counts of 4095: it says little",)
        reader.more(10)
        assert reader.column("good").all(), "a spread that says little does not make a sample useless"
        counts = reader.column("channels")[:, :11]
        lowest, highest = (np.array(list(ends.values())) for ends in (low, high))
        share = np.clip((counts - lowest) / (highest - lowest), -0.5, 1.5)
        flexion, abduction = DEFAULT.angles(share)
        assert np.allclose(reader.column("flexion"), flexion) and np.allclose(reader.column("abduction"), abduction)
        reader.glove.send(command(0.5, 0.25))
        heard(server, 1)
        assert (server.commands[0]["set_point"] == 0.25).all(), "the server's own calibration is its own"


def test_samples_that_are_not_finite_are_marked_and_their_angles_are_the_last_good_ones(server: FakeDexmo) -> None:
    reader = Reader(opened(server))
    reader.more(5)
    server.order("nan 7")
    reader.until(lambda: reader.glove.counters.rejected == 7)
    reader.more(5)
    good, flexion = reader.column("good"), reader.column("flexion")
    (bad,) = np.nonzero(~good)
    assert len(bad) == 7 and np.isnan(reader.column("channels")[bad, CHANNELS.index("index_bend")]).all()
    assert np.isfinite(flexion).all() and (flexion[bad] == flexion[bad[0] - 1]).all()
    counters = reader.glove.counters
    assert counters.samples + counters.rejected == counters.frames == reader.count()


def test_a_glove_that_changes_hands_is_freed_and_used_again_when_it_is_ours(server: FakeDexmo) -> None:
    reader = Reader(opened(server))
    glove = reader.glove
    reader.more(5)
    assert glove.send(command(0.75))
    server.order("swap")
    assert f"glove {RIGHT} says that it is a left hand's now" in reader.until_lost()
    heard(server, 2)
    last = server.commands[-1]
    assert not last["stiffness"].any() and last["kept"]
    assert glove.reconnect(), "its connection is sound"
    used, other = reader.count(), glove.counters.other
    reader.until(lambda: glove.counters.other > other + 20)
    assert reader.count() == used, "nothing of the other hand is used, and it is said once"
    server.order("swap")
    reader.more(5)
    assert np.array_equal(reader.column("seq"), np.arange(reader.count()))
    counters = glove.counters
    assert counters.samples + counters.other == counters.frames and counters.malformed == counters.resyncs == 0


def test_the_server_dies_and_comes_back(server: FakeDexmo) -> None:
    reader = Reader(opened(server))
    reader.more(5)
    glove = reader.glove
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
    assert not glove.release()
    before = len(server.commands)
    server.start()
    until(glove.reconnect)
    assert glove.reconnect(), "and stays"
    reader.more(10)
    assert np.array_equal(reader.column("seq"), np.arange(reader.count())) and reader.count() >= seen + 10
    assert len(server.commands) == before, "nothing from before is sent late"
    assert glove.send(command(0.25))
    heard(server, before + 1)
    assert (server.commands[-1]["stiffness"] == 0.25).all()
    assert glove.counters.resyncs == 1


def test_what_came_before_the_end_is_still_handed_on(server: FakeDexmo) -> None:
    reader = Reader(opened(server), room=3)
    until(lambda: len(server.frames) > 20)
    server.order("leave")
    sent = len(server.frames)
    reader.until_lost()
    assert reader.count() == sent == reader.glove.counters.samples


@pytest.mark.parametrize(
    "order",
    sampled(
        ["length -5", f"length {2**31 - 1}", "length 8193", f"garbage {MOST_MALFORMED}"],
        lambda place, order: order in ("length -5", f"garbage {MOST_MALFORMED}"),
    ),
)
def test_a_stream_that_makes_no_sense_frees_the_fingers_and_begins_anew(server: FakeDexmo, order: str) -> None:
    reader = Reader(opened(server))
    reader.more(5)
    assert reader.glove.send(command(0.75))
    server.order(order)
    wanted = "frames in a row cannot be read" if order.startswith("garbage") else "makes no sense: a message of"
    assert wanted in reader.until_lost()
    heard(server, 2)
    last = server.commands[-1]
    assert not last["stiffness"].any() and last["kept"]
    until(reader.glove.reconnect)
    reader.more(5)
    assert reader.glove.counters.resyncs == 1
    assert reader.glove.counters.malformed == (MOST_MALFORMED if order.startswith("garbage") else 0)


def test_release_takes_a_fresh_connection_where_its_own_is_gone(server: FakeDexmo) -> None:
    reader = Reader(opened(server))
    reader.more(5)
    server.order("leave")
    reader.until_lost()
    server.order("back")
    assert reader.glove.release(PATIENCE)
    heard(server, 1)
    assert server.commands[0]["client"] == 1 and server.commands[0]["kept"]
    assert reader.glove.reconnect(), "the fresh connection is the connection now"
    reader.more(5)


def test_release_never_raises(server: FakeDexmo) -> None:
    glove = glove_of(server)
    assert not glove.release(), "nobody to tell"
    glove.open(PATIENCE)
    server.kill()
    until(lambda: not glove.release(0.05))
    glove.close()
    assert not glove.release(0.05)
    glove.close()


def test_a_watchdog_beside_the_loop(server: FakeDexmo) -> None:
    loop = Reader(opened(server))
    watchdog = glove_of(server)
    watchdog.open_for_release(PATIENCE)
    for _ in range(20):
        watchdog.drain()
        loop.more(1)
    assert loop.glove.send(command(0.5)) and watchdog.release()
    heard(server, 2)
    assert server.commands["client"].tolist() == [0, 1]
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


class Chunks:
    """A link that gives what it was given, and takes everything."""

    connected, name = True, "chunks"

    def __init__(self, chunks: list[bytes]) -> None:
        self.chunks = chunks
        self.connection = 1

    def receive(self) -> bytes | None:
        return self.chunks.pop(0) if self.chunks else None

    def send(self, data: bytes, *, urgent: bool = False) -> bool:
        return True

    def retire(self) -> None:
        self.chunks.clear()

    def reconnect(self) -> bool:
        return True

    def send_within(self, data: bytes, timeout: float) -> bool:
        self.connection += 1
        return True


def glove_on(chunks: list[bytes]) -> DexmoGlove:
    """A glove that is open, on such a link."""
    glove = DexmoGlove(configure("dexmo"))
    glove._fit([0.5] * len(CHANNELS))
    glove._device_id = RIGHT
    glove._link = Chunks(chunks)  # type: ignore[assignment]
    glove._connection = 1
    glove._begin_stream()
    return glove


def test_a_fresh_connection_begins_with_a_new_message() -> None:
    frame = framed(encode_frame([GloveMessage(RIGHT, tuple(fake_channels(1, 0.3).tolist()), True, 87)]))
    reader = Reader(glove_on([frame + frame[:30], frame]))
    assert len(reader.read()) == 1 and reader.glove.release()
    assert len(reader.read()) == 1, "the half message of the old connection is no part of the new one's"
    assert reader.glove.counters.resyncs == 1


def test_nothing_that_is_not_finite_comes_out_of_broken_frames() -> None:
    source = random.Random(5)
    channels = tuple(fake_channels(1, 0.3).tolist())
    good = framed(encode_frame([GloveMessage(RIGHT, channels, True, 87)]))
    good_samples = bad_samples = gone = malformed = 0
    out = np.zeros(16, GLOVE_SAMPLE)
    for _ in range(1200):
        data = bytearray(good * 8)
        for _ in range(source.randrange(1, 12)):
            data[source.randrange(len(data))] = source.choice((0xFF, 0x7F, 0x80, 0, source.randrange(256)))
        cuts = sorted(source.sample(range(len(data)), 3))
        glove = glove_on([bytes(data[a:b]) for a, b in zip([0, *cuts], [*cuts, len(data)])])
        try:
            for _ in range(8):
                rows = out[: glove.read(out)]
                assert np.isfinite(rows["flexion"]).all() and np.isfinite(rows["abduction"]).all()
                ok = rows["good"]
                assert np.isfinite(rows["channels"][ok][:, :11]).all()
                assert (np.abs(rows["channels"][ok][:, list(BEND)]) <= 1.5).all()
                good_samples += int(ok.sum())
                bad_samples += int((~ok).sum())
        except DeviceError:
            gone += 1
        malformed += glove.counters.malformed
    assert min(good_samples, bad_samples, gone, malformed) > 100, "all of it happens"

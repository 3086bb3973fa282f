"""The connection under a glove: nothing by halves, nothing late, and no last word lost."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from live_peers import PATIENCE, until

from hhsim.live import tcp
from hhsim.live.device import DeviceError
from hhsim.live.tcp import TcpLink, is_itself


@contextmanager
def pair() -> Iterator[tuple[TcpLink, socket.socket, socket.socket]]:
    """A link, the peer's end of it, and where the peer listens."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        link = TcpLink("127.0.0.1", listener.getsockname()[1], "the peer")
        link.connect(PATIENCE)
        peer, _ = listener.accept()
        peer.settimeout(PATIENCE)
        with peer:
            yield link, peer, listener
        link.close()


def test_a_peer_that_takes_nothing_gets_whole_messages_or_none() -> None:
    with pair() as (link, peer, _):
        sent = []
        for k in range(200):
            message = bytes([k]) * 1_000_003
            if not link.send(message, urgent=True):
                break
            sent.append(message)
        else:
            pytest.fail("the system takes all there is")
        # A part of the last one was taken: its rest comes first, and until then nothing does.
        assert not link.send(b"late", urgent=True) and not link.send(b"late")
        got = bytearray()
        wanted = b"".join(sent)
        while len(got) < len(wanted):
            got += peer.recv(1 << 20)
            link.send(b"", urgent=True)
        assert got == wanted
        assert link.send(b"again") and peer.recv(100) == b"again"


def test_a_slow_peer_is_sent_nothing_that_is_not_urgent() -> None:
    with pair() as (link, peer, _):
        while link.send(bytes(100)):
            pass
        assert not link.send(b"no") and link.send(b"yes", urgent=True)
        got = b""
        while not got.endswith(b"yes"):
            got = got[-3:] + peer.recv(1 << 20)


def test_a_message_that_must_go_takes_a_fresh_connection_where_this_one_is_full() -> None:
    with pair() as (link, _, listener):
        message = b"let go" * 20_000
        for _ in range(1000):
            assert link.send_within(message, 4.0)
            if link.connection == 2:
                break
        second, _ = listener.accept()
        with second:
            got = b""
            while len(got) < len(message):
                got += second.recv(1 << 20)
            assert got == message


def test_retiring_waits_for_nothing_and_resets_the_connection_only_later(monkeypatch: pytest.MonkeyPatch) -> None:
    with pair() as (link, peer, listener):
        peer.sendall(bytes(100))
        assert link.send(b"last word")
        link.retire()
        assert link.descriptors() == ()
        # A server that writes before it reads; a reset would make this fail.
        for _ in range(50):
            peer.sendall(bytes(1000))
        assert peer.recv(100) == b"last word" and peer.recv(100) == b""
        until(link.reconnect)
        fresh, _ = listener.accept()
        with fresh:
            fresh.settimeout(PATIENCE)
            assert link.send(b"hello") and fresh.recv(100) == b"hello"
            peer.sendall(b"still heard")
            # A server that goes on is not left with a connection that nobody reads.
            monkeypatch.setattr(tcp, "GIVE_UP", 0.0)
            assert link.receive() is None
            with pytest.raises(OSError):
                until(lambda: peer.send(b"more") == 0)


@pytest.mark.parametrize(
    ("host", "message"),
    [("127.0.0.1", r"cannot connect \(Connection refused\): is its server running"), ("no such host", "no such host")],
)
def test_what_cannot_be_reached_is_said_in_one_line(host: str, message: str) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(DeviceError, match=message) as refused:
            TcpLink(host, taken.getsockname()[1], "glove").connect(PATIENCE)
    assert "\n" not in str(refused.value)


def test_a_socket_connected_to_itself_is_no_server() -> None:
    # Where nothing listens on a port that the system also gives to clients, this happens by itself now and then.
    with socket.socket() as link:
        link.bind(("127.0.0.1", 0))
        link.connect(link.getsockname())
        assert is_itself(link)
    with pair() as (_, peer, _):
        assert not is_itself(peer)

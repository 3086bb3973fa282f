"""A hand tracked by a headset: joints of our own hand that come back as its angles."""

import signal
import socket
import struct
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from joint_samples import JointSample, Side, joint_sample
from live_peers import PATIENCE, Bridge, Reader, example, free_ports

from hhsim.live.device import FORCES, FingerCommand, GloveDevice
from hhsim.live.drivers.poses import make_pose_source
from hhsim.live.gloves import PoseConfig, configure, open_device
from hhsim.recordings.joint_names import OPENXR_JOINTS

BRIDGE = Path(__file__).resolve().parents[3] / "examples" / "openxr_bridge.py"
NOT_VALID = [float("nan")] * 3


class Location(NamedTuple):
    """A joint as `XrHandJointLocationEXT` has it behind its flags."""

    orientation: Sequence[float]
    position: Sequence[float]
    radius: float


def locations(sample: JointSample, k: int) -> list[Location]:
    """Row k of a motion as a runtime gives it; its orientations are arbitrary."""
    points = sample.named(OPENXR_JOINTS)[k]
    return [Location((0.0, 0.6, 0.0, 0.8), point, radius) for point, radius in zip(points, sample.radius)]


class Headset(Bridge):
    """A bridge that sends the joints of a hand."""

    seq = 0

    def joints(self, joints: Sequence[Location]) -> bytes:
        """A packet of kind 5, put together field by field: by docs/live-protocols.md and OpenXR 1.1 alone."""
        header = b"HHGL" + struct.pack("<2BH2IQIi", 1, 5, 208, 5, self.seq, 1000 * self.seq, 2**32 - 1, -1)
        self.seq += 1
        return header + b"".join(struct.pack("<8f", *each.orientation, *each.position, each.radius) for each in joints)

    def send_joints(self, joints: list[Location]) -> None:
        self.send_bytes(self.joints(joints))


@contextmanager
def opened(sample: JointSample, side: Side) -> Iterator[tuple[GloveDevice, Headset]]:
    """A device that has heard row 0 of a motion, and its headset."""
    headset = Headset()
    with (
        closing(headset.socket),
        headset.opened(open_device(headset.config("openxr", hand=side)), headset.joints(locations(sample, 0))) as glove,
    ):
        yield glove, headset


@pytest.mark.parametrize("side", ["right", "left"])
def test_our_own_hand_comes_back(side: Side) -> None:
    sample = joint_sample(side)
    with opened(sample, side) as (glove, headset):
        for k in range(1, 30):
            headset.send_joints(locations(sample, k))
        reader = Reader(glove)
        reader.until(lambda: reader.count() >= 30)
        samples = reader.samples
        assert samples["good"].all()
        assert samples["device_seq"].tolist() == list(range(30))
        # Numbers of 32 bits: a bone of 20 mm is known to a few nm.
        np.testing.assert_allclose(samples["flexion"], sample.motion.flexion[:30], atol=2e-5)
        np.testing.assert_allclose(samples["abduction"], sample.motion.abduction[:30], atol=2e-5)
        np.testing.assert_allclose(glove.palm.position, sample.motion.position[29], atol=1e-6)
        turn = sample.motion.orientation[29] / np.linalg.norm(sample.motion.orientation[29])
        assert abs(float(glove.palm.orientation @ turn)) == pytest.approx(1.0, abs=1e-9)
        assert glove.palm.came_ns == samples["time_ns"][-1]
        # What is recorded is where the joints were, wrist first.
        np.testing.assert_allclose(samples["channels"][29, :3], sample.named()[29, 0], atol=1e-6)
        assert len(glove.info.channels) == 63


def test_joints_of_no_hand_are_recorded_and_not_used() -> None:
    sample = joint_sample("right")
    with opened(sample, "right") as (glove, headset):
        reader = Reader(glove)
        reader.read()
        good = locations(sample, 1)
        hidden = [joint._replace(position=NOT_VALID) if k == 10 else joint for k, joint in enumerate(good)]
        unused = [
            joint._replace(position=NOT_VALID) if k in (0, 6, 11, 16, 21) else joint for k, joint in enumerate(good)
        ]
        millimetres = [joint._replace(position=[1000.0 * x for x in joint.position]) for joint in good]
        nowhere = [joint._replace(position=[0.0] * 3) for joint in good]
        huge = [joint._replace(position=[3e38, -3e38, 3e38]) for joint in good]
        for joints in (hidden, unused, millimetres, nowhere, huge, good):
            headset.send_joints(joints)
        reader.until(lambda: reader.count() >= 7)
        samples = reader.samples[1:]
        # The palm joint and the metacarpals of the fingers are not needed.
        assert samples["good"].tolist() == [False, True, False, False, False, True]
        assert np.isfinite(samples["flexion"]).all(), "what is not to be used holds no NaN"
        assert (glove.counters.samples, glove.counters.rejected) == (3, 4)


def test_the_palm_begins_where_it_is_told_to_and_moves_as_the_hand_does() -> None:
    sample = joint_sample("right")
    with opened(sample, "right") as (glove, headset):
        source = make_pose_source(PoseConfig("glove", position=(0.1, 0.2, 0.3)), None, glove)
        assert source.read(time.monotonic_ns())[0] == -1
        reader = Reader(glove)
        for k in range(1, 20):
            reader.until(lambda k=k: reader.count() >= k)
            came, position, orientation = source.read(time.monotonic_ns())
            assert came == reader.samples["time_ns"][-1]
            moved = sample.motion.position[k - 1] - sample.motion.position[0]
            np.testing.assert_allclose(position, [0.1, 0.2, 0.3] + moved, atol=2e-6)
            assert np.linalg.norm(orientation) == pytest.approx(1.0)
            headset.send_joints(locations(sample, k))


@pytest.mark.parametrize("stop", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.soak)])
def test_the_example_bridge_sends_a_hand_and_shakes_fingers(stop: signal.Signals) -> None:
    port = free_ports(socket.SOCK_DGRAM)
    with example(BRIDGE, port) as bridge:
        with closing(open_device(configure("openxr", port=port, takes="forces"))) as glove:
            glove.open(PATIENCE)
            reader = Reader(glove)
            reader.until(lambda: reader.count() >= 20)
            samples = reader.samples
            assert samples["good"].all()
            assert glove.counters.dropped == 0
            # A hand that points away from the user, flat above the ground; its fingers' joints bend as one, by less
            # than 2° as ours, whose fingers do not lie in quite the same planes.
            np.testing.assert_allclose(np.abs(glove.palm.orientation), [1.0, 0.0, 0.0, 0.0], atol=0.1)
            assert np.ptp(samples["flexion"][:, 1:, 1:], axis=(1, 2)).max() < np.radians(2.0)
            assert glove.info.capabilities == FORCES
            command = FingerCommand()
            command.force[1, 2] = 0.0, 0.0, 0.5
            assert glove.send(command)
            assert bridge.stdout.readline().split() == ["0.00", "0.25", "0.00", "0.00", "0.00"]
            while (told := bridge.stdout.readline().split()) == ["0.00", "0.25", "0.00", "0.00", "0.00"]:
                continue
            assert told == ["0.00"] * 5, "nobody told it more for 100 ms"
            assert glove.send(command)
            bridge.stdout.readline()
        bridge.send_signal(stop)
        assert bridge.wait(PATIENCE) == 0
        assert bridge.stdout.read().split()[-5:] == ["0.00"] * 5, "it lets go when it is stopped"

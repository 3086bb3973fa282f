"""Palm pose from a tracker, in the open packet of `hhsim.live.link.udp_codec`."""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.live.link.udp import PacketOrder, UdpPort
from hhsim.live.link.udp_codec import Kind
from hhsim.live.pose.registry import PoseConfig, PoseSource

FARTHEST = 100.0
"""Largest coordinate of a palm [m]; a larger one was sent in millimetres."""
UNIT_WITHIN = 0.1
"""Largest difference of a quaternion's length from 1."""


class UdpPose(PoseSource):
    """Newest valid pose sent by the tracker at the configuration's `host` and `port`; it ages while none comes."""

    def __init__(self, config: PoseConfig, status: object = None) -> None:
        self.name = f"udp pose from {config.host} at port {config.port}"
        self._config = config
        self._port: UdpPort | None = None
        self._order = PacketOrder()
        self._position, self._orientation = np.zeros(3), np.zeros(4)
        self._came_ns = -1

    def open(self) -> None:
        """See `PoseSource.open`; does not wait for a pose."""
        self.close()
        self._port = UdpPort(self._config.host, self._config.port)

    def descriptors(self) -> tuple[int, ...]:
        """See `PoseSource.descriptors`."""
        return () if self._port is None else (self._port.descriptor,)

    def read(self, now_ns: int, position_out: FloatArray, orientation_out: FloatArray) -> int:
        """See `PoseSource.read`."""
        if self._port is not None:
            for packet, came in self._port.arrived():
                if packet.kind is Kind.POSE and self._order.take(packet.session, packet.seq, came):
                    self._port.keep_to_sender()
                    self._take(packet.values.astype(np.float64), came)
        if self._came_ns >= 0:
            position_out[:] = self._position
            orientation_out[:] = self._orientation
        return self._came_ns

    def _take(self, values: FloatArray, came: int) -> None:
        length = float(np.linalg.norm(values[3:]))
        # NaN compares false.
        if (np.abs(values[:3]) <= FARTHEST).all() and abs(length - 1.0) <= UNIT_WITHIN:
            self._position, self._orientation = values[:3], values[3:] / length
            self._came_ns = came

    def close(self) -> None:
        """See `PoseSource.close`."""
        if self._port is not None:
            self._port.close()
        self._port = None

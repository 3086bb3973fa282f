"""Columns of stamps by their names."""

import pytest

from hhsim.recordings.unit_detection import TimeColumn, time_column


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (["x", "y"], None),
        (["frame", "t"], TimeColumn("t", None)),
        (["timestamp_ms", "x"], TimeColumn("timestamp_ms", "ms")),
        (["Time [s]"], TimeColumn("Time [s]", "s")),
        (["timestampNs"], TimeColumn("timestampNs", "ns")),
        (["time_seconds"], TimeColumn("time_seconds", "s")),
        (["time_of_day", "host_time", "device_time_us"], TimeColumn("device_time_us", "us", ("host_time",))),
    ],
)
def test_the_stamps_are_found_with_their_unit(names: list[str], found: TimeColumn | None) -> None:
    assert time_column(names) == found

"""Figures of a session, while it runs and at its end, from the ring of its ticks."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK, WORK_CANDIDATES
from hhsim.live.processes import RingReader, SharedRing
from hhsim.metrics.session_faults import FREED_FOR_SAFETY
from hhsim.result.safety import Safety, free_counts
from hhsim.system.log_histogram import LogHistogram

Scalar = str | int | float | bool

BLOCK_TICKS = 2048
"""Ticks read from the ring at once."""
RATE_WINDOW = 2.0
"""Time over which the displayed rate is averaged [s]."""


class LiveTally:
    """Counts over the ticks of a session, of its ring of `LIVE_TICK` from the beginning, or as passed to `count`."""

    def __init__(self, ring: SharedRing | None = None) -> None:
        self._reader = None if ring is None else RingReader(ring)
        # Lateness of the loop, time from sample to command, time of the solver's tick [ns].
        self.wakeup, self.latency, self.duration = LogHistogram(), LogHistogram(), LogHistogram()
        self.ticks = 0  # with a hand; those before the first input are not in the ring
        self.missed = 0  # periods without a tick, before the counted ticks
        # Ticks that used a sample for the first time, and samples that a newer one replaced before one could use them.
        self.new_samples = self.superseded = 0
        # Ticks: the last two are those with a stiffness above 0, and those with fingers freed for safety.
        self.stuck = self.lagging = self.in_contact = self.stiff = self.freed = 0
        self.candidates_max, self.force_max = 0, 0.0
        self.free_for = dict.fromkeys(Safety, 0)  # ticks whose fingers were kept free, by reason
        self._sample = -1
        self._recent: list[tuple[int, int]] = []

    @property
    def lost(self) -> int:
        """Number of ticks that were overwritten before they were counted."""
        return 0 if self._reader is None else self._reader.lost

    def read(self) -> None:
        """Count all ticks since the last call."""
        while self._reader is not None and len(ticks := self._reader.read(BLOCK_TICKS)[1]):
            self.count(ticks)

    def note(self, ticks: int, now_ns: int) -> None:
        """Record for `rate` the number of the loop's ticks, those without input too, at CLOCK_MONOTONIC [ns]."""
        self._recent = [(at, done) for at, done in self._recent if now_ns - at < 1e9 * RATE_WINDOW]
        self._recent.append((now_ns, ticks))

    @property
    def rate(self) -> float:
        """Ticks a second over the last `RATE_WINDOW` [Hz]; 0 before there are two notes."""
        if not self._recent:
            return 0.0
        (first, before), (last, after) = self._recent[0], self._recent[-1]
        return 1e9 * (after - before) / (last - first) if last > first else 0.0

    def figures(self) -> dict[str, Scalar]:
        """Return all figures, SI units; wakeup_p999 is the 99.9th percentile [s], kept_free_stale_input a reason's."""
        free = free_counts(self.free_for.__getitem__)
        return {
            "ticks": self.ticks,
            "missed": self.missed,
            **_percentiles("wakeup", self.wakeup),
            **_percentiles("latency", self.latency),
            **_percentiles("tick", self.duration),
            "ticks_in_contact": self.in_contact,
            "ticks_with_resistance": self.stiff,
            "candidates_max": self.candidates_max,
            "force_max": self.force_max,
            "stuck_ticks": self.stuck,
            "lag_ticks": self.lagging,
            "samples_used": self.new_samples,
            "samples_superseded": self.superseded,
            **{f"kept_free_{why.lower()}": count for why, count in free.items()},
        }

    def count(self, ticks: NDArray[np.void]) -> None:
        """Count ticks of `LIVE_TICK`, at least one."""
        self.ticks += len(ticks)
        self.missed += int(ticks["missed"].sum())
        self.wakeup.add(np.maximum(ticks["wakeup_ns"], 0))
        self.duration.add(ticks["duration_total"])
        self.latency.add(ticks["latency_ns"][ticks["latency_ns"] >= 0])
        contact = ticks["work"][:, WORK_CANDIDATES]
        self.in_contact += int(np.sum(contact > 0))
        self.candidates_max = max(self.candidates_max, int(contact.max()))
        self.force_max = max(self.force_max, float(np.nanmax(np.linalg.norm(ticks["total"], axis=1), initial=0.0)))
        self.stuck += int(np.sum(ticks["status"] & STATUS_STUCK > 0))
        self.lagging += int(np.sum(ticks["status"] & STATUS_LAG > 0))
        self.stiff += int(np.sum((ticks["command_stiffness"] > 0.0).any(axis=1)))
        for why in Safety:
            self.free_for[why] += int(np.sum(ticks["safety"] & int(why) > 0))
        self.freed += int(np.sum(ticks["safety"] & int(FREED_FOR_SAFETY) > 0))
        steps = np.diff(ticks["input_seq"], prepend=self._sample)
        self.new_samples += int(np.sum(steps > 0))
        self.superseded += int(np.sum(steps[steps > 1] - 1))
        self._sample = int(ticks["input_seq"][-1])


def session_figures(
    tally: LiveTally, missed: int, missed_by: Mapping[str, int], penetration_max: float, lost: Mapping[str, int]
) -> dict[str, Scalar]:
    """Return the summary of a session over all recorded ticks, SI units.

    Args:
        missed, missed_by: Periods without a tick since the loop began, and by cause (`miss_cause.by_name`).
        penetration_max: Largest penetration [m].
        lost: Records that were overwritten before they could be written, by ring.

    Returns:
        `LiveTally.figures`, `missed`, the same by cause (`hhsim.metrics.session_faults.MISSED_BY`), `penetration_max`
        [m], and the lost records of each ring.
    """
    return {
        **tally.figures(),
        "missed": missed,
        **{f"missed_{cause}": count for cause, count in missed_by.items()},
        "penetration_max": penetration_max,
        **{f"lost_{name}": count for name, count in lost.items()},
    }


def _percentiles(name: str, values: LogHistogram) -> dict[str, float]:
    """Return percentiles of a histogram of ns in seconds; NaN if nothing was counted."""
    found = {f"{name}_p{str(p).replace('.', '')}": 1e-9 * values.percentile(p) for p in (50, 99, 99.9)}
    return {**found, f"{name}_max": 1e-9 * values.largest}

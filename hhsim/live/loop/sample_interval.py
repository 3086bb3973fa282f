"""How far a glove's samples usually are from each other, and what that says of the limit of their age."""

STEP = 1.05
"""What is taken for usual goes by this factor towards each interval: half of them are longer, half shorter."""
LOST = 1
"""Samples in a row that a link may lose without a word; the next one is then this many intervals late, and one more."""


class SampleInterval:
    """The running median of a glove's intervals; a pause counts as one interval, however long it is."""

    def __init__(self) -> None:
        """No sample has come."""
        self.usual_ns = 0.0
        """[ns]; 0 before there are two samples."""
        self._last = -1

    def add(self, time_ns: int) -> None:
        """Count a sample that was read at this time of CLOCK_MONOTONIC [ns]."""
        step, known = time_ns - self._last, self._last >= 0
        self._last = time_ns
        if not known or step <= 0:
            return
        if self.usual_ns == 0.0:
            self.usual_ns = float(step)
        elif step > self.usual_ns:
            self.usual_ns *= STEP
        else:
            self.usual_ns = max(self.usual_ns / STEP, float(step))

    def hint(self, stale: float) -> str:
        """Which limit of age fits the glove's own rate, where one lost sample is too old for `stale` [s]; else ""."""
        needed = (LOST + 1.5) * 1e-9 * self.usual_ns
        if stale >= (LOST + 1) * 1e-9 * self.usual_ns:
            return ""
        return (
            f"; samples come {1e9 / self.usual_ns:.0f} times a second, so that one that is lost frees the fingers: "
            f"--stale {1e3 * needed:.0f} would let it pass"
        )

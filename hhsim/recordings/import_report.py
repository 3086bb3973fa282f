"""Report of what an import found and did, for people and for machines."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from hhsim.hand.fingers import FINGERS
from hhsim.motion.sample_flags import FLAG_MEANINGS, SampleFlag, marked
from hhsim.recordings.recorded_bones import RecordedBones
from hhsim.recordings.recording import Finding, Recording
from hhsim.recordings.repair import Repaired
from hhsim.table.table import number, words


@dataclass(frozen=True)
class ImportReport:
    """Outcome of an import.

    Attributes:
        form: Name of the file's format.
        samples_in, samples_out: Samples before and after the repairs.
        duration: Duration of the trajectory [s].
        mean_rate: Samples a second [Hz].
        longest_step: Longest time between samples [s].
        hand: Right, left, or "" if unknown.
        hand_length: Length of the recorded hand [m], None if unknown.
        fit: Bones of the recorded hand and the error of its fit; None without joint centres.
        mended: Number of samples of which a number was changed.
        flags: Number of samples with each flag.
        checksums: As in `hhsim.motion.trajectory.Trajectory`.
    """

    form: str
    samples_in: int
    samples_out: int
    duration: float
    mean_rate: float
    longest_step: float
    hand: str
    hand_length: float | None
    fit: RecordedBones | None
    mended: int
    findings: tuple[Finding, ...]
    flags: dict[str, int]
    checksums: str

    def to_json(self) -> dict[str, Any]:
        """Return the report as a document, SI units."""
        plain = {name: value for name, value in vars(self).items() if name not in ("form", "findings", "fit")}
        return {
            "format": self.form,
            **plain,
            "fit": None if self.fit is None else self.fit.to_json(),
            "flag_meanings": {flag.word: FLAG_MEANINGS[flag] for flag in SampleFlag if flag.word in self.flags},
            "findings": [vars(finding) for finding in self.findings],
        }

    def fit_rows(self) -> list[tuple[Any, ...]]:
        """Return rows of finger, RMS and largest error of the fit [m], and its bones [m]; none without bones."""
        fit = self.fit
        return [] if fit is None else list(zip(FINGERS, fit.rms, fit.largest, *fit.length.T))


COLUMNS = (
    words("finding", lambda finding: finding.kind.replace("_", " ")),
    number("samples", lambda finding: finding.samples or ""),
    number("first at", "first_time", "s", 3, missing=""),
    words("what, and what was done", "text"),
)
FIT_COLUMNS = (
    words("finger", 0),
    number("fit, rms", 1, "mm", 2),
    number("fit, max", 2, "mm", 2),
    *(number(f"bone {i}", 2 + i, "mm", 1) for i in (1, 2, 3)),
)


def make_report(recording: Recording, repaired: Repaired) -> ImportReport:
    """Make the report of a recording and of its repair."""
    motion = repaired.trajectory
    flags = motion.flags if motion.flags is not None else np.zeros(motion.sample_count, dtype=np.uint32)
    counts = {flag.word: int(marked(flags, flag).sum()) for flag in SampleFlag}
    return ImportReport(
        form=recording.form,
        samples_in=recording.sample_count,
        samples_out=motion.sample_count,
        duration=motion.duration,
        mean_rate=motion.mean_rate,
        longest_step=float(np.diff(motion.time).max(initial=0.0)),
        hand=motion.hand,
        hand_length=repaired.hand_length,
        fit=recording.bones,
        mended=repaired.mended,
        findings=repaired.findings,
        flags={word: count for word, count in counts.items() if count},
        checksums=motion.checksums,
    )

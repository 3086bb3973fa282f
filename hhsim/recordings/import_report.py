"""What an import found and did, for people and for machines."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from hhsim.hand.fingers import FINGERS
from hhsim.motion.sample_flags import FLAG_MEANINGS, SampleFlag, marked
from hhsim.recordings.recorded_bones import RecordedBones
from hhsim.recordings.recording import Finding, Recording
from hhsim.recordings.repair import Repaired


@dataclass(frozen=True)
class ImportReport:
    """The outcome of an import.

    Attributes:
        form: Format of the file, in a word.
        samples_in, samples_out: Before and after.
        duration: Of the trajectory [s].
        mean_rate: Samples a second [Hz].
        longest_step: Longest time between samples [s].
        hand: Right, left, or "" where nobody said.
        hand_length: Of the recorded hand [m], None where it is not known.
        fit: Bones of the recorded hand and the error of its fit; None where joint centres were not recorded.
        mended: Samples of which a number was changed.
        findings: In the order of the repairs.
        flags: How many samples bear each flag.
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
        """The report as a document, SI units."""
        plain = {name: value for name, value in vars(self).items() if name not in ("form", "findings", "fit")}
        return {
            "format": self.form,
            **plain,
            "fit": None if self.fit is None else self.fit.to_json(),
            "flag_meanings": {flag.word: FLAG_MEANINGS[flag] for flag in SampleFlag if flag.word in self.flags},
            "findings": [vars(finding) for finding in self.findings],
        }

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Rows of the table: finding, samples, first at [s], what was done."""
        return [
            (
                finding.kind.replace("_", " "),
                f"{finding.samples:,}" if finding.samples else "",
                "" if finding.first_time is None else f"{finding.first_time:.3f}",
                finding.text,
            )
            for finding in self.findings
        ]

    def fit_rows(self) -> list[tuple[str, ...]]:
        """Rows of the fit: finger, its error [mm], its bones [mm]; none without bones."""
        if self.fit is None:
            return []
        return [
            (finger, *(f"{1e3 * value:.2f}" for value in (rms, largest)), *(f"{1e3 * bone:.1f}" for bone in length))
            for finger, rms, largest, length in zip(FINGERS, self.fit.rms, self.fit.largest, self.fit.length)
        ]


COLUMNS = ("finding", "samples", "first at [s]", "what, and what was done")
FIT_COLUMNS = ("finger", "fit, rms [mm]", "fit, max [mm]", "bone 1 [mm]", "bone 2 [mm]", "bone 3 [mm]")


def make_report(recording: Recording, repaired: Repaired) -> ImportReport:
    """The report of a recording and of what became of it."""
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

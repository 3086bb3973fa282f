"""Report of what an import found and did, for people and for machines."""

from typing import Any

import numpy as np

from hhsim.hand.fingers import FINGERS
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.recordings.cleaning import CleanedRecording
from hhsim.recordings.recorded_bones import RecordedBones
from hhsim.recordings.recording import Recording
from hhsim.table.table import number, words

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


def fit_rows(fit: RecordedBones) -> list[tuple[Any, ...]]:
    """Return rows of finger, RMS and largest error of the fit [m], and its bones [m], for `FIT_COLUMNS`."""
    return list(zip(FINGERS, fit.rms, fit.largest, *fit.length.T))


def import_document(recording: Recording, cleaned: CleanedRecording) -> dict[str, Any]:
    """Return format, samples, times [s], rate [Hz], hand, findings and flags of an import as a document, SI units."""
    motion = cleaned.trajectory
    flags = motion.flags if motion.flags is not None else np.zeros(motion.sample_count, dtype=np.uint32)
    counts = {flag: count for flag in SampleFlag if (count := int(marked(flags, flag).sum()))}
    return {
        "format": recording.form,
        "samples_in": recording.sample_count,
        "samples_out": motion.sample_count,
        "duration": motion.duration,
        "mean_rate": motion.mean_rate,
        "longest_step": float(np.diff(motion.time).max(initial=0.0)),
        "hand": motion.hand,
        "hand_length": cleaned.hand_length,
        "mended": cleaned.mended,
        "flags": {flag.word: count for flag, count in counts.items()},
        "checksums": motion.checksums,
        "fit": None if recording.bones is None else recording.bones.to_json(),
        "flag_meanings": {flag.word: flag.meaning for flag in counts},
        "findings": [vars(finding) for finding in cleaned.findings],
    }

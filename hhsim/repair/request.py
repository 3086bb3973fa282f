"""Order of a repair: which recording, which object, and the limits of its verdict; and what came of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hhsim.recordings.registry import ReadOptions
from hhsim.table.table import Table

MAX_CORRECTION = 0.015
"""Default of the largest move of a joint that counts as a repair [m]."""


@dataclass(frozen=True, kw_only=True)
class RepairRequest:
    """Order to repair one recording.

    Attributes:
        recording: File of the recorded hand.
        object: Name of the catalogue, or mesh file.
        out: File to write, of the recording's own format.
        object_poses: File with the object's poses; None takes those of the recording.
        hand_file: Sizes of the hand, for a recording of angles; None takes the usual hand.
        unit, size: Unit of a mesh file, or length of its longest side [m].
        max_correction: Largest move of a joint that counts as a repair [m].
        palm: `usual`, or `none`, `thin` or `fitted` (`hhsim.repair.skin`).
        read: Meaning of the recording's numbers.
    """

    recording: Path
    object: str
    out: Path
    object_poses: Path | None = None
    hand_file: Path | None = None
    unit: str | None = None
    size: float | None = None
    max_correction: float = MAX_CORRECTION
    palm: str = "usual"
    read: ReadOptions = field(default_factory=ReadOptions)


@dataclass(frozen=True)
class RepairOutcome:
    """Result of a repair.

    Attributes:
        figures: Figures by name, SI units; those of the recording end in `_before`, those of the repair in `_after`.
        table: The same, for people.
        frames: Number of frames.
        marked: Frames in which no repair was found, or whose correction exceeds the limit.
        verdict: One line.
        missed: Names of the limits that were missed.
        findings: Remarks of the reader and of the repair, a line each.
        paths: Files by what they hold: `recording`, `result`, `report`.
    """

    figures: Mapping[str, float]
    table: Table
    frames: int
    marked: tuple[int, ...]
    verdict: str
    missed: tuple[str, ...]
    findings: tuple[str, ...]
    paths: Mapping[str, Path]

    @property
    def ok(self) -> bool:
        """Return True if no limit was missed."""
        return not self.missed

    def to_json(self) -> dict[str, Any]:
        """Return the outcome as plain values, SI units."""
        return {
            "verdict": self.verdict,
            "missed": list(self.missed),
            "frames": self.frames,
            "marked": list(self.marked),
            "figures": dict(self.figures),
            "findings": list(self.findings),
            **{name: str(path) for name, path in self.paths.items()},
        }

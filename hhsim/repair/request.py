"""Request for the repair of one recording, and its outcome."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

from hhsim.recordings.content import ReadOptions
from hhsim.table.table import Table

MAX_CORRECTION = 0.015
"""Default of the largest displacement of a joint in a repaired frame [m]."""
REPORT, RESULT, PICTURE = "report.html", "result.h5", "worst.png"
"""Names of the files beside a repaired recording, see `RepairRequest.beside`."""


@dataclass(frozen=True)
class RepairRequest:
    """Recording to repair, and how."""

    recording: Path
    object: str  # name of the catalogue, or path of a mesh file, or of the TOML of bodies
    out: Path  # path of the repaired recording
    # File with the object's pose in each frame; None if the recording has them, or it stands still.
    object_poses: Path | None = None
    hand_file: Path | None = None  # hand of a recording of angles; None for the usual one
    unit: str | None = None  # unit of the mesh file; None for metres
    size: float | None = None  # largest extent that the mesh is scaled to [m]; None keeps it
    max_correction: float = MAX_CORRECTION  # largest displacement of a point of the hand [m]
    # Palm that stays outside: `fitted` to a MANO model's skin, or in proportion to the hand; half as `thin`; or `none`.
    palm: Literal["fitted", "thin", "none"] = "fitted"
    pictures: bool = True  # True writes the page and its pictures too
    of_both: Path | None = None  # recording of two hands of which this one is repaired; None for that of one hand
    # Hand, units and world of the recording, as far as the user states them.
    read: ReadOptions = field(default_factory=ReadOptions)

    @property
    def source(self) -> Path:
        """Recording as the user named it."""
        return self.of_both or self.recording

    def beside(self, name: str) -> Path:
        """Return the path of a file that is written beside the repaired recording, such as report.html."""
        return self.out.with_name(f"{self.out.stem}-{name}")


@dataclass(frozen=True)
class RepairOutcome:
    """Outcome of a repair whose recording is written."""

    figures: Mapping[str, float]  # figures by name, SI, such as pd_before and pd_after [m]
    frames: int  # number of frames
    marked: tuple[int, ...]  # frames that stay as they were, or that the user should look at
    verdict: str  # judgement in words
    ok: bool  # True if every limit is met
    findings: tuple[str, ...] = ()  # remarks of the reader and of the repair, a line each
    paths: Mapping[str, Path] = field(default_factory=dict)  # files that were written, by what they hold
    table: Table | None = None  # figures for people
    # Sentences on the object, which may be in another place than it was; with one, a limit is missed.
    doubts: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the outcome as plain values, SI units."""
        return {
            **{
                name: getattr(self, name)
                for name in ("verdict", "ok", "doubts", "frames", "marked", "figures", "findings")
            },
            **{name: str(path) for name, path in self.paths.items()},
        }


Repair: TypeAlias = Callable[[RepairRequest], RepairOutcome]
"""Function that repairs one recording; it raises HhsimError with one line if it cannot."""

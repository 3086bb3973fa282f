"""Request for the repair of one recording, and its outcome."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

from hhsim.motion.trajectory import HandSide
from hhsim.table.table import Table

MAX_CORRECTION = 0.015
"""Default of the largest displacement of a joint in a repaired frame [m]."""
REPORT, RESULT, PICTURE = "report.html", "result.h5", "worst.png"
"""Names of the files beside a repaired recording, see `RepairRequest.beside`."""


@dataclass(frozen=True)
class RepairRequest:
    """Recording to repair, and how.

    Attributes:
        object: Name of the catalogue, or path of a mesh file.
        out: Path of the repaired recording.
        object_poses: File with the object's pose in each frame; None if the recording has them, or it stands still.
        hand_file: Hand of a recording of angles; None for the usual one.
        mano_model: The user's own file of the MANO model.
        hand: Side of the hand; "" if the recording says it.
        unit: Unit of the mesh file; None for metres.
        size: Largest extent that the mesh is scaled to [m]; None keeps it.
        max_correction: Largest displacement of a point of the hand [m].
        skin: Vertices of the hand's skin in each frame, see `hhsim.repair.skin.read_skin`; None takes that of the MANO
            model, or our hand's cones.
        palm: Palm that stays outside: `fitted` to the skin, or else in proportion to the hand, half as
            `thin`, or `none`.
        of_both: Recording of two hands of which this one is repaired; None for that of one hand.
        options: Further fields of `hhsim.recordings.registry.ReadOptions`.
    """

    recording: Path
    object: str
    out: Path
    object_poses: Path | None = None
    hand_file: Path | None = None
    mano_model: Path | None = None
    hand: HandSide = ""
    unit: str | None = None
    size: float | None = None
    max_correction: float = MAX_CORRECTION
    skin: Path | None = None
    palm: Literal["fitted", "thin", "none"] = "fitted"
    of_both: Path | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def source(self) -> Path:
        """Recording as the user named it."""
        return self.of_both or self.recording

    def beside(self, name: str) -> Path:
        """Return the path of a file that is written beside the repaired recording, such as report.html."""
        return self.out.with_name(f"{self.out.stem}-{name}")


@dataclass(frozen=True)
class RepairOutcome:
    """Outcome of a repair whose recording is written.

    Attributes:
        figures: Figures by name, SI, such as pd_before and pd_after [m].
        frames: Number of frames.
        marked: Frames that stay as they were, or that the user should look at.
        verdict: Judgement in words.
        ok: True if every limit is met.
        findings: Remarks of the reader and of the repair, a line each.
        paths: Files that were written, by what they hold.
        table: Figures for people.
    """

    figures: Mapping[str, float]
    frames: int
    marked: tuple[int, ...]
    verdict: str
    ok: bool
    findings: tuple[str, ...] = ()
    paths: Mapping[str, Path] = field(default_factory=dict)
    table: Table | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the outcome as plain values, SI units."""
        return {
            **{name: getattr(self, name) for name in ("verdict", "ok", "frames", "marked", "figures", "findings")},
            **{name: str(path) for name, path in self.paths.items()},
        }


Repair: TypeAlias = Callable[[RepairRequest], RepairOutcome]
"""Function that repairs one recording; it raises HhsimError with one line if it cannot."""

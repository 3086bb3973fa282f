"""Request for the repair of one recording, and its outcome."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from hhsim.motion.trajectory import HandSide


@dataclass(frozen=True)
class RepairRequest:
    """Recording to repair, and how.

    Attributes:
        object: Name of the catalogue, or path of a mesh file.
        out: Path of the repaired recording.
        object_poses: File with the object's pose in each frame; None if the recording has them, or it stands still.
        mano_model: The user's own file of the MANO model.
        hand: Side of the hand; "" if the recording says it.
        unit: Unit of the mesh file; None for metres.
        size: Largest extent that the mesh is scaled to [m]; None keeps it.
        max_correction: Largest displacement of a point of the hand [m].
        palm: Shape of the palm.
        options: Further fields of `hhsim.recordings.registry.ReadOptions`.
    """

    recording: Path
    object: str
    out: Path
    object_poses: Path | None = None
    mano_model: Path | None = None
    hand: HandSide = ""
    unit: str | None = None
    size: float | None = None
    max_correction: float = 0.015
    palm: str = "usual"
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class RepairOutcome:
    """Outcome of a repair whose recording is written.

    Attributes:
        figures: Figures by name, SI, such as pd_before and pd_after [m].
        frames: Number of frames.
        marked: Frames that stay as they were, or that the user should look at.
        verdict: Judgement in words.
        ok: True if every limit is met.
        paths: Files that were written, by what they hold.
    """

    figures: Mapping[str, float]
    frames: int
    marked: tuple[int, ...]
    verdict: str
    ok: bool
    findings: tuple[str, ...] = ()
    paths: Mapping[str, Path] = field(default_factory=dict)


Repair: TypeAlias = Callable[[RepairRequest], RepairOutcome]
"""Function that repairs one recording; it raises HhsimError with one line if it cannot."""

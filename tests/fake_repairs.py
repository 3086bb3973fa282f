"""Repairs that copy a recording, which several test modules run in processes; its words say how they end."""

import os
import shutil
import time
from pathlib import Path

from hhsim.errors import MeshError, TrajectoryError
from hhsim.repair.request import PICTURE, REPORT, RepairOutcome, RepairRequest
from hhsim.sweep.repair_batch import BatchOutcome, run_manifest


def repaired(request: RepairRequest) -> RepairOutcome:
    """The recording as it is, with figures that its first number decides."""
    word, _, depth = request.recording.read_text().partition(" ")
    with (request.out.parent.parent / "log.txt").open("a") as log:
        log.write(f"{request.out.parent.name}\n")
    match word:
        case "refuse":
            raise TrajectoryError(f"{request.recording}: no\nrecording")
        case "mesh":
            raise MeshError("no inside")
        case "raise":
            raise KeyError("hand")
        case "crash":
            os._exit(3)
        case "hang":
            time.sleep(1e4)
        case "nothing":
            return RepairOutcome({}, 1, (), "unchanged", ok=True)
    shutil.copy(request.recording, request.out)
    if request.pictures:
        request.beside(REPORT).write_text("report")
        request.beside(PICTURE).write_bytes(b"picture")
    before = 1e-3 * float(depth)
    figures = {
        "depth_cones_max_before": before,
        "depth_cones_max_after": 1e-3 * before,
        "volume_exact_mean_before": 1e-6,
        "contacts_kept_5mm_after": 1.0 - 10 * before,
    }
    figures |= {"correction_max_after": 0.5 * before, "own_figure": float("nan"), "time_per_frame": 2e-3}
    missed = word == "miss"
    return RepairOutcome(
        figures, 30, (4, 7), "MISSED: 2 frames are deep" if missed else "REPAIRED", not missed, ("a finding",),
        {"recording": request.out},
    )  # fmt: skip


def write_manifest(folder: Path, *contents: str, more: str = "") -> Path:
    """Write recordings r0.txt, r1.txt, … of these contents, and the manifest of them all."""
    for number, content in enumerate(contents):
        (folder / f"r{number}.txt").write_text(content)
    path = folder / "manifest.toml"
    path.write_text(f'version = 1\n[[recording]]\nrecording = "r*.txt"\nobject = "cube"\n{more}')
    return path


def tree(folder: Path) -> dict[str, bytes]:
    """Every file of a folder and its bytes, but for lock and log."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name not in (".lock", "log.txt")]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def run(path: Path, out: Path, workers: int = 1) -> BatchOutcome:
    """Run the repairs of a manifest."""
    return run_manifest(path, out, repaired, workers=workers)

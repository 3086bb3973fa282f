"""Row of a cell in the table, or the reason of its failure: a small JSON file each."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hhsim.errors import InputError
from hhsim.replay.summary import ReplaySummary
from hhsim.solver.options import SolverOptions
from hhsim.sweep.cell import Cell
from hhsim.system import environment as info
from hhsim.system.atomic_write import write_atomically
from hhsim.system.input_file import read_input_text
from hhsim.system.plain_json import plain_json

FORMAT = "hhsim-cell"
VERSION = 1
FAILED = ".failed.json"
OF_THE_SCENE = (
    *("object", "object_mesh", "level", "max_error", "trajectory", "samples", "place_object", "hand_file"),
    *("tremor_mm_deg", "seed", "ticks"),
)
"""Statements of a result about its scene that a row repeats."""


def named(cell: Cell) -> dict[str, Any]:
    """Return the names that a plan gives a cell."""
    return {
        "object": cell.object.name,
        "motion": cell.motion.name,
        "method": cell.method,
        "surface": cell.surface,
        "options": cell.options_name,
        "seed": cell.seed,
    }


def row_of(
    cell: Cell,
    digest: str,
    summary: ReplaySummary,
    scene: Mapping[str, Any],
    options: SolverOptions,
    *,
    result: str | None,
    own_core: bool,
    seconds: float,
    repeated: Mapping[str, Any],
) -> dict[str, Any]:
    """Make the row of a finished cell.

    Args:
        scene: Description of the scene in the result.
        options: Options of the run.
        result: Name of the result's file; None if it is not kept.
        own_core: True if its ticks had a core of their own, so that its times can be compared.
        seconds: Duration of all of it.
        repeated: Mean and deviation of its times, `hhsim.replay.repeated_times.repeated_document`; empty for one run.
    """
    attributes = info.file_attributes()
    return {
        "format": FORMAT,
        "version": VERSION,
        "digest": digest,
        "cell": named(cell),
        "result": result,
        "own_core": own_core,
        "seconds": seconds,
        **({"repeated": repeated} if repeated else {}),
        "scene": {
            **{name: scene.get(name) for name in OF_THE_SCENE},
            "rate": 1.0 / options.period,
            "solver": options.to_json(),
        },
        "verdict": summary.verdict.word,
        "missed": list(summary.verdict.missed),
        "summary": summary.attributes(),
        "notes": list(summary.notes),
        **{
            name: json.loads(str(value)) if name in ("machine", "packages") else value
            for name, value in attributes.items()
        },
    }


def failure_of(cell: Cell, digest: str, reason: str) -> dict[str, Any]:
    """Make the document of a cell that failed."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "digest": digest,
        "cell": named(cell),
        "reason": reason,
        "machine": asdict(info.machine()),
    }


def write_row(path: Path, row: Mapping[str, Any]) -> None:
    """Write a row, or a failure, in one step; NaN and infinity become null. OutputError if it cannot be written."""
    write_atomically(path, (json.dumps(plain_json(row), indent=1, sort_keys=True, allow_nan=False) + "\n").encode())


def read_row(path: Path) -> dict[str, Any]:
    """Read a row, or a failure; raise InputError for a missing or another file."""
    try:
        found = json.loads(read_input_text(path))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: no row of a sweep: {error}") from None
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise InputError(f"{path}: no row of a sweep")
    if found.get("version") != VERSION:
        raise InputError(f"{path}: version {found.get('version')!r} of a row, this hhsim reads {VERSION}")
    return found

"""Section of a report on the worst ticks: the hand at that moment, the tick's figures, and how to see it."""

import shlex
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from hhsim.errors import InputError
from hhsim.render.viewpoint import View
from hhsim.report.figure import Album, PageFigure
from hhsim.report.pictures import hand_picture, overview_view
from hhsim.report.run import ReportRun
from hhsim.report.worst_ticks import WorstTick, worst_ticks
from hhsim.result.reader import Result
from hhsim.table.table import Table, number, shown, words
from hhsim.view.status_text import status_words

KINDS = {"slowest": "slowest", "deepest": "deepest", "force-step": "largest step of the force", "lag": "largest lag"}
"""Why a tick was chosen, in words."""
FACTS = {
    "duration/total_cpu": ("CPU time", "µs", 1e-3, 1),
    "duration/total": ("wall time", "µs", 1e-3, 1),
    "duration/detect": ("of it detection", "µs", 1e-3, 1),
    "duration/palm": ("of it palm or whole hand", "µs", 1e-3, 1),
    "duration/fingers": ("of it fingers", "µs", 1e-3, 1),
    "duration/force": ("of it forces", "µs", 1e-3, 1),
    "contacts/candidates": ("candidate pairs", "", 1.0, 0),
    "contacts/touching": ("touching pairs", "", 1.0, 0),
    "penetration_depth": ("penetration", "µm", 1e6, 3),
    "force_variation_rate": ("force change", "%", 1.0, 3),
    "lag": ("lag", "mm", 1e3, 3),
    "work/linearisations": ("linearisations", "", 1.0, 0),
    "work/qp_iterations": ("QP iterations", "", 1.0, 0),
    "work/pair_tests": ("exact distances", "", 1.0, 0),
}
"""Datasets of a tick: label, unit, scale to that unit, and digits."""


def worst_cards(run: ReportRun, album: Album) -> list[dict[str, Any]]:
    """Return a card for each worst tick of a result, by the names of the template."""
    found: dict[int, list[WorstTick]] = {}
    for worst in worst_ticks(run.result):
        found.setdefault(worst.tick, []).append(worst)
    usual = None
    # Each card says why it has no picture.
    with suppress(InputError):
        usual = overview_view(run.result) if found else None
    return [_card(run, tick, worsts, usual, album) for tick, worsts in found.items()]


def tick_facts(result: Result, tick: int) -> list[tuple[str, str, str]]:
    """Return label, figure and unit of what a file says of a tick."""
    values = result.at(tick, [*FACTS, "time", "status", "force/total"])
    rows = [
        ("time", f"{float(values['time']):,.3f}", "s"),
        ("phase", result.phase_at(tick) or "—", ""),
        ("how it ended", status_words(int(values["status"])), ""),
    ]
    for name, (label, unit, scale, digits) in FACTS.items():
        rows.append((label, shown(scale * float(values[name]), digits), unit))
        if name == "penetration_depth":
            rows.append(("force", shown(float(np.linalg.norm(values["force/total"])), 3), "N"))
    return rows


def _card(run: ReportRun, tick: int, worsts: Sequence[WorstTick], usual: View | None, album: Album) -> dict[str, Any]:
    picture: PageFigure | str
    try:
        picture = album.shown(hand_picture(run.result, tick, usual=usual), run.prefix)
    except InputError as error:
        picture = f"No picture: {error}"
    columns = words("figure", 0), number("hhsim", 1), words("unit", 2)
    return {
        "title": f"Tick {tick:,}: {', '.join(KINDS[worst.kind] for worst in worsts)}",
        "sentences": [worst.sentence for worst in worsts],
        "picture": picture,
        "facts": Table(columns, tick_facts(run.result, tick), f"Tick {tick:,} in figures"),
        "command": f"hhsim view {shlex.quote(run.result.path.name)}",
        "tick": f"{tick:,}",
    }

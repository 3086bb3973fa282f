"""Ticks of a result that a reader wants to see: slowest, deepest, largest step of the force, largest lag."""

import shlex
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from hhsim.errors import InputError
from hhsim.metrics.run_ticks import HOLD
from hhsim.render.viewpoint import View
from hhsim.report.figure import Album, PageFigure
from hhsim.report.pictures import hand_picture, overview_view
from hhsim.report.run import ReportRun
from hhsim.result.reader import Result
from hhsim.result.schema import LIVE_TICK
from hhsim.table.table import Table, number, shown, words
from hhsim.view.scene_log import status_words

WorstKind = Literal["slowest", "deepest", "force-step", "lag"]


@dataclass(frozen=True)
class WorstTick:
    """A tick, the first of several equal ones, why it was chosen, and a sentence on what happened."""

    kind: WorstKind
    tick: int
    sentence: str


def worst_ticks(result: Result) -> list[WorstTick]:
    """Return at most one tick of each kind, none of what did not happen."""
    if result.ticks == 0:
        return []
    values: dict[WorstKind, np.ndarray] = {
        "slowest": 1e-9 * result["duration/total_cpu"],
        "deepest": result["penetration_depth"],
        "force-step": _force_steps(result),
        "lag": result["lag"],
    }
    found = []
    for kind, sizes in values.items():
        known = np.where(np.isfinite(sizes), sizes, 0.0)
        tick = int(np.argmax(known))
        if known[tick] > 0.0:
            found.append(WorstTick(kind, tick, _sentence(result, kind, tick, float(known[tick]), known)))
    return found


def _force_steps(result: Result) -> np.ndarray:
    """Return the one-tick change of the total force [N], shape (T,), as `hhsim.metrics.metrics.force_step` does.

    It is 0 in holds and wherever the tick before is not in the file.
    """
    moving = np.ones(result.ticks, bool)
    moving[0] = False
    for phase in result.phases:
        if phase.name == HOLD:
            moving[phase.first_tick : phase.last_tick + 1] = False
    if result.live is not None:
        moving[1:] &= np.diff(result[f"{LIVE_TICK}/record"]) == 1
    steps = np.zeros(result.ticks)
    steps[1:] = np.linalg.norm(np.diff(result["force/total"], axis=0), axis=1)
    return np.where(moving, steps, 0.0)


def _sentence(result: Result, kind: WorstKind, tick: int, value: float, values: np.ndarray) -> str:
    phase = result.phase_at(tick)
    where = f"tick {tick:,} at {result['time'][tick]:.3f} s" + (f", {phase}" if phase else "")
    if kind == "slowest":
        # Of the ticks that the table's median is of.
        contact = result["contacts/candidates"] > 0
        median = float(np.median(values[contact])) if contact.any() else 0.0
        ratio = f", {value / median:.1f} times the median of ticks in contact" if median > 0.0 else ""
        return f"The slowest tick took {1e6 * value:,.1f} µs of CPU time{ratio}: {where}."
    if kind == "deepest":
        return f"The deepest penetration is {1e6 * value:,.3f} µm: {where}."
    if kind == "force-step":
        return f"The total force changed most in one tick of motion, by {value:.3f} N: {where}."
    return f"The hand lagged most, {1e3 * value:.2f} mm behind what was asked: {where}."


KINDS = {"slowest": "slowest", "deepest": "deepest", "force-step": "largest step of the force", "lag": "largest lag"}
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

"""Rows of the table of a live session."""

from collections.abc import Mapping
from typing import Any

from hhsim.metrics.run.registry import run_metrics
from hhsim.metrics.run_metric import Figure
from hhsim.metrics.session_faults import MISSED_BY, SESSION_TIMES
from hhsim.replay.summary_table import SummaryRow
from hhsim.result.safety import WORDS, Safety

SESSION_FIGURES: tuple[Figure, ...] = (
    Figure("ticks", "ticks with a hand"),
    *(figure for time in SESSION_TIMES for figure in (time, *(MISSED_BY if time.name == "missed" else ()))),
    Figure("ticks_in_contact", "ticks with candidate pairs"),
    run_metrics()["candidates_max"],
    Figure("force_max", "force, most", 2, "N"),
    Figure("ticks_with_resistance", "ticks that resist a finger"),
    *(Figure(f"kept_free_{why.name.lower()}", f"ticks with free fingers: {WORDS[why]}") for why in Safety if why.name),
    run_metrics()["stuck_ticks"],
    run_metrics()["lag_ticks"],
    Figure("samples_used", "samples used"),
    Figure("samples_superseded", "samples that a newer one replaced"),
    run_metrics()["penetration_max"],
    *(Figure(f"lost_{ring}", f"{ring} that the recorder lost") for ring in ("ticks", "samples", "events")),
)
"""Figures of a session's /summary, in the table's order."""


def session_rows(figures: Mapping[str, Any]) -> tuple[SummaryRow, ...]:
    """Return the table rows of a session's figures by name, SI units; reasons and causes with count 0 are left out."""
    return tuple(
        SummaryRow(figure, float(figures[figure.name]))
        for figure in SESSION_FIGURES
        if figure.name in figures and (figures[figure.name] or not figure.name.startswith(("kept_free_", "missed_")))
    )

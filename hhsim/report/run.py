"""One result of a report, with what is computed of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hhsim.live.session.summary_table import session_rows
from hhsim.metrics.session_faults import broken_off
from hhsim.replay.summary_table import SummaryRow
from hhsim.replay.verdict import MISSED, OK, Verdict, checked_figures, read_ticks, verdict
from hhsim.report.labels import UNNAMED, result_labels
from hhsim.report.posed_result import PosedResult, posed_result
from hhsim.report.ticks import PHASE_COLUMNS, finger_figures, phase_figures
from hhsim.result.reader import Result
from hhsim.result.wording import motion_name, object_name


@dataclass(frozen=True)
class ReportRun:
    """One result."""

    result: PosedResult  # the file, with depths of its poses
    label: str
    prefix: str  # begin of the names of its pictures and anchors
    rows: tuple[SummaryRow, ...]  # the table that replay prints
    misstated: str  # sentence on figures of the file that are not those of its ticks; else ""
    # Table of a live session; empty for a replay, and where the recording was cut short.
    session: tuple[SummaryRow, ...]
    phases: tuple[dict[str, Any], ...]
    fingers: tuple[dict[str, Any], ...]
    verdict: Verdict  # verdict by the gate's default limits

    @property
    def ended(self) -> str:
        """Cause of the end of a session that did not end in order, in a few words; else ""."""
        why = broken_off(self.result)
        return f"ended: {why}" if why else ""

    @property
    def mood(self) -> str:
        """Class of the verdict: good, bad or note."""
        return {OK: "good", MISSED: "bad"}.get(self.verdict.word, "note")

    def row(self, name: str) -> SummaryRow | None:
        """Return a line of the table by its figure's name."""
        return next((row for row in self.rows if row.name == name), None)

    @property
    def letter(self) -> str:
        """Letter of the label."""
        return self.label.partition(":")[0]

    @property
    def name(self) -> str:
        """Object, motion and method."""
        return f"{object_name(self.result)}, {motion_name(self.result)}, {self.result.method or UNNAMED}"


def report_runs(results: Sequence[Result]) -> list[ReportRun]:
    """Compute what a report says of each result, with depths of the poses; several are labelled by letters."""
    return [
        _run(posed_result(result), label, "" if len(results) == 1 else f"{label.partition(':')[0].lower()}-")
        for result, label in zip(results, result_labels(results))
    ]


def _run(result: PosedResult, label: str, prefix: str) -> ReportRun:
    ticks = read_ticks(result, PHASE_COLUMNS)
    rows, misstated = checked_figures(result, ticks)
    return ReportRun(
        result=result,
        label=label,
        prefix=prefix,
        rows=rows,
        misstated=misstated,
        session=() if result.live is None else session_rows(result.summary),
        phases=tuple(phase_figures(result, ticks)),
        fingers=tuple(finger_figures(result, ticks)),
        verdict=verdict(result, rows),
    )

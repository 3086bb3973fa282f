"""Rows of the gate for people and CI systems: table and Markdown."""

import math
from collections import Counter
from collections.abc import Sequence

from hhsim.gate.gate import GateReport
from hhsim.gate.verdict import UNJUDGED, WORSE_WITHIN, GateRow
from hhsim.table.table import Table, markdown_text, number, shown, unit_size, words
from hhsim.table.verdict import NOT_COMPARABLE, SAME, WORSE

OK, MISSED = "ok", "MISSED"
LIMIT_ONLY = "limit only"
"""Word of a figure that has a limit and no base."""


def number_text(value: float, unit: str = "") -> str:
    """Return a stored number as tables show it in `unit`; "—" for none."""
    shown_value = value / unit_size(unit)
    return "0.000" if 0.0 < abs(shown_value) < 1e-9 else shown(shown_value)


def headline(report: GateReport) -> str:
    """Return the verdict in one line."""
    missed, refused = len(report.missed), len(report.refused)
    unlike = sum(row.verdict == NOT_COMPARABLE for row in report.rows)
    judged = sum(_state(row) in (OK, MISSED) for row in report.rows)
    parts = [f"{refused} cannot be run"] if refused else []
    parts += [f"{missed} of {judged} figures missed their limit"] if missed else []
    parts += [f"{unlike} cannot be compared"] if unlike else []
    if report.verdict == WORSE_WITHIN:
        worse = [row.name for row in report.rows if row.kind == "error" and row.verdict == WORSE]
        compared = sum(bool(row.verdict) and not math.isnan(row.base) for row in report.rows)
        parts += [f"{len(worse)} of {compared} figures compared ({', '.join(dict.fromkeys(worse))})"]
    within = "all within their limits" if judged else "none has a limit and a value"
    outcome = "; ".join(parts) or f"{judged} of {len(report.rows)} figures judged, {within}"
    word = f"{report.verdict}: " if report.verdict else ""
    return f"{word}{outcome}{f', against {report.against}' if report.against else ''}"


def reasons(rows: Sequence[GateRow]) -> list[str]:
    """Return a line for each row with a reason."""
    told = (row for row in rows if row.reason and not _has_no_value(row))
    return [f"{row.scene}, {row.label}: {row.reason}{_how_far(row)}" for row in told]


def not_judged(report: GateReport) -> list[str]:
    """Return a line for a scene's limits on figures that it does not have."""
    found: dict[tuple[str, str], list[str]] = {}
    for row in filter(_has_no_value, report.rows):
        found.setdefault((row.scene, row.reason), []).append(row.name)
    return [f"{scene}: limit on {', '.join(names)} not judged: {why}" for (scene, why), names in found.items()]


def _has_no_value(row: GateRow) -> bool:
    return row.passed and math.isnan(row.head) and not math.isnan(row.limit)


def _how_far(row: GateRow) -> str:
    if row.passed or math.isnan(row.head) or math.isnan(row.limit):
        return ""
    head, limit = (number_text(value, row.unit) for value in (row.head, row.limit))
    return f" ({head}, limit {limit}{row.unit and ' '}{row.unit})"


def worth_showing(report: GateReport) -> list[GateRow]:
    """Return the rows that are missed, changed, new, or could not be run or compared."""
    told = [row for row in report.rows if row.reason and row.kind in ("inputs", "bits")]
    return [row for row in report.rows if not row.passed or row.verdict not in (SAME, "") or row in told]


def left_out(report: GateReport) -> str:
    """Return the number of other rows by their word; "" for none."""
    shown = worth_showing(report)
    rest = [row for row in report.rows if row not in shown and not _has_no_value(row)]
    names = dict.fromkeys(row.name for row in rest if not _word(row))
    free = f"without a limit ({', '.join(names)})"
    return ", ".join(f"{count} {word or free}" for word, count in Counter(map(_word, rest)).most_common())


def markdown(report: GateReport) -> str:
    """Return a summary for a pull request: changed and missed rows in a table, the rest folded."""
    sign = {0: "✅", 3: "⚠️"}.get(report.exit_code, "❌")
    lines = [f"## {sign} hhsim gate", "", markdown_text(headline(report)), ""]
    shown = worth_showing(report)
    if shown:
        lines += [Table(COLUMNS, shown).markdown(), ""]
    lines += [f"- {markdown_text(reason)}" for reason in [*reasons(report.rows), *not_judged(report), *report.notes]]
    folded = [row for row in report.rows if row not in shown]
    if folded:
        rest = left_out(report) or "not judged"
        lines += ["", f"<details><summary>{rest}</summary>", "", Table(COLUMNS, folded).markdown(), "", "</details>"]
    return "\n".join(lines) + "\n"


def _state(row: GateRow) -> str:
    if not row.passed:
        return MISSED
    if row.verdict in UNJUDGED:
        return ""
    judged = row.kind in ("inputs", "bits", "counter", "time") or not (math.isnan(row.limit) or math.isnan(row.head))
    return OK if judged else ""


def _word(row: GateRow) -> str:
    return row.verdict or (LIMIT_ONLY if _state(row) and math.isnan(row.base) and not math.isnan(row.limit) else "")


COLUMNS = (
    words("scene"),
    words("figure", "label"),
    number("head", lambda row: number_text(row.head, row.unit)),
    number("base", lambda row: number_text(row.base, row.unit)),
    number("limit", lambda row: number_text(row.limit, row.unit)),
    words("unit"),
    words("verdict", _word),
    words("outcome", _state),
)
"""Columns of the gate's rows."""

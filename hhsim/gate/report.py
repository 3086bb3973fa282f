"""The gate's rows as people and CI systems read them: cells of a table, Markdown, JUnit XML."""

import math
import re
from collections.abc import Sequence
from xml.etree import ElementTree

from hhsim.gate.gate import GateReport
from hhsim.gate.verdict import GateRow

HEADINGS = ("scene", "figure", "head", "base", "limit", "unit", "verdict", "outcome")
NUMBERS = ("head", "base", "limit")
OK, MISSED = "ok", "MISSED"


def cells(row: GateRow) -> tuple[str, ...]:
    """One row under `HEADINGS`."""
    numbers = (number(getattr(row, name) / row.scale) for name in NUMBERS)
    return (row.scene, row.label, *numbers, row.unit, row.verdict, _state(row))


def number(value: float) -> str:
    """A number as tables show it: whole ones in full, others with four digits; "—" for none."""
    if not math.isfinite(value):
        return "—" if math.isnan(value) else str(value)
    if value == round(value) and abs(value) < 1e12:
        return f"{round(value):,}"
    if abs(value) < 1e-9:
        return "0.000"
    return f"{value:.4g}"


def headline(report: GateReport) -> str:
    """The verdict in one line."""
    missed, unlike = len(report.missed), sum(row.verdict == "not comparable" for row in report.rows)
    judged = sum(_state(row) in (OK, MISSED) for row in report.rows)
    parts = [f"{missed} of {judged} figures missed their limit"] if missed else []
    parts += [f"{unlike} cannot be compared"] if unlike else []
    # What has no limit, or no value, is within none.
    within = "all within their limits" if judged else "none has a limit and a value"
    outcome = "; ".join(parts) or f"{judged} of {len(report.rows)} figures judged, {within}"
    word = f"{report.verdict}: " if report.verdict else ""
    return f"{word}{outcome}{f', against {report.against}' if report.against else ''}"


def reasons(rows: Sequence[GateRow]) -> list[str]:
    """A line for each row that a reader has to know more of."""
    return [f"{row.scene}, {row.label}: {row.reason}{_how_far(row)}" for row in rows if row.reason]


def _how_far(row: GateRow) -> str:
    if row.passed or math.isnan(row.head) or math.isnan(row.limit):
        return ""
    return f" ({number(row.head / row.scale)}, limit {number(row.limit / row.scale)}{row.unit and ' '}{row.unit})"


def worth_showing(report: GateReport) -> list[GateRow]:
    """Rows that are not plainly as they were: missed, changed, or without a base."""
    return [row for row in report.rows if not row.passed or row.verdict not in ("same", "")]


def markdown(report: GateReport) -> str:
    """A summary for a pull request: what changed or was missed in a table, all the rest folded away."""
    sign = {0: "✅", 1: "❌", 3: "⚠️"}[report.exit_code]
    lines = [f"## {sign} hhsim gate", "", _escaped(headline(report)), ""]
    shown = worth_showing(report)
    if shown:
        lines += [*_table(shown), ""]
    lines += [f"- {_escaped(reason)}" for reason in [*reasons(report.rows), *report.notes]]
    folded = [row for row in report.rows if row not in shown]
    if folded:
        summary = f"<summary>{len(folded)} figures as before, or with nothing to compare them with</summary>"
        lines += ["", f"<details>{summary}", "", *_table(folded), "", "</details>"]
    return "\n".join(lines) + "\n"


def junit(report: GateReport) -> bytes:
    """JUnit XML: a suite for each scene, a case for each figure; what cannot be compared is an error."""
    root = ElementTree.Element("testsuites", name="hhsim gate")
    for scene in dict.fromkeys(row.scene for row in report.rows):
        rows = [row for row in report.rows if row.scene == scene]
        failures, errors = sum(not row.passed for row in rows), sum(_unlike(row) for row in rows)
        counts = {"tests": str(len(rows)), "failures": str(failures), "errors": str(errors)}
        suite = ElementTree.SubElement(root, "testsuite", {"name": scene, **counts})
        for row in rows:
            case = ElementTree.SubElement(suite, "testcase", classname=f"hhsim.gate.gate.{scene}", name=row.name)
            text = " | ".join(cells(row)[1:7]) + (f" | {row.reason}" if row.reason else "")
            if not row.passed:
                ElementTree.SubElement(case, "failure", message=row.reason or row.verdict).text = text
            elif _unlike(row):
                ElementTree.SubElement(case, "error", message=row.reason or row.verdict).text = text
            else:
                ElementTree.SubElement(case, "system-out").text = text
    for element in root.iter():
        element.attrib.update({name: _legal(value) for name, value in element.items()})
        element.text = _legal(element.text or "") or None
    ElementTree.indent(root)
    document: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return document + b"\n"


def _legal(text: str) -> str:
    """Text without what XML cannot hold, such as the colours that a program gives its last words."""
    return re.sub("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "?", text)


def _state(row: GateRow) -> str:
    if not row.passed:
        return MISSED
    if _unlike(row):
        return ""
    judged = row.kind in ("inputs", "counter", "time") or not (math.isnan(row.limit) or math.isnan(row.head))
    return OK if judged else ""


def _unlike(row: GateRow) -> bool:
    return row.verdict == "not comparable"


def _table(rows: Sequence[GateRow]) -> list[str]:
    align = ["---:" if heading in NUMBERS else "---" for heading in HEADINGS]
    head = [f"| {' | '.join(HEADINGS)} |", f"|{'|'.join(align)}|"]
    return head + [f"| {' | '.join(_escaped(cell) for cell in cells(row))} |" for row in rows]


def _escaped(text: str) -> str:
    """Text that Markdown shows as it is."""
    kept = text.replace("&", "&amp;").replace("<", "&lt;").replace("|", "\\|").replace("\n", " ")
    return kept.replace("_", "\\_").replace("*", "\\*").replace("`", "'")

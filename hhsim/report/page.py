"""The page of a report: its parts in order, and what stands above them."""

from collections.abc import Sequence

from hhsim import __version__
from hhsim.replay.verdict import MISSED, OK
from hhsim.report.compare import Comparison
from hhsim.report.html import Html, element, joined, listed, page, paragraph
from hhsim.report.provenance import motion_name, object_name
from hhsim.report.run import ReportRun
from hhsim.report.style import STYLE

GENERATOR = "hhsim report"
"""What the page says it was made by; files that do not are not replaced."""
MOODS = {OK: "good", MISSED: "bad"}
"""Class of a verdict by its word."""


def title_of(runs: Sequence[ReportRun], tables: Sequence[str]) -> str:
    """What a report is of, in a line.

    Args:
        runs: Its results.
        tables: Suites of its bench tables.
    """
    parts = []
    if len(runs) == 1:
        parts.append(runs[0].name)
    elif runs:
        scenes = dict.fromkeys(f"{object_name(run.result)}, {motion_name(run.result)}" for run in runs)
        methods = ", ".join(run.label for run in runs)
        parts.append(f"{next(iter(scenes))}: {methods}" if len(scenes) == 1 else f"{len(runs)} results: {methods}")
    parts += [f"hhsim bench {suite}" for suite in tables]
    return "; ".join(parts)


def report_page(
    title: str,
    runs: Sequence[ReportRun],
    comparisons: Sequence[Comparison],
    sections: Sequence[tuple[str, str, Html]],
) -> str:
    """The document.

    Args:
        title: Of the page.
        runs: Results.
        comparisons: Of each but the first one with the first one.
        sections: Anchor, heading and markup of each part.
    """
    links = listed(element("a", heading, href=f"#{name}") for name, heading, _ in sections)
    header = element(
        "header",
        element("h1", title),
        paragraph(_subtitle(runs), class_="soft") if runs else Html(""),
        *(_verdict(run, alone=len(runs) == 1) for run in runs),
        *(_compared(run, comparison) for run, comparison in zip(runs[1:], comparisons)),
        element("nav", links, aria_label="Contents"),
    )
    footer = element(
        "footer",
        paragraph(
            f"Made by hhsim report, version {__version__}, from what the files hold. Depths are into the spheres that "
            "stand for the object; hhsim verify checks every claim by other code, and against the true mesh."
        ),
    )
    main = element("main", joined(markup for _, _, markup in sections))
    return page(title, STYLE, f"{GENERATOR} {__version__}", header, main, footer)


def _subtitle(runs: Sequence[ReportRun]) -> str:
    if len(runs) > 1:
        return "; ".join(f"{run.label} is {run.result.path.name}" for run in runs)
    result = runs[0].result
    kind = "a recorded session" if result.live is not None else "a replay"
    return f"{result.path.name}, {kind} of {result.ticks:,} ticks, written {result.created_utc}"


def _verdict(run: ReportRun, *, alone: bool) -> Html:
    found = run.verdict
    who = [] if alone else [element("b", run.label), " "]
    text = " ".join(found.sentences)
    mood = MOODS.get(found.word, "note")
    return paragraph(*who, element("strong", found.word), text, class_=f"verdict {mood}")


def _compared(run: ReportRun, comparison: Comparison) -> Html:
    how = f" They differ in {'; '.join(comparison.how)}." if comparison.how else ""
    return paragraph(element("b", f"{run.label} beside the first: "), comparison.sentence(), how)

"""The page of a report: its parts in order, and what stands above them."""

from collections.abc import Sequence

from hhsim import __version__
from hhsim.metrics.session_faults import how_it_ended
from hhsim.report.html import Html, element, joined, listed, page, paragraph
from hhsim.report.key_table import MOODS
from hhsim.report.provenance import motion_name, object_name
from hhsim.report.run import ReportRun
from hhsim.report.style import STYLE
from hhsim.system.counted import counted

MOST_NAMED = 4
"""Results, or scenes, that the title names."""
GENERATOR = "hhsim report"
"""What the page says it was made by; files that do not are not replaced."""


def title_of(runs: Sequence[ReportRun], tables: Sequence[str]) -> str:
    """What a report is of, in a line.

    Args:
        tables: Suites of its bench tables.
    """
    parts = []
    if len(runs) == 1:
        parts.append(runs[0].name)
    elif runs:
        scenes = list(dict.fromkeys(f"{object_name(run.result)}, {motion_name(run.result)}" for run in runs))
        # Of several scenes the labels repeat object and motion: they are told below, and the scenes here.
        named = [run.label for run in runs] if len(scenes) == 1 else scenes
        shown = "; ".join([*named[:MOST_NAMED], *(["…"] if len(named) > MOST_NAMED else [])])
        parts.append(f"{scenes[0]}: {shown}" if len(scenes) == 1 else f"{len(runs)} results: {shown}")
    parts += [f"hhsim bench {suite}" for suite in tables]
    return "; ".join(parts)


def report_page(
    title: str,
    runs: Sequence[ReportRun],
    sections: Sequence[tuple[str, str, Html]],
) -> str:
    """The document.

    Args:
        sections: Anchor, heading and markup of each part.
    """
    links = listed(element("a", heading, href=f"#{name}") for name, heading, _ in sections)
    alone = len(runs) == 1
    header = element(
        "header",
        element("h1", title),
        paragraph(_subtitle(runs), class_="soft") if runs else Html(""),
        *(_contradiction(run, run.ended, "", alone=alone) for run in runs if run.ended),
        *((_verdict(runs[0]),) if alone else ()),
        *(_contradiction(run, *said, alone=alone) for run in runs for said in _contradictions(run)),
        element("nav", links, aria_label="Contents"),
    )
    footer = element(
        "footer",
        paragraph(
            f"Made by hhsim report, version {__version__}, from what the files hold.",
            " Depths are of the poses in them, and into what of the object the hand touched, its spheres or its mesh; "
            "hhsim verify checks every claim by other code, and against the true mesh."
            if runs
            else "",
        ),
    )
    main = element("main", joined(markup for _, _, markup in sections))
    return page(title, STYLE, f"{GENERATOR} {__version__}", header, main, footer)


def _subtitle(runs: Sequence[ReportRun]) -> str:
    if len(runs) > 1:
        return f"{len(runs)} results, each beside {runs[0].letter}"
    result = runs[0].result
    kind = "a recorded session" if result.live is not None else "a replay"
    ended = how_it_ended(result)
    text = f"{result.path.name}, {kind} of {counted(result.ticks, 'tick')}, written {result.created_utc}"
    return f"{text}, ended: {ended}" if ended else text


def _verdict(run: ReportRun) -> Html:
    found = run.verdict
    mood = MOODS.get(found.word, "note")
    return paragraph(element("strong", found.word), " ".join(found.sentences), class_=f"verdict {mood}")


def _contradictions(run: ReportRun) -> list[tuple[str, str]]:
    found = (("depth misstated", run.result.contradiction()), ("figures misstated", run.misstated))
    return [(what, text) for what, text in found if text]


def _contradiction(run: ReportRun, what: str, text: str, *, alone: bool) -> Html:
    who = [] if alone else [element("b", run.label), ". "]
    return paragraph(*who, element("strong", what), text, class_="verdict bad")

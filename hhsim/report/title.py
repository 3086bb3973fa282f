"""The title of a report."""

from collections.abc import Sequence

from hhsim.metrics.session_faults import how_it_ended
from hhsim.report.provenance import motion_name, object_name
from hhsim.report.run import ReportRun
from hhsim.system.counted import counted

MOST_NAMED = 4
"""Most results, or scenes, that the title names."""


def title_of(runs: Sequence[ReportRun], tables: Sequence[str]) -> str:
    """Return what a report is of, in a line; `tables` are the suites of its bench tables."""
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


def subtitle_of(runs: Sequence[ReportRun]) -> str:
    """Return what the results are, in a line below the title."""
    if len(runs) > 1:
        return f"{len(runs)} results, each beside {runs[0].letter}"
    result = runs[0].result
    kind = "a recorded session" if result.live is not None else "a replay"
    ended = how_it_ended(result)
    text = f"{result.path.name}, {kind} of {counted(result.ticks, 'tick')}, written {result.created_utc}"
    return f"{text}, ended: {ended}" if ended else text

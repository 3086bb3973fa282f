"""Whether this machine can keep a loop's rate, and if not, who takes the time: `hhsim doctor`.

The verdict is that of measured wake-ups alone, by the limits below. What the system is set to only says what to change.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hhsim.live.real_time import RealTimeWishes, described
from hhsim.live.wakeups import Wakeups, measure_wakeups
from hhsim.result.miss_cause import WORDS, MissCause, by_name
from hhsim.system.scheduling_facts import SchedulingFact, scheduling_facts

MOST_MISSED = 1e-3
"""Share of the periods: of a thread that does nothing but wait, so that a loop has the rest of its period to work."""
MOST_LATE = 0.25
"""Of a period, which 99 of 100 wake-ups do not exceed: a tick and its commands still fit into what is left of it."""
MOST_IN_A_ROW = 9
"""A session frees the fingers at ten (`SafetyLimits.overruns`)."""
ONE_ALONE = 1
"""So many missed periods are let pass, however few there are in all: a short look cannot tell one from none."""
QUICK_SECONDS = 0.3
EDGES_US = (10, 20, 50, 100, 200, 500, 1_000, 2_000, 5_000, 10_000)
"""Between the bars of the histogram [µs]."""


@dataclass(frozen=True)
class Measure:
    """One figure that has a limit.

    Attributes:
        name: Of what.
        value: In the unit of `unit`.
        limit: What is let pass.
        unit: "%", "µs" or "" for a count.
        digits: After the point, where it is shown.
    """

    name: str
    value: float
    limit: float
    unit: str
    digits: int

    @property
    def kept(self) -> bool:
        """Whether the limit is kept."""
        return self.value <= self.limit


@dataclass(frozen=True)
class Diagnosis:
    """What was measured, what the system is set to, and what follows.

    Attributes:
        wakeups: As measured.
        facts: What the system is set to.
    """

    wakeups: Wakeups
    facts: list[SchedulingFact]

    @property
    def measures(self) -> tuple[Measure, ...]:
        """The figures by which it is judged."""
        return judged(self.wakeups)

    @property
    def good(self) -> bool:
        """Whether every limit is kept."""
        return all(measure.kept for measure in self.measures)

    @property
    def verdict(self) -> str:
        """In a sentence, with who took the time of missed periods."""
        rate = f"{self.wakeups.rate:,g} Hz"
        if self.good:
            return f"this machine keeps {rate}: {_missed(self.wakeups)}"
        # The first measure is of the missed periods, which are told with who took their time.
        beyond = [f"{measure.name} {shown(measure)}" for measure in self.measures[1:] if not measure.kept]
        return f"this machine does not keep {rate}: {', '.join([*beyond, _missed(self.wakeups)])}"

    @property
    def advice(self) -> list[str]:
        """What to change, the most telling first; empty where every limit is kept."""
        if self.good:
            return []
        settings = [fact.advice for fact in self.facts if fact.advice]
        return [*_of_causes(self.wakeups), *self.wakeups.mode["refused"], *settings]

    def to_json(self) -> dict[str, Any]:
        """All of it, SI units."""
        wakeups = self.wakeups
        return {
            "good": self.good,
            "verdict": self.verdict,
            "rate": wakeups.rate,
            "periods": wakeups.periods,
            "missed": wakeups.missed,
            "missed_in_a_row": wakeups.streak,
            "missed_by": by_name(wakeups.causes.values()),
            **{f"wakeup_{name}": wakeups.percentile(percent) for name, percent in PERCENTS.items()},
            "histogram": [
                {"above": low / 1e6, "up_to": None if high is None else high / 1e6, "count": count}
                for low, high, count in histogram(wakeups)
            ],
            "run_delay": None if wakeups.run_delay is None else 1e-9 * wakeups.run_delay,
            "steal": None if wakeups.steal is None else 1e-9 * wakeups.steal,
            "limits": [
                {"name": m.name, "value": m.value, "limit": m.limit, "unit": m.unit, "kept": m.kept}
                for m in self.measures
            ],
            "real_time": wakeups.mode,
            "facts": [{"name": fact.name, "value": fact.value, "advice": fact.advice or None} for fact in self.facts],
            "advice": self.advice,
        }


PERCENTS = {"p50": 50.0, "p99": 99.0, "p999": 99.9, "max": 100.0}
HOST_ADVICE = "the host took the processor: nothing set in here helps; a machine, or a processor, of one's own"
OTHERS_ADVICE = "other work had the processor: end it, or set a processor aside (isolcpus) and name it (--cpu)"
NOBODY_ADVICE = (
    "no account says who had the processor when the thread was woken late: in a virtual machine most often a host that "
    "does not tell, else the firmware (system management), or the kernel's own work, where it does not interrupt that"
)


def judged(wakeups: Wakeups) -> tuple[Measure, ...]:
    """The figures that have a limit."""
    allowed = max(MOST_MISSED * wakeups.periods, ONE_ALONE)
    return (
        Measure("missed periods", wakeups.missed, float(int(allowed)), "", 0),
        Measure("missed in a row", wakeups.streak, MOST_IN_A_ROW, "", 0),
        Measure("wake-up, p99", 1e6 * wakeups.percentile(99.0), 1e6 * MOST_LATE / wakeups.rate, "µs", 0),
    )


def shown(measure: Measure) -> str:
    """The figure beside its limit, in words."""
    unit = f" {measure.unit}" if measure.unit else ""
    return f"{measure.value:,.{measure.digits}f}{unit} (at most {measure.limit:,.{measure.digits}f}{unit})"


def examine(rate: float, seconds: float, wishes: RealTimeWishes) -> Diagnosis:
    """Measure wake-ups, and look at what the system is set to.

    Args:
        rate: Of the loop that is meant [Hz].
        seconds: How long to measure [s].
        wishes: What the loop would ask of the system.
    """
    facts = scheduling_facts(wishes.priority + 1)
    return Diagnosis(measure_wakeups(rate, seconds, wishes), facts)


def quick_warning(rate: float, wishes: RealTimeWishes) -> str:
    """Look for `QUICK_SECONDS` whether the machine keeps a rate just now; a line where it does not, "" where it does.

    Locked memory is not asked for: it would take longer than the look.

    Args:
        rate: Of the loop that is to begin [Hz].
        wishes: What it is going to ask of the system.
    """
    wakeups = measure_wakeups(rate, QUICK_SECONDS, replace(wishes, lock_memory=False))
    diagnosis = Diagnosis(wakeups, [])
    return "" if diagnosis.good else f"{diagnosis.verdict}; hhsim doctor tells more"


def histogram(wakeups: Wakeups) -> list[tuple[float, float | None, int]]:
    """Wake-ups by lateness: above, up to [µs] (None: no end), and how many; without empty ends."""
    late = 1e-3 * wakeups.late
    edges = [0.0, *map(float, EDGES_US)]
    counts = np.bincount(np.searchsorted(EDGES_US, late, side="left"), minlength=len(edges))
    last = int(np.flatnonzero(counts).max(initial=0))
    rows = zip(edges, [*edges[1:], None], map(int, counts), strict=True)
    return list(rows)[: last + 1]


def mode_line(wakeups: Wakeups) -> str:
    """What the system granted, in a line."""
    return described(wakeups.mode)


def _of_causes(wakeups: Wakeups) -> list[str]:
    """What follows from who took the time."""
    found = [HOST_ADVICE] if wakeups.causes[MissCause.HOST] else []
    if wakeups.causes[MissCause.WOKEN_LATE]:
        overslept = wakeups.late[wakeups.late >= 1e9 / wakeups.rate].sum()
        # Half of it: a run delay that explains less is not what made the thread late.
        found.append(OTHERS_ADVICE if 2 * (wakeups.run_delay or 0) >= overslept else NOBODY_ADVICE)
    return found


def _missed(wakeups: Wakeups) -> str:
    if not wakeups.missed:
        return f"none of {wakeups.periods:,} periods was missed"
    by = ", ".join(f"{WORDS[cause]} {count:,}" for cause, count in wakeups.causes.items() if count)
    return f"{wakeups.missed:,} of {wakeups.periods:,} periods were missed ({by})"

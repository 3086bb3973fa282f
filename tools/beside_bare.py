"""The loop beside a bare waiting loop, in turns: `python -m tools.beside_bare --rate 1000 --minutes 10`.

A session of a minute, then a minute of compiled code that only waits for the same deadlines with the same rights on the
same processor, and so on: what the machine and its host do to the one they do to the other. Printed are the missed
periods of both with their causes, how late both woke, and whether each recording is whole and runs again to the same
bytes. Exit code 1: a limit was missed.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import HhsimError
from hhsim.live.devices.registry import configure
from hhsim.live.real_time import RealTimeWishes
from hhsim.live.session.stop_signals import stop_signals
from hhsim.live.session.supervisor import Supervisor
from hhsim.live.wakeups import measure_wakeups
from hhsim.replay.repeat import run_again
from hhsim.result.miss_cause import CAUSES, MissCause, by_name
from hhsim.result.reader import load_result
from tools.soak import make_setup, tell

MOST_MISSED = 1.2
"""Periods that the loop may miss for one that the bare loop misses."""
FIRST_TICKS = 2
"""What is missed before these is the time in which the shown hand is put where it can begin, and no finger is held."""
PERCENTS = (50.0, 99.0, 99.9)
BUSY = "import os\nos.nice(19)\nwhile True: pass"


@dataclass
class Turns:
    """What became of the periods of all turns of one of the two.

    Attributes:
        periods, missed: With and without those that were missed.
        causes: Of the missed ones, by who took most of the time.
        woke: How late each wake-up was [ns].
        longest: Most missed periods in a row.
    """

    periods: int = 0
    missed: int = 0
    causes: dict[MissCause, int] = field(default_factory=lambda: dict.fromkeys(CAUSES, 0))
    woke: list[NDArray[np.int64]] = field(default_factory=list)
    longest: int = 0

    def wakeup(self, percent: float) -> float:
        """The lateness that so many per cent of the wake-ups do not exceed [µs]."""
        late = np.concatenate(self.woke) if self.woke else np.zeros(0)
        return 1e-3 * float(np.percentile(late, percent)) if late.size else float("nan")

    @property
    def share(self) -> float:
        """Of the periods, those missed."""
        return self.missed / max(self.periods, 1)


@dataclass
class Beside:
    """Both, and what the sessions are judged by besides.

    Attributes:
        rate: Of both [Hz].
        loop, bare: What became of their periods.
        at_start: Periods missed before the first ticks of the sessions, and not counted to the loop's.
        latency: From a sample's bytes read to the command handed over, one entry a command [ns].
        lost: Ticks that the recordings lack.
        differing: Recordings that do not run again to the same bytes.
    """

    rate: float
    loop: Turns = field(default_factory=Turns)
    bare: Turns = field(default_factory=Turns)
    at_start: int = 0
    latency: list[NDArray[np.int64]] = field(default_factory=list)
    lost: int = 0
    differing: int = 0

    def missed_limits(self) -> list[str]:
        """What was not as it has to be, a line each."""
        own = self.loop.causes[MissCause.COMPUTED]
        limits = {
            f"the loop missed {self.loop.missed:,} periods, the bare loop {self.bare.missed:,}": self.loop.share
            > MOST_MISSED * self.bare.share,
            f"{own:,} periods were missed by the loop's own computing": own > 0,
            f"the recordings lack {self.lost:,} ticks": self.lost > 0,
            f"{self.differing} recordings do not run again to the same bytes": self.differing > 0,
        }
        return [text for text, missed in limits.items() if missed]


def session_turn(both: Beside, folder: Path, seconds: float, device: str, name: str, wishes: RealTimeWishes) -> int:
    """Run a session and count its ticks; returns the processor that it stayed on, -1 for any."""
    record = folder / "session.h5"
    record.unlink(missing_ok=True)
    setup = replace(make_setup(configure(device), name, record, seconds, wishes), rate=both.rate)
    with stop_signals() as stopped, Supervisor(setup) as session:
        while session.poll():
            if stopped():
                raise HhsimError(f"stopped: {stopped()}")
            time.sleep(0.05)
        outcome = session.end()
    session.check()
    result = load_result(record)
    missed, cause = np.asarray(result["live/tick/missed"]), np.asarray(result["live/tick/cause"])
    at_start = int(missed[:FIRST_TICKS].sum())
    both.at_start += at_start
    both.loop.periods += outcome.ticks + outcome.missed - at_start
    both.loop.missed += int(missed[FIRST_TICKS:].sum())
    for each in CAUSES:
        both.loop.causes[each] += int(missed[FIRST_TICKS:][cause[FIRST_TICKS:] == each].sum())
    both.loop.woke.append(np.asarray(result["live/tick/wakeup"][FIRST_TICKS:]))
    both.loop.longest = max(both.loop.longest, int(missed[FIRST_TICKS:].max(initial=0)))
    latency = np.asarray(result["live/tick/latency"])
    both.latency.append(latency[latency >= 0])
    both.lost += outcome.record_lost
    both.differing += not run_again(result).identical
    return int(outcome.facts["real_time"]["cpu"])


def bare_turn(both: Beside, seconds: float, wishes: RealTimeWishes) -> None:
    """Wait for as many deadlines, and do nothing else."""
    found = measure_wakeups(both.rate, seconds, wishes)
    both.bare.periods += found.periods
    both.bare.missed += found.missed
    for cause, count in found.causes.items():
        both.bare.causes[cause] += count
    both.bare.woke.append(found.late)
    both.bare.longest = max(both.bare.longest, found.streak)


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """Python that never rests, in processes at the lowest priority."""
    children = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for child in children:
            child.kill()
            child.wait()


def table(both: Beside) -> str:
    """Both beside each other."""
    rows: list[tuple[str, ...]] = [("", "loop", "bare loop")]
    turns = (both.loop, both.bare)
    rows.append(("periods", *(f"{turn.periods:,}" for turn in turns)))
    rows.append(("missed", *(f"{turn.missed:,} ({100.0 * turn.share:.4f} %)" for turn in turns)))
    for cause, name in zip(CAUSES, by_name(range(len(CAUSES))), strict=True):
        rows.append((f"  {name}", *(f"{turn.causes[cause]:,}" for turn in turns)))
    rows.append(("missed before the first ticks", f"{both.at_start:,}", "—"))
    rows.append(("most in a row", *(f"{turn.longest:,}" for turn in turns)))
    rows.extend((f"wake-up p{p:g} [µs]", *(f"{turn.wakeup(p):,.0f}" for turn in turns)) for p in PERCENTS)
    latency = np.concatenate(both.latency) if both.latency else np.zeros(0)
    if latency.size:
        p50, p99 = 1e-3 * np.percentile(latency, (50.0, 99.0))
        rows.append(("sample read to command p50 / p99 [µs]", f"{p50:,.0f} / {p99:,.0f}", "—"))
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    return "\n".join(f"{a.ljust(widths[0])}  {b.rjust(widths[1])}  {c.rjust(widths[2])}" for a, b, c in rows)


def as_json(both: Beside) -> str:
    """The same as plain values."""
    document: dict[str, Any] = {
        name: {
            "periods": turn.periods,
            "missed": turn.missed,
            "missed_by": by_name(turn.causes.values()),
            "most_in_a_row": turn.longest,
            "wakeup_us": {f"p{percent:g}": turn.wakeup(percent) for percent in PERCENTS},
        }
        for name, turn in (("loop", both.loop), ("bare", both.bare))
    }
    document |= {
        "rate": both.rate,
        "missed_at_start": both.at_start,
        "recorder_lost": both.lost,
        "missed_limits": both.missed_limits(),
    }
    return json.dumps(document, indent=2)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run both in turns; 0, or 1 where a limit was missed."""
    parser = argparse.ArgumentParser(prog="python -m tools.beside_bare", description=__doc__)
    parser.add_argument("--rate", type=float, default=1000.0, help="of both [Hz]")
    parser.add_argument("--minutes", type=float, default=10.0, help="of each")
    parser.add_argument("--turn", type=float, default=60.0, help="one turn [s]")
    parser.add_argument("--device", default="sim", help="a glove that needs nothing: sim or replay")
    parser.add_argument("--object", default="cube", help="name in the catalogue")
    parser.add_argument("--busy", type=int, default=0, help="processes at nice 19 that never rest")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args(arguments)
    both, wishes = Beside(options.rate), RealTimeWishes()
    turns = max(1, round(60.0 * options.minutes / options.turn))
    with tempfile.TemporaryDirectory() as folder, busy_processes(options.busy):
        for turn in range(turns):
            tell(f"turn {turn + 1} of {turns}", 0)
            cpu = session_turn(both, Path(folder), options.turn, options.device, options.object, wishes)
            bare_turn(both, options.turn, replace(wishes, cpu=cpu))
    print(as_json(both) if options.json else table(both))
    missed = both.missed_limits()
    for text in missed:
        print(f"limit missed: {text}", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())

"""The loop beside a bare waiting loop, in turns: `python -m tools.beside_bare --device all --minutes 5 --out FILE.md`.

A session of a minute with each glove, a minute of compiled code that only waits for the same deadlines with the same
rights on the same processor, and so on: what the machine and its host do to the one they do to the other. All gloves
but the simulated one are fakes, in processes of their own. The table has the missed periods of all with their causes,
how late they woke, the time from a sample to its command, and whether each recording is whole and runs again to the
same bytes. Exit code 1: a limit was missed.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.live.devices.registry import GloveConfig, Hand, configure
from hhsim.live.doctor import measure_wakeups
from hhsim.live.real_time import RealTimeWishes, described
from hhsim.live.session.supervisor import SessionOutcome, Supervisor, stop_signals
from hhsim.live.session.two_gloves import TwoGloves
from hhsim.replay.repeat import run_again
from hhsim.replay.stored_scene import stored_hand, stored_options, stored_surface
from hhsim.result.miss_cause import CAUSES, MissCause, by_name
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import SIDES
from hhsim.solver.hand_solver import HandSolver
from tools.import_graph import REPOSITORY
from tools.soak import make_setup, peer_latencies, tell
from tools.soak_peers import PEERS, SoakPeer, free_port_pair, measure_in_time

Times = NDArray[np.int64]

MOST_MISSED = 1.2
"""Periods that the loop may miss for one that the bare loop misses."""
PERCENTS = (50.0, 99.0, 99.9)
TWO = "two"
"""Two simulated gloves in one session."""
DEVICES = ("sim", *PEERS, "doglove")
DOGLOVE = REPOSITORY / "tests" / "doglove_peer.py"
BUSY = "import os\nos.nice(19)\nwhile True: pass"
BARE = "bare loop"
AT_ONCE = 4096
"""Ticks that are run again in one go."""
LATENCIES = {
    "read": "sample read to command handed over",
    "handed": "of it: the driver's, until the loop could take it",
    "waited": "of it: until the loop woke",
    "worked": "of it: the loop's work",
    "peer": "sample sent to command received, by the glove's clock",
}


@dataclass
class Turns:
    """What became of the periods of all turns with one glove, or of the bare loop.

    Attributes:
        periods, missed: With and without those that were missed.
        causes: Of the missed ones, by who took most of the time.
        interrupted: Of those that were computed, how many followed on a tick that fits into its period when it is run
            again: `interrupted`.
        early: Ticks that a sample made due before their period ended.
        at_once: Ticks that began late in their period, right after the one before and without a sleep.
        woke: How late each wake-up was [ns].
        longest: Most missed periods in a row.
        latencies: Of `LATENCIES`, one entry a sample that led to a command [ns].
        recorded, lost: Ticks in the recordings, and that they lack.
        differing: Recordings that do not run again to the same bytes.
    """

    periods: int = 0
    missed: int = 0
    causes: dict[MissCause, int] = field(default_factory=lambda: dict.fromkeys(CAUSES, 0))
    interrupted: int = 0
    early: int = 0
    at_once: int = 0
    woke: list[Times] = field(default_factory=list)
    longest: int = 0
    latencies: dict[str, list[Times]] = field(default_factory=lambda: {name: [] for name in LATENCIES})
    recorded: int = 0
    lost: int = 0
    differing: int = 0

    def wakeup(self, percent: float) -> float:
        """The lateness that so many per cent of the wake-ups do not exceed [µs]."""
        return _percentile(self.woke, percent)

    def latency(self, name: str, percent: float) -> float:
        """The same of one of `LATENCIES` [µs], NaN where it is not known."""
        return _percentile(self.latencies[name], percent)

    @property
    def share(self) -> float:
        """Of the periods, those missed."""
        return self.missed / max(self.periods, 1)


@dataclass
class Beside:
    """All of it.

    Attributes:
        rate: Of all [Hz].
        gloves: What became of the sessions, by glove.
        bare: What became of the bare loop's periods.
        real_time: What the system granted, in words.
    """

    rate: float
    gloves: dict[str, Turns] = field(default_factory=dict)
    bare: Turns = field(default_factory=Turns)
    real_time: str = ""

    def missed_limits(self) -> list[str]:
        """What was not as it has to be, a line each."""
        found = []
        for name, turns in self.gloves.items():
            own = turns.causes[MissCause.COMPUTED] - turns.interrupted
            limits = {
                f"the loop missed {100.0 * turns.share:.4f} % of its periods, the bare loop "
                f"{100.0 * self.bare.share:.4f} %": turns.share > MOST_MISSED * self.bare.share,
                f"{own:,} periods were missed by the loop's own computing": own > 0,
                f"{turns.missed - sum(turns.causes.values()):,} missed periods have no name": turns.missed
                != sum(turns.causes.values()),
                f"the recordings lack {turns.lost:,} ticks": turns.lost > 0,
                f"{turns.differing} recordings do not run again to the same bytes": turns.differing > 0,
            }
            found += [f"{name}: {text}" for text, missed in limits.items() if missed]
        return found


def session_turn(
    both: Beside, name: str, setup: Callable[[Path, Hand], Any], folder: Path, peer: SoakPeer | None
) -> int:
    """Run a session and count its periods, from the first one on; returns the processor of the loop, -1 for any."""
    record = folder / "session.h5"
    record.unlink(missing_ok=True)
    setups = [replace(setup(record, side), rate=both.rate) for side in (SIDES if name == TWO else SIDES[:1])]
    with stop_signals() as stopped, TwoGloves(setups) if name == TWO else Supervisor(setups[0]) as session:
        while session.poll():
            if stopped():
                raise HhsimError(f"stopped: {stopped()}")
            time.sleep(0.05)
        ended = session.end()
    session.check()
    outcomes = ended if isinstance(ended, tuple) else (ended,)
    for outcome in outcomes:
        count_session(both, name, outcome, peer)
    return int(outcomes[0].facts["real_time"]["cpu"])


def count_session(both: Beside, name: str, outcome: SessionOutcome, peer: SoakPeer | None) -> None:
    """Count the periods of a session, or of one hand of it."""
    turns = both.gloves.setdefault(name, Turns())
    turns.periods += outcome.ticks + outcome.missed
    turns.missed += outcome.missed
    for cause, count in zip(CAUSES, outcome.missed_by.values(), strict=True):
        turns.causes[cause] += count
    assert outcome.record is not None
    result = load_result(outcome.record)
    turns.interrupted += interrupted(result)
    turns.early += int((np.asarray(result["live/tick/early"]) > 0).sum())
    turns.at_once += int(np.asarray(result["live/tick/at_once"]).sum())
    turns.woke.append(np.asarray(result["live/tick/wakeup"]))
    turns.longest = max(turns.longest, int(np.asarray(result["live/tick/missed"]).max(initial=0)))
    for what, found in loop_latencies(result).items():
        turns.latencies[what].append(found)
    if peer is not None:
        turns.latencies["peer"].append(peer_latencies(result, peer.seen(result)))
    turns.recorded += outcome.recorded
    turns.lost += outcome.record_lost
    turns.differing += not run_again(result).identical
    both.real_time = described(outcome.facts["real_time"])


def loop_latencies(result: Result) -> dict[str, Times]:
    """From the bytes of each sample read to its command handed over, and its three parts [ns]."""
    latency, seq = np.asarray(result["live/tick/latency"]), np.asarray(result["input_seq"])
    period, wakeup = round(1e9 / float(result.scene["rate"])), np.asarray(result["live/tick/wakeup"])
    woke = np.asarray(result["live/tick/deadline"]) + wakeup % period
    answered = latency >= 0
    came, handed = np.asarray(result["live/sample/time"]), np.asarray(result["live/sample/handed"])
    row_of = {number: row for row, number in enumerate(result["live/sample/seq"].tolist())}
    rows = np.array([row_of.get(number, -1) for number in seq[answered].tolist()], np.int64)
    known = rows >= 0
    read, woke, rows = latency[answered][known], woke[answered][known], rows[known]
    worked = read - (woke - came[rows])
    return {"read": read, "handed": handed[rows] - came[rows], "waited": woke - handed[rows], "worked": worked}


def interrupted(result: Result) -> int:
    """Periods that are named computed too long although the ticks since the last sleep, run again, miss none.

    The system counts what its interrupts take as CPU time of whom they interrupt; here it is told apart by the
    CPU time in the quicker of two further runs, the lateness, and what 99 of 100 ticks take besides their solving. One
    tick may end in the first half of the next period, and two have two periods.
    """
    missed, cause = np.asarray(result["live/tick/missed"]), np.asarray(result["live/tick/cause"])
    named = np.flatnonzero((missed > 0) & (cause == MissCause.COMPUTED))
    at_once = np.asarray(result["live/tick/at_once"], bool)
    named = named[named > at_once[named - 1]]
    if not named.size:
        return 0
    hand, surface, options = stored_hand(result), stored_surface(result), stored_options(result)
    haptic = [np.asarray(result[f"haptic/{name}"])[: named[-1]] for name in HandConfiguration._fields]
    runs = []
    for _ in range(2):
        solver = HandSolver(hand, surface, options)
        blocks = range(0, len(haptic[0]), AT_ONCE)
        runs.append([solver.run(*(of[k : k + AT_ONCE] for of in haptic)).duration_cpu for k in blocks])
    again = np.minimum(*(np.concatenate(parts) for parts in runs))
    answered = np.asarray(result["live/tick/latency"]) >= 0
    solved = np.asarray(result["duration/total"])[answered]
    besides = loop_latencies(result)["worked"]
    rest = np.percentile(besides - solved[-len(besides) :], 99.0) if besides.size else 0.0
    period = 1e9 / float(result.scene["rate"])
    two = at_once[named - 1]
    first = named - 1 - two
    late = np.asarray(result["live/tick/wakeup"])[first] % period - np.asarray(result["live/tick/early"])[first]
    worked = again[named - 1] + rest + two * (again[named - 2] + rest)
    return int(missed[named][late + worked < np.where(two, 2.0, 1.5) * period].sum())


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
def fake_glove(name: str, folder: Path) -> Iterator[tuple[GloveConfig, SoakPeer | None]]:
    """A glove to have a session with, while the block runs, and what it wrote down, where it does."""
    if name in PEERS:
        with PEERS[name](folder, PEERS[name].usual_rate, 0) as peer:
            measure_in_time(peer)
            yield peer.config, peer
    elif name == "doglove":
        port = free_port_pair()
        with subprocess.Popen([sys.executable, DOGLOVE, str(port)]) as process:
            try:
                yield configure(name, port=port), None
            finally:
                process.kill()
    else:
        yield configure("sim" if name == TWO else name), None


@contextmanager
def busy(processes: int, *, thread: bool) -> Iterator[None]:
    """Python that never rests: processes at the lowest priority, and a thread beside the one that runs the sessions."""
    rest = threading.Event()

    def spin() -> None:
        os.nice(19)
        while not rest.is_set():
            pass

    children = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(processes)]
    spinning = threading.Thread(target=spin, daemon=True)
    if thread:
        spinning.start()
    try:
        yield
    finally:
        rest.set()
        for child in children:
            child.kill()
            child.wait()


def table(both: Beside) -> str:
    """All beside each other, in Markdown."""
    turns = {**both.gloves, BARE: both.bare}
    rows: list[tuple[str, ...]] = [(f"at {both.rate:g} Hz", *turns)]

    def add(label: str, shown: Callable[[Turns], str]) -> None:
        rows.append((label, *map(shown, turns.values())))

    add("periods", lambda each: f"{each.periods:,}")
    add("missed", lambda each: f"{each.missed:,} ({100.0 * each.share:.4f} %)")
    add("times the bare loop's", lambda each: f"{each.share / both.bare.share:.2f}" if both.bare.share else "—")
    for cause, name in zip(CAUSES, by_name(range(len(CAUSES))), strict=True):
        add(f"missed, {name.replace('_', ' ')}", lambda each, cause=cause: f"{each.causes[cause]:,}")  # type: ignore[misc]
    add("of the computed, fit in when run again", lambda each: f"{each.interrupted:,}")
    add("begun with a sample, before the deadline", lambda each: f"{each.early:,}")
    add("begun late, without a sleep before", lambda each: f"{each.at_once:,}")
    add("most in a row", lambda each: f"{each.longest:,}")
    shown = " / ".join(f"p{percent:g}" for percent in PERCENTS)
    add(f"wake-up {shown} [µs]", lambda each: _shown(each.woke))
    for name, label in LATENCIES.items():
        add(f"{label}, {shown} [µs]", lambda each, name=name: _shown(each.latencies[name]))  # type: ignore[misc]
    sessions = {name: name != BARE for name in turns}
    rows.append(
        ("recorded / lost ticks", *(f"{t.recorded:,} / {t.lost:,}" if sessions[n] else "—" for n, t in turns.items()))
    )
    rows.append(("recordings that differ", *(f"{t.differing}" if sessions[n] else "—" for n, t in turns.items())))
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    lines.insert(1, "|---|" + "---:|" * len(turns))
    limits = [f"- limit missed: {text}" for text in both.missed_limits()] or ["- every limit kept"]
    return "\n".join([*lines, "", f"- {both.real_time}", *limits])


def as_json(both: Beside) -> dict[str, Any]:
    """The same as plain values."""
    return {
        "rate": both.rate,
        "real_time": both.real_time,
        "missed_limits": both.missed_limits(),
        **{
            name: {
                "periods": turn.periods,
                "missed": turn.missed,
                "missed_by": by_name(turn.causes.values()),
                "computed_fit_when_run_again": turn.interrupted,
                "begun_early": turn.early,
                "begun_at_once": turn.at_once,
                "most_in_a_row": turn.longest,
                "wakeup_us": {f"p{percent:g}": turn.wakeup(percent) for percent in PERCENTS},
                "latency_us": {
                    what: {f"p{percent:g}": turn.latency(what, percent) for percent in PERCENTS}
                    for what, found in turn.latencies.items()
                    if sum(map(len, found))
                },
                "recorded": turn.recorded,
                "recorder_lost": turn.lost,
                "differing": turn.differing,
            }
            for name, turn in {**both.gloves, "bare": both.bare}.items()
        },
    }


def _percentile(parts: Sequence[Times], percent: float) -> float:
    found = np.concatenate(parts) if parts else np.zeros(0)
    return 1e-3 * float(np.percentile(found, percent)) if found.size else float("nan")


def _shown(parts: Sequence[Times]) -> str:
    values = [_percentile(parts, percent) for percent in PERCENTS]
    return "—" if np.isnan(values).all() else " / ".join(f"{value:,.0f}" for value in values)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all in turns; 0, or 1 where a limit was missed."""
    parser = argparse.ArgumentParser(prog="python -m tools.beside_bare", description=__doc__.split("\n\n")[0])
    parser.add_argument("--rate", type=float, default=1000.0, help="of all [Hz]")
    parser.add_argument("--minutes", type=float, default=10.0, help="of each glove")
    parser.add_argument("--turn", type=float, default=60.0, help="one turn [s]")
    parser.add_argument("--device", default="sim", help=f"all, or some of {','.join(DEVICES)},{TWO}")
    parser.add_argument(
        "--bare-every", type=int, default=1, metavar="N", help="one turn of the bare loop after N sessions"
    )
    parser.add_argument("--object", default="cube", help="name in the catalogue")
    parser.add_argument("--busy", type=int, default=0, help="processes at nice 19 that never rest")
    parser.add_argument("--busy-thread", action="store_true", help="a Python thread that never rests")
    parser.add_argument(
        "--out", type=Path, metavar="FILE.md", help="write the table there after each turn, and FILE.json"
    )
    options = parser.parse_args(arguments)
    devices = DEVICES if options.device == "all" else tuple(options.device.split(","))
    if unknown := set(devices) - {*DEVICES, TWO}:
        parser.error(f"no fake of {', '.join(sorted(unknown))}: expected all, or some of {','.join(DEVICES)}")
    both, wishes = Beside(options.rate), RealTimeWishes()
    turns = max(1, round(60.0 * options.minutes / options.turn)) * len(devices)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stack.enter_context(busy(options.busy, thread=options.busy_thread))
        for turn in range(turns):
            name = devices[turn % len(devices)]
            tell(f"turn {turn + 1} of {turns}: {name}", 0)
            with fake_glove(name, folder) as (config, peer):
                cpu = session_turn(
                    both,
                    name,
                    lambda path, side: make_setup(
                        replace(config, hand=side), options.object, path, options.turn, wishes
                    ),
                    folder,
                    peer,
                )
                if (turn + 1) % options.bare_every == 0 or turn + 1 == turns:
                    bare_turn(both, options.turn, replace(wishes, cpu=cpu))
            if options.out is not None:
                options.out.write_text(table(both) + "\n", encoding="utf-8")
                options.out.with_suffix(".json").write_text(
                    json.dumps(as_json(both), indent=2) + "\n", encoding="utf-8"
                )
    print(table(both))
    return 1 if both.missed_limits() else 0


if __name__ == "__main__":
    sys.exit(main())

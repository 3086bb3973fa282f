"""Long runs of the loop beside fake gloves: `python -m tools.soak --duration 600`.

Each device has a session of its own, recorded; the glove is another process that speaks the real format and writes
down, by the same clock, what it sent and what it was told. Printed are what became of every frame, how the loop kept
its periods, how long a sample took to a command as the glove saw it, how deep the hand ever was in the object, and
whether the recording runs again to the same bytes. Exit code 1: a limit was missed.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.errors import HhsimError
from hhsim.hand.model import HandModel
from hhsim.live.devices.registry import GloveConfig
from hhsim.live.ipc.config import LiveSetup
from hhsim.live.pose.registry import PoseConfig
from hhsim.live.real_time import RealTimeWishes, described
from hhsim.live.session.scene import make_live_scene
from hhsim.live.session.supervisor import SessionOutcome, Supervisor, stop_signals
from hhsim.mesh.catalogue import load_object
from hhsim.replay.repeat import run_again
from hhsim.result.reader import Result, load_result
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.solver.hand_solver import warm_up
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from tools.soak_peers import PEERS, PeerSeen, SoakPeer, Times, measure_in_time

LATENCY_LIMIT = 2e-3
"""Of the 99th percentile of the added latency, where SCHED_FIFO was granted [s]."""
IN_FLIGHT = 0.1
"""Frames of so long [s] may still be on their way when a session ends."""
BEFORE = 20_000
"""A command can reach a glove on another processor this much before the sender looks at its clock [ns]."""


@dataclass(frozen=True)
class SoakFigures:
    """What a long run with one device gave; times in seconds.

    Attributes:
        device: Kind.
        frames_sent: To the loop, while it had the glove open.
        frames_before: Sent earlier, and thrown away.
        frames_decoded: As the driver counts.
        frames_left: Sent, and still on their way when the session ended.
        frames_lost: Sent, and neither decoded nor left: has to be 0.
        samples_used, samples_superseded: Each once in a tick; or replaced by a newer one before it could be.
        samples_unused: Before the first tick, after the last one, or not good.
        samples_other: Rejected, malformed, of another hand, late or doubled.
        ticks, missed: Periods with and without a tick.
        longest_gap: Longest time between two ticks.
        commands_sent, commands_received: By the loop, and by the glove.
        wakeup_p50, wakeup_p99, wakeup_p999: From a deadline to the loop's waking.
        latency_p50, latency_p99, latency_p999, latency_max: From the glove's sending a sample to its receiving the
            first command made with it.
        latencies: How many of these were measured.
        penetration_max: Deepest that the shown hand ever was in the object [m].
        in_contact: Ticks with contact.
        resisting: Ticks in which a finger was told to resist.
        kept_free: Ticks whose fingers were kept free, by why.
        identical: Whether the recording runs again to the same bytes.
        recorder_lost: Ticks that it lacks.
        real_time: The mode that was achieved.
        missed_limits: What was not as it has to be, a line each.
    """

    device: str
    frames_sent: int
    frames_before: int
    frames_decoded: int
    frames_left: int
    frames_lost: int
    samples_used: int
    samples_superseded: int
    samples_unused: int
    samples_other: int
    ticks: int
    missed: int
    longest_gap: float
    commands_sent: int
    commands_received: int
    wakeup_p50: float
    wakeup_p99: float
    wakeup_p999: float
    latency_p50: float
    latency_p99: float
    latency_p999: float
    latency_max: float
    latencies: int
    penetration_max: float
    in_contact: int
    resisting: int
    kept_free: dict[str, int]
    identical: bool
    recorder_lost: int
    real_time: str
    missed_limits: tuple[str, ...]


def soak(peer: SoakPeer, setup: LiveSetup, *, again: bool = True) -> SoakFigures:
    """Run a session with a fake glove, and account for everything.

    Args:
        peer: The glove; it runs.
        setup: Of the session, with the glove and a recording in it.
        again: Also run the recording again.

    Raises:
        HhsimError: The session failed, or was stopped.
    """
    if setup.real_time.punctual and not measure_in_time(peer):
        tell("the glove's process has no SCHED_FIFO: what it waits for a processor counts as latency", 1)
    with stop_signals() as stop_signal, Supervisor(setup, tell) as session:
        while session.poll():
            if stop_signal():
                session.request_stop(stop_signal())
            time.sleep(0.05)
        outcome = session.end()
    session.check()
    if stop_signal():
        raise HhsimError(f"stopped: {stop_signal()}")
    assert setup.record is not None
    result = load_result(setup.record)
    return figures(peer.name, outcome, result, peer.seen(result), again=again)


def figures(device: str, outcome: SessionOutcome, result: Result, seen: PeerSeen, *, again: bool) -> SoakFigures:
    """Account for a session.

    Args:
        device: Kind.
        outcome: As its supervisor saw it.
        result: Its recording.
        seen: The same as the glove saw it.
        again: Run the recording again.
    """
    tally, counters = outcome.tally, outcome.counters
    recorded = result["live/sample/seq"]
    added = 1e-9 * peer_latencies(result, seen)
    p50, p99, p999 = np.percentile(added, (50.0, 99.0, 99.9)) if added.size else (np.nan,) * 3
    woke = result["live/tick/deadline"] + result["live/tick/wakeup"]
    # A glove goes on sending when the loop has ended.
    heard = int(np.searchsorted(seen.sent, woke[-1], side="right"))
    sent = heard - seen.before
    # The last one that was decoded tells which ones were still on their way.
    left = heard - 1 - int(seen.of_sample[recorded].max())
    other = counters.rejected + counters.malformed + counters.other + counters.dropped
    unused = counters.samples - tally.new_samples - tally.superseded
    identical = bool(again) and run_again(result).identical
    penetration = float(result["penetration_depth"].max(initial=0.0))
    lost = sent - counters.frames - left
    gap = 1e-9 * float(np.diff(woke).max(initial=0))
    # The last word may still be on its way when the glove's log is read.
    unheard = counters.commands - len(seen.received) - 1
    limits = {
        f"{lost:,} frames are not accounted for": lost != 0,
        f"{unused:,} samples were neither used nor replaced": not 0 <= unused <= outcome_slack(outcome, sent),
        f"{left:,} frames were left at the end": left > IN_FLIGHT * sent / max(outcome.seconds, IN_FLIGHT) + 1,
        f"the glove got {len(seen.received):,} commands of {counters.commands:,}": unheard > seen.taken_back,
        f"added latency p99 is {1e3 * p99:.2f} ms": not p99 <= LATENCY_LIMIT and bool(_fifo(outcome)),
        f"the hand was {1e6 * penetration:.3f} µm in the object": penetration > 0.0,
        "the recording does not run again to the same bytes": again and not identical,
        f"the recording lacks {outcome.record_lost:,} ticks": outcome.record_lost > 0,
        "no finger was ever resisted": tally.stiff == 0,
    }
    return SoakFigures(
        device=device,
        frames_sent=sent,
        frames_before=seen.before,
        frames_decoded=counters.frames,
        frames_left=left,
        frames_lost=lost,
        samples_used=tally.new_samples,
        samples_superseded=tally.superseded,
        samples_unused=unused,
        samples_other=other,
        ticks=outcome.ticks,
        missed=outcome.missed,
        longest_gap=gap,
        commands_sent=counters.commands,
        commands_received=len(seen.received),
        wakeup_p50=1e-9 * tally.wakeup.percentile(50),
        wakeup_p99=1e-9 * tally.wakeup.percentile(99),
        wakeup_p999=1e-9 * tally.wakeup.percentile(99.9),
        latency_p50=float(p50),
        latency_p99=float(p99),
        latency_p999=float(p999),
        latency_max=float(added.max(initial=0.0)),
        latencies=added.size,
        penetration_max=penetration,
        in_contact=tally.in_contact,
        resisting=tally.stiff,
        kept_free={str(why.name): count for why, count in tally.free_for.items() if count},
        identical=identical,
        recorder_lost=outcome.record_lost,
        real_time=described(outcome.facts["real_time"]),
        missed_limits=tuple(text for text, missed in limits.items() if missed),
    )


def peer_latencies(result: Result, seen: PeerSeen) -> Times:
    """`added_latencies` of a session, by its recording and by what its glove saw [ns]."""
    latency, used = result["live/tick/latency"], result["input_seq"]
    answered = latency >= 0
    sample_time = np.zeros(seen.of_sample.size, np.int64)
    sample_time[result["live/sample/seq"]] = result["live/sample/time"]
    commanded = sample_time[used[answered]] + latency[answered]
    return added_latencies(seen.sent, seen.received, commanded, seen.of_sample[used[answered]])


def added_latencies(sent: ArrayLike, received: ArrayLike, commanded: ArrayLike, of: ArrayLike) -> Times:
    """From each sample sent to the first command that used it, both as the peer saw them.

    The session says which command used which sample first, and when it was sent; the peer says when it came.

    Args:
        sent: When the peer sent each sample, CLOCK_MONOTONIC [ns], by the sample's number.
        received: When commands came to the peer [ns], ascending.
        commanded: When the session sent each command that used a sample for the first time [ns].
        of: The number of that sample.

    Returns:
        [ns], for those of `commanded` whose command came and whose sample is known; a command is taken for the first
        one that came after it was sent, so that a doubt makes it longer, never shorter.
    """
    sent_, received_, commanded_ = (np.asarray(values, np.int64) for values in (sent, received, commanded))
    number = np.asarray(of, np.int64)
    known = (number >= 0) & (number < sent_.size)
    commanded_, number = commanded_[known], number[known]
    place = np.searchsorted(received_, commanded_ - BEFORE)
    came = place < received_.size
    return np.asarray(received_[place[came]] - sent_[number[came]], np.int64)


def outcome_slack(outcome: SessionOutcome, sent: int) -> int:
    """Samples that may stay unused: those of the time in which the loop was made ready, and of its last tick."""
    return round(2.0 * sent / max(outcome.seconds, 1.0)) + 2


def _fifo(outcome: SessionOutcome) -> int:
    return int(outcome.facts.get("real_time", {}).get("fifo", 0))


def make_setup(device: GloveConfig, name: str, record: Path, duration: float, wishes: RealTimeWishes) -> LiveSetup:
    """A hand whose fingers open and close where they grasp an object of the catalogue."""
    item = load_object(name)
    tree = cached_sphere_tree(item.mesh, TreeOptions(level=item.level))
    hand = HandModel.default(device.hand)
    scene = make_live_scene(DeclaredBodies.of_mesh(item.mesh, tree), hand, device, PoseConfig("fixed"), None)
    options = SolverOptions()
    warm_up(hand, options)
    return LiveSetup(
        mesh=scene.mesh,
        tree=scene.tree,
        hand=hand,
        options=options,
        device=scene.device,
        pose=scene.pose,
        duration=duration,
        real_time=wishes,
        record=record,
        description={"object": name, "soak": True},
    )


def table(runs: Sequence[SoakFigures]) -> str:
    """The figures of all devices beside each other."""
    rows: list[tuple[str, list[str]]] = [("device", [run.device for run in runs])]

    def add(label: str, *texts: str) -> None:
        rows.append((label, list(texts)))

    def counts(label: str, *names: str) -> None:
        add(label, *(" / ".join(f"{getattr(run, name):,}" for name in names) for run in runs))

    def times(label: str, scale: float, *names: str) -> None:
        add(label, *(" / ".join(f"{scale * getattr(run, name):,.3g}" for name in names) for run in runs))

    counts("frames sent / decoded / on their way at the end / lost", *_names("frames", "sent decoded left lost"))
    counts("samples used / superseded / at both ends / other", *_names("samples", "used superseded unused other"))
    counts("ticks / missed", "ticks", "missed")
    times("longest time between two ticks [ms]", 1e3, "longest_gap")
    counts("commands sent / received", *_names("commands", "sent received"))
    times("wake-up p50 / p99 / p99.9 [µs]", 1e6, *_names("wakeup", "p50 p99 p999"))
    times("sample in to command out p50 / p99 / p99.9 / max [ms]", 1e3, *_names("latency", "p50 p99 p999 max"))
    counts("ticks in contact / with resistance", "in_contact", "resisting")
    times("penetration, max [µm]", 1e6, "penetration_max")
    counts("ticks that the recorder lost", "recorder_lost")
    add("runs again identically", *("yes" if run.identical else "NO" for run in runs))
    free = [", ".join(f"{why} {count:,}" for why, count in run.kept_free.items()) or "—" for run in runs]
    add("ticks with free fingers", *free)
    label_width = max(len(label) for label, _ in rows)
    widths = [max(len(cells[k]) for _, cells in rows) for k in range(len(runs))]
    lines = ["  ".join([label.ljust(label_width), *map(str.rjust, cells, widths)]) for label, cells in rows]
    lines += [f"{run.device}: {run.real_time}" for run in runs]
    lines += [f"{run.device}: MISSED: {text}" for run in runs for text in run.missed_limits]
    return "\n".join(lines)


def _names(stem: str, endings: str) -> tuple[str, ...]:
    return tuple(f"{stem}_{ending}" for ending in endings.split())


def tell(text: str, level: int) -> None:
    """Print what happens in a session to stderr."""
    print(f"hhsim: {('', 'warning: ', 'fault: ')[min(level, 2)]}{text}", file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run as the command line says; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.soak", description=__doc__.split("\n\n")[0])
    parser.add_argument("--duration", type=float, default=600.0, metavar="S", help="of each device [s]")
    parser.add_argument("--device", choices=(*PEERS, "all"), default="all")
    parser.add_argument("--object", default="bunny", metavar="NAME", help="of the catalogue")
    parser.add_argument(
        "--rate", type=float, default=0.0, metavar="HZ", help="frames a second; 0: 200, and 1000 of udp"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the gloves' motion")
    parser.add_argument("--no-realtime", action="store_true", help="without any real-time measure")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep recordings and logs here, 2 MB a second")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the figures there, JSON")
    options = parser.parse_args(arguments)
    wishes = RealTimeWishes()
    if options.no_realtime:
        wishes = RealTimeWishes.none()
    runs: list[SoakFigures] = []
    try:
        with tempfile.TemporaryDirectory(prefix="hhsim-soak-") as scratch:
            folder = options.keep or Path(scratch)
            folder.mkdir(parents=True, exist_ok=True)
            for name in PEERS if options.device == "all" else (options.device,):
                kind = PEERS[name]
                with kind(folder, options.rate or kind.usual_rate, options.seed) as peer:
                    record = folder / f"{name}.h5"
                    setup = make_setup(peer.config, options.object, record, options.duration, wishes)
                    runs.append(soak(peer, setup))
                if not options.keep:
                    record.unlink()
    except (HhsimError, OSError) as error:
        print(f"hhsim: error: {error}", file=sys.stderr)
        return 2
    if options.out:
        document: dict[str, Any] = {"duration": options.duration, "runs": [asdict(run) for run in runs]}
        options.out.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    print(table(runs))
    return int(any(run.missed_limits for run in runs))


if __name__ == "__main__":
    sys.exit(main())

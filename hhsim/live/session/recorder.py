"""Process that writes a session to its file: `python -m hhsim.live.session.recorder --setup FD`.

It only reads the rings, so that its failure, or that of the disk, does not affect the loop. Its real-time priority is
the lowest: without one, the rings would overflow on a busy machine. It ends when the session has ended and all of it is
written, or when the loop is gone. The file has ticks as in any result, and its own tables under /live; docs/files.md
has the attributes of /live. `counters` and the lost records change while the session runs, and are those of the last
block if it was cut short; `ended` is then "".

Exit codes: 0 all records are written; 1 a fault of hhsim's own; 2 the file cannot be written (stderr says why, and
where the written part is). After 1 and 2 `recorder_failed` is set in the status.
"""

import json
import os
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray, Records
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.kernels.tick.block import TickRecord
from hhsim.live.device import COUNTERS
from hhsim.live.processes import LoopProcess, RingReader, Stage, exit_code, process_setup
from hhsim.live.real_time import become_ordinary, become_real_time, keep_off
from hhsim.live.session.loop import loop_options
from hhsim.live.session.memory import FREE_TICK_CAPACITY, SessionMemory, TickReader
from hhsim.live.session.setup import LiveSetup
from hhsim.live.session.statistics import LiveTally, session_figures
from hhsim.metrics.metrics import distance_of_hands
from hhsim.motion.trajectory import RigidMotion
from hhsim.replay.stored_scene import body_parts, describe_scene, hand_arrays
from hhsim.replay.tick_rows import SceneRows
from hhsim.result.miss_cause import by_name
from hhsim.result.reader import CHUNK_TICKS, check_result_path
from hhsim.result.schema import (
    BETWEEN_COLUMNS,
    EVENT_COLUMNS,
    HANDS,
    HANDS_APART,
    LIVE,
    LIVE_EVENT,
    LIVE_SAMPLE,
    LIVE_TICK,
    LIVE_TICK_COLUMNS,
    TICK,
    sample_columns,
)
from hhsim.result.writer import HandPart, ResultWriter
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import bodies_ticks, keeps_hands_apart, warm_up

RINGS = ("ticks", "samples", "events")

POLL = 0.05
"""Period at which the rings are read [s]; they hold 16 s of ticks at 1 kHz, 4 s with a free object."""
LONGEST_WAIT = 1.0
"""Longest time from reading a record to writing it [s]."""
PRIORITY = 1
"""Priority under SCHED_FIFO, if the session is in real time."""
BLOCK_RECORDS = 2 * CHUNK_TICKS
"""Most records of a ring in one block: no more are lost to a full disk."""
CUT_SHORT = "the recorder was told to stop before the session ended"
LOOP_DIED = "the loop failed or was killed"


Columns = dict[str, AnyArray]
Taken = Mapping[str, tuple[int, Records]]
"""Records of a hand by one of `RINGS`, each with the number of the first one."""


class SessionRows:
    """Builds the rows of hands and of bodies, and of /contact, block by block, with the options of the loop."""

    def __init__(self, setup: LiveSetup, options: SolverOptions, hands: int) -> None:
        # With room for the poses of as many ticks as a block may have.
        parts = setup.seen.parts
        self.parts = parts and replace(parts, world=np.zeros((FREE_TICK_CAPACITY, len(parts.names), 7)))
        seen, models = replace(setup.seen, parts=self.parts), [worn.model for worn in setup.worn[:hands]]
        self.bodies = body_parts(setup.scene, seen)
        self._rows = SceneRows(seen, models, options, list(self.bodies))
        self._is_free = setup.recorded_bodies > 0
        self._next = 0

    def block(self, number: int, first: int, records: Sequence[Records], began_ns: int) -> dict[str, Columns]:
        """Build the rows of the next ticks by their tables.

        `records` are one or more of each hand's ring; those of the first hand are those of bodies, too. The first one
        becomes row `number` of the file, and was the `first` counted from the loop's beginning: earlier ones may be
        lost. `began_ns` is CLOCK_MONOTONIC at which the session's first tick was due [ns].
        """
        bodies = records[0]
        if first != self._next:
            self._rows.forget()
        self._next = first + len(bodies)
        given = []
        for of in records:
            haptic = HandConfiguration(*(of[f"haptic_{name}"] for name in HandConfiguration._fields))
            record = TickRecord(*(np.ascontiguousarray(of[name]) for name in TickRecord._fields))
            given.append((of["input_seq"], haptic, record))
        time = 1e-9 * (bodies["time_ns"] - began_ns)
        free = bodies_ticks(bodies) if self._is_free else None
        return self._rows.block(slice(len(bodies)), time, given, free, number)[1]

    def moved(self, records: Records) -> tuple[RigidMotion, ...]:
        """Return the motion of bodies since before the first tick, at the end of each; none of one that is fixed."""
        if not self._is_free:
            return ()
        return tuple(RigidMotion(body.turn, body.shift) for body in bodies_ticks(records).bodies)


class HandRecords:
    """A hand of a session's file, `number` of its hands; `lost` is kept up to date by the reader of the rings."""

    def __init__(self, setup: LiveSetup, options: SolverOptions, number: int, facts: Mapping[str, Any]) -> None:
        self.setup, self.worn, self.facts = setup, setup.worn[number], facts
        self.model = self.worn.model
        self.side = self.model.side
        self.lost = dict.fromkeys(RINGS, 0)
        self.tally = LiveTally()
        self.penetration_max = 0.0
        self._channels = len(facts.get("device", {}).get("channels", ()))
        # Table of each ring, and its columns.
        columns = LIVE_TICK_COLUMNS, sample_columns(self._channels), EVENT_COLUMNS
        self._tables = dict(zip(RINGS, zip((LIVE_TICK, LIVE_SAMPLE, LIVE_EVENT), columns)))

    def part(self, described: Mapping[str, Any]) -> HandPart:
        """Return the hand of a file, whose scene is described."""
        setup, facts = self.setup, self.facts
        # From bend to joint angle [rad].
        lines = dict(zip(("slope", "offset"), (line.tolist() for line in self.worn.bend_lines()), strict=True))
        limits = {name: asdict(getattr(setup, name)) for name in ("output", "safety", "real_time")}
        header: dict[str, str | int] = {
            "device": as_text(dict(facts.get("device", {}))),
            "real_time": as_text(facts.get("real_time", {})),
            "pose": str(facts.get("pose", "")),
            "limits": as_text({**limits, "bend": lines}),
            "dry_run": int(setup.dry_run),
            "utc_offset": time.time_ns() - time.monotonic_ns(),
            **self.attributes(np.zeros(0), ""),
        }
        return HandPart(described, hand_arrays(self.model), dict(self._tables.values()), header)

    def attributes(self, counters: AnyArray, ended: str) -> dict[str, str | int]:
        """Return the attributes of /live that change while the session runs."""
        named = as_text(dict(zip(COUNTERS, map(int, counters))))
        return {"counters": named, "ended": ended, **{f"lost_{ring}": self.lost[ring] for ring in RINGS}}

    def count(self, ticks: Records, columns: Mapping[str, AnyArray]) -> None:
        """Count ticks with their columns in the figures."""
        self.tally.count(ticks)
        # The depth of a hand that is not finite is NaN.
        self.penetration_max = float(np.fmax.reduce(columns["penetration_depth"], initial=self.penetration_max))

    def tables(self, taken: Taken) -> dict[str, dict[str, AnyArray]]:
        """Return the rows of /live."""
        found = {}
        for ring, (first, records) in taken.items():
            table, columns = self._tables[ring]
            rows = found[f"{HANDS}/{self.side}/{table}"] = {
                column.name: column.taken(records) for column in columns if column.source
            }
            if ring != "events":
                rows["record"] = np.arange(first, first + len(records))
            if ring == "samples":
                rows["channel"] = records["channels"][:, : self._channels]
            if ring == "events":
                # In its own table a hand needs no name.
                own = [text.removeprefix(f"{self.side} hand: ".encode()) for text in rows["text"].tolist()]
                rows["text"] = np.array(own, rows["text"].dtype)
        return found


class SessionWriter(ResultWriter):
    """Writes records of the rings block by block, then `complete`; OutputError without a file.

    `options` are those that the loop solves with, `facts` the `SessionMemory.facts` of each hand before the session
    ran. `empty` is True if neither a tick nor a sample has come.
    """

    def __init__(self, path: Path, setup: LiveSetup, options: SolverOptions, *facts: Mapping[str, Any]) -> None:
        self.empty = True
        self.hands = [HandRecords(setup, options, number, of) for number, of in enumerate(facts)]
        self._began, self._both = -1, len(self.hands) > 1
        self._rows = SessionRows(setup, options, len(self.hands))
        bodies = self._rows.bodies
        apart = {HANDS_APART: setup.seen.free is not None or keeps_hands_apart(options)} if self._both else {}
        parts = {}
        for hand in self.hands:
            given = dict(hand.worn.description)
            described = {
                **given,
                "motion": given.get("motion") or "live",
                "rate": setup.rate,
                "duration": setup.duration,
                "device": hand.worn.device.kind,
                **apart,
                **describe_scene(setup.seen, hand.model, options, bodies),
            }
            parts[str(hand.side)] = hand.part(described)
        between = BETWEEN_COLUMNS if self._both else ()
        super().__init__(path, hands=parts, bodies=bodies, columns=between, command=setup.command)

    def write(self, taken: Sequence[Taken], counters: AnyArray, ended: str = "") -> None:
        """Write the records of each hand, with `counters` of the devices and a reason if the recording ends here.

        All hands have the same ticks. The counters have shape (hands, counters), or those of one hand. OutputError if
        the disk is full or gone; the ticks before stay readable.
        """
        taken = [{ring: block for ring, block in of.items() if len(block[1])} for of in taken]
        self.empty = self.empty and not any(of.keys() - {"events"} for of in taken)
        tables = self._tick_tables([of["ticks"] for of in taken]) if "ticks" in taken[0] else {}
        # A tick counts as written with its row of live/tick: its contacts come before that.
        for hand, of in zip(self.hands, taken):
            tables |= hand.tables(of)
        attributes = {
            f"{HANDS}/{hand.side}/{LIVE}": hand.attributes(of, ended)
            for hand, of in zip(self.hands, np.atleast_2d(counters), strict=True)
        }
        self.append(tables, attributes)

    def _tick_tables(self, blocks: Sequence[tuple[int, Records]]) -> dict[str, dict[str, AnyArray]]:
        """Return the rows of the next ticks of all hands."""
        first, bodies = blocks[0]
        if self._began < 0:
            self._began = int(bodies["time_ns"][0])
        records = [records for _, records in blocks]
        tables = self._rows.block(self.ticks, first, records, self._began)
        for hand, taken in zip(self.hands, records, strict=True):
            hand.count(taken, tables[f"{HANDS}/{hand.side}/{TICK}"])
        return tables

    def complete(self, ended: str, counters: AnyArray, missed: int, missed_by: Mapping[str, int]) -> Path:
        """Write the summary, and mark the file complete.

        `ended` and `counters` are as in `write`, which raises the same; the others as of `session_figures`.
        """
        self.write([{} for _ in self.hands], counters, ended)
        return self.finish(
            {
                hand.side: session_figures(hand.tally, missed, missed_by, hand.penetration_max, hand.lost)
                for hand in self.hands
            }
        )


def as_text(value: Any) -> str:
    """Return plain values as the JSON text of an attribute."""
    return json.dumps(value, sort_keys=True, ensure_ascii=False)


class Recorder:
    """Reads the rings of a session and writes its file; `stop` is a signal handler."""

    def __init__(self, setup: LiveSetup, memory: SessionMemory) -> None:
        assert setup.record is not None
        self._path = setup.record
        self._setup = setup
        self._memory = memory
        self._ticks = TickReader(memory)
        self._readers = [{ring: RingReader(getattr(hand, ring)) for ring in RINGS[1:]} for hand in memory.hands]
        self._parent = os.getppid()
        self._loop = LoopProcess(memory.status)
        self._stop = False

    def stop(self, number: int, frame: FrameType | None) -> None:
        """Request `run` to write the records that are there, and end."""
        self._stop = True

    def run(self) -> None:
        """Record until the session has ended; raises OutputError if the file cannot be written."""
        check_result_path(self._path)
        options = loop_options(self._setup.options, self._setup.rate)
        # Kernels that measure penetration are compiled before ticks wait.
        models = [worn.model for worn in self._setup.worn]
        two = len(models) > 1
        warm_up(models[0], options, None if two else self._setup.seen.free)
        if two:
            flat = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 5, 3)), np.zeros((1, 5))
            distance_of_hands(models, [forward_kinematics(model, *flat) for model in models])
        while not all(hand.facts.read() for hand in self._memory.hands):
            # The glove is being connected; without it there is no session.
            if self._end() or self._stop:
                return
            self._loop.wait(POLL)
        facts = [hand.facts.read() for hand in self._memory.hands]
        with SessionWriter(self._path, self._setup, options, *facts) as writer:
            ended = self._follow(writer)
            become_ordinary()
            if writer.empty:
                return
            if ended == CUT_SHORT:
                writer.write([{} for _ in writer.hands], self._counters, ended)
                return
            status = self._memory.status
            writer.complete(ended, self._counters, int(status["missed"]), by_name(status["missed_by"]))

    @property
    def _counters(self) -> AnyArray:
        return np.stack([hand.status["counters"] for hand in self._memory.hands])

    def _follow(self, writer: SessionWriter) -> str:
        """Write block after block until the session has ended; returns the reason."""
        written = time.monotonic()
        while True:
            # Read before the rings: all records before the end are read after it.
            ended = self._end()
            over, now = bool(ended) or self._stop, time.monotonic()
            waiting = self._memory.ticks.written - self._ticks.next
            if not over and waiting < CHUNK_TICKS and now - written < LONGEST_WAIT:
                self._loop.wait(POLL)
                continue
            first, ticks = self._ticks.read_hands(BLOCK_RECORDS)
            taken = [{"ticks": (first, records)} for records in ticks]
            for hand, of, readers in zip(writer.hands, taken, self._readers):
                hand.lost["ticks"] = self._ticks.lost
                for ring, reader in readers.items():
                    of[ring] = reader.read(BLOCK_RECORDS)
                    hand.lost[ring] = reader.lost
            writer.write(taken, self._counters)
            written = now
            self._memory.tell(recorder_ticks=writer.ticks, recorder_lost=self._ticks.lost)
            if over and all(len(records) < BLOCK_RECORDS for of in taken for _, records in of.values()):
                return ended or CUT_SHORT

    def _end(self) -> str:
        """Return the reason why the session has ended, "" while it goes on."""
        status = self._memory.status
        self._loop.wait()
        if status["stage"] == Stage.ENDED:
            return str(self._memory.facts.read().get("reason") or LOOP_DIED)
        if self._loop.gone:
            return LOOP_DIED
        if not self._loop.known and os.getppid() != self._parent:
            return "the session's supervisor died before the loop began"
        return ""


def main(arguments: Sequence[str] | None = None) -> int:
    """Record a session; returns the exit code."""
    setup, memory = process_setup("recorder", arguments)
    keep_off(setup.real_time.loop_cpu)
    become_real_time(replace(setup.real_time, priority=PRIORITY, lock_memory=False, cpu=-1, freeze_gc=False))
    recorder = Recorder(setup, memory)
    # Ctrl-C is for the session: its end is recorded too.
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, recorder.stop)

    def failed(text: str) -> None:
        memory.status["recorder_failed"] = 1

    return exit_code(recorder.run, failed)


if __name__ == "__main__":
    sys.exit(main())

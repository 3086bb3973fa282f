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
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any, Self

import numpy as np

from hhsim.arrays import AnyArray, Records
from hhsim.live.device import COUNTERS
from hhsim.live.ipc.config import LiveSetup
from hhsim.live.ipc.session_memory import SessionMemory, TickReader, exit_code, session_process
from hhsim.live.ipc.status import LoopProcess, Stage
from hhsim.live.loop.loop import loop_options
from hhsim.live.real_time import become_ordinary, become_real_time, keep_off
from hhsim.live.session.statistics import LiveTally, session_figures
from hhsim.live.session.tick_block import SessionColumns
from hhsim.live.shared_memory import RingReader
from hhsim.replay.stored_scene import describe_scene, hand_arrays
from hhsim.result.miss_cause import by_name
from hhsim.result.reader import CHUNK_TICKS, check_result_path
from hhsim.result.schema import (
    CONTACT,
    EVENT_COLUMNS,
    HANDS,
    LIVE,
    LIVE_EVENT,
    LIVE_SAMPLE,
    LIVE_TICK,
    LIVE_TICK_COLUMNS,
    Column,
    hand_tables,
    sample_columns,
)
from hhsim.result.writer import HandPart, ResultWriter
from hhsim.solver.free_object import FreeObject
from hhsim.solver.hand_solver import warm_up
from hhsim.solver.options import SolverOptions

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


class SessionWriter:
    """Takes records as they come out of the rings, and writes them block by block; OutputError without a file.

    `options` are those that the loop solves with, `facts` the `SessionMemory.facts` before the session ran. `lost` is
    kept up to date by the reader of the rings; `empty` is True if neither a tick nor a sample has come.
    """

    def __init__(self, path: Path, setup: LiveSetup, options: SolverOptions, facts: Mapping[str, Any]) -> None:
        self.lost = dict.fromkeys(RINGS, 0)
        self.empty = True
        self.tally = LiveTally()
        self.penetration_max = 0.0
        device = dict(facts.get("device", {}))
        self._channels = len(device.get("channels", ()))
        self._sample_columns = sample_columns(self._channels)
        self._columns = SessionColumns(setup, options)
        self._waiting: dict[str, list[tuple[int, Records]]] = {ring: [] for ring in RINGS}
        self._began = -1
        description, bodies = dict(setup.description), self._columns.bodies
        free = next((FreeObject.from_json(of.properties) for of in bodies.values() if of.kind == "free"), None)
        scene = {
            **description,
            "motion": description.get("motion") or "live",
            "rate": setup.rate,
            "duration": setup.duration,
            "device": setup.device.kind,
            **describe_scene(setup.mesh, setup.tree, setup.hand, options, bodies, free),
        }
        header: dict[str, str | int] = {
            "device": as_text(device),
            "real_time": as_text(facts.get("real_time", {})),
            "pose": str(facts.get("pose", "")),
            "limits": as_text(setup.limits_json()),
            "dry_run": int(setup.dry_run),
            "utc_offset": time.time_ns() - time.monotonic_ns(),
            "counters": as_text({}),
            **self._lost_attributes(),
            "ended": "",
        }
        tables = {LIVE_TICK: LIVE_TICK_COLUMNS, LIVE_SAMPLE: self._sample_columns, LIVE_EVENT: EVENT_COLUMNS}
        self._side = setup.hand.side
        hands = {str(self._side): HandPart(scene, hand_arrays(setup.hand), tables, header)}
        self._writer = ResultWriter(path, hands=hands, bodies=bodies, command=setup.command)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: Any) -> None:
        self._writer.__exit__(*error)

    @property
    def ticks(self) -> int:
        """Number of ticks written so far."""
        return self._writer.ticks

    @property
    def waiting_ticks(self) -> int:
        """Number of ticks in the next block."""
        return sum(len(records) for _, records in self._waiting["ticks"])

    def take(self, ring: str, first: int, records: Records) -> None:
        """Keep records of one of `RINGS` for the next block; `first` is the number of the first one in the ring."""
        if len(records):
            self._waiting[ring].append((first, records))
            self.empty = self.empty and ring == "events"

    def write(self, counters: AnyArray, ended: str = "") -> None:
        """Write the records that were taken, with `counters` of the device and a reason if the recording ends here.

        OutputError if the disk is full or gone; the ticks before stay readable.
        """
        taken, self._waiting = self._waiting, {ring: [] for ring in RINGS}
        ticks, live, contacts = [], [], []
        bodies: dict[str, list[dict[str, AnyArray]]] = {}
        row = self._writer.ticks
        for first, records in taken["ticks"]:
            if self._began < 0:
                self._began = int(records["time_ns"][0])
            of_hand, of_bodies = self._columns.block(first, records, self._began)
            ticks.append(of_hand)
            for group, rows in of_bodies.items():
                bodies.setdefault(group, []).append(rows)
            self.tally.count(records)
            # The depth of a hand that is not finite is NaN.
            depths = ticks[-1]["penetration_depth"]
            self.penetration_max = float(np.fmax.reduce(depths, initial=self.penetration_max))
            live.append(_numbered(LIVE_TICK_COLUMNS, first, records))
            contacts.append(self._columns.contacts(row, records))
            row += len(records)
        samples = [
            _numbered(self._sample_columns, first, records) | {"channel": records["channels"][:, : self._channels]}
            for first, records in taken["samples"]
        ]
        events = [_fields(EVENT_COLUMNS, records) for _, records in taken["events"]]
        # A tick counts as written with its row of live/tick: its contacts come before that.
        hand = f"{HANDS}/{self._side}"
        tables = {CONTACT: contacts, **bodies}
        tables |= {f"{hand}/{LIVE_TICK}": live, f"{hand}/{LIVE_SAMPLE}": samples, f"{hand}/{LIVE_EVENT}": events}
        named = as_text(dict(zip(COUNTERS, map(int, counters), strict=True)))
        attributes: dict[str, str | int] = {"counters": named, "ended": ended, **self._lost_attributes()}
        joined = {group: _joined(rows) for group, rows in tables.items()}
        of_ticks = hand_tables(self._side, _joined(ticks)) if ticks else {}
        self._writer.append({**of_ticks, **joined}, {f"{hand}/{LIVE}": attributes})

    def finish(self, ended: str, counters: AnyArray, missed: int, missed_by: Mapping[str, int]) -> Path:
        """Write the records that were taken and the summary, and mark the file complete.

        `ended` and `counters` are as in `write`, which raises the same; the others as of `session_figures`.
        """
        self.write(counters, ended)
        figures = session_figures(self.tally, missed, missed_by, self.penetration_max, self.lost)
        return self._writer.finish({self._side: figures})

    def _lost_attributes(self) -> dict[str, int]:
        return {f"lost_{ring}": self.lost[ring] for ring in RINGS}


def _fields(columns: Sequence[Column], records: Records) -> dict[str, AnyArray]:
    return {column.name: column.taken(records) for column in columns if column.source}


def _numbered(columns: Sequence[Column], first: int, records: Records) -> dict[str, AnyArray]:
    return {"record": np.arange(first, first + len(records)), **_fields(columns, records)}


def _joined(blocks: list[dict[str, AnyArray]]) -> dict[str, AnyArray]:
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]} if blocks else {}


def as_text(value: Any) -> str:
    """Return plain values as the JSON text of an attribute."""
    return json.dumps(value, sort_keys=True, ensure_ascii=False)


class Recorder:
    """Reads the rings of a session and writes its file; `stop` is a signal handler."""

    def __init__(self, setup: LiveSetup, memory: SessionMemory) -> None:
        if setup.record is None:
            raise ValueError("the session is not to be recorded")
        self._path = setup.record
        self._setup = setup
        self._memory = memory
        self._readers = {ring: RingReader(getattr(memory, ring)) for ring in RINGS} | {"ticks": TickReader(memory)}
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
        if self._setup.bodies is None:
            warm_up(self._setup.hand, options, self._setup.free)
        while not self._memory.facts.read():
            # The glove is being connected; without it there is no session.
            if self._end() or self._stop:
                return
            self._loop.wait(POLL)
        with SessionWriter(self._path, self._setup, options, self._memory.facts.read()) as writer:
            ended = self._follow(writer)
            become_ordinary()
            if writer.empty:
                return
            status = self._memory.status
            if ended == CUT_SHORT:
                writer.write(status["counters"], ended)
                return
            writer.finish(ended, status["counters"], int(status["missed"]), by_name(status["missed_by"]))
            status["recorder_ticks"], status["recorder_lost"] = writer.ticks, writer.lost["ticks"]

    def _follow(self, writer: SessionWriter) -> str:
        """Write block after block until the session has ended; returns the reason."""
        written, status = time.monotonic(), self._memory.status
        while True:
            # Read before the rings: all records before the end are read after it.
            ended = self._end()
            more = False
            for ring, reader in self._readers.items():
                first, records = reader.read(BLOCK_RECORDS)
                writer.take(ring, first, records)
                writer.lost[ring] = reader.lost
                more = more or len(records) == BLOCK_RECORDS
            now = time.monotonic()
            over = not more and (bool(ended) or self._stop)
            if over or writer.waiting_ticks >= CHUNK_TICKS or now - written >= LONGEST_WAIT:
                writer.write(status["counters"])
                written = now
            status["recorder_ticks"], status["recorder_lost"] = writer.ticks, writer.lost["ticks"]
            if over:
                return ended or CUT_SHORT
            if not more:
                self._loop.wait(POLL)

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
    setup: LiveSetup
    setup, memory = session_process("recorder", arguments)
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

"""Writes a live session to its file: ticks as in any result, and its own tables under /live.

docs/files.md has the attributes of /live. `counters` and the lost records change while the session runs, and are those
of the last block if it was cut short; `ended` is then "".
"""

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np

from hhsim.arrays import AnyArray, Records
from hhsim.live.device import COUNTERS
from hhsim.live.ipc.config import LiveSetup
from hhsim.live.session.statistics import LiveTally, session_figures
from hhsim.live.session.tick_block import SessionColumns
from hhsim.replay.stored_scene import describe_scene, static_arrays
from hhsim.result.schema import (
    CONTACT,
    EVENT_COLUMNS,
    LIVE,
    LIVE_EVENT,
    LIVE_SAMPLE,
    LIVE_TICK,
    LIVE_TICK_COLUMNS,
    Column,
    sample_columns,
)
from hhsim.result.writer import ResultWriter
from hhsim.solver.options import SolverOptions

RINGS = ("ticks", "samples", "events")


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
        description, free = dict(setup.description), setup.free
        static = static_arrays(setup.mesh, setup.tree, setup.hand, *setup.object_pose())
        scene = {
            **description,
            "motion": description.get("motion") or "live",
            "rate": setup.rate,
            "duration": setup.duration,
            "device": setup.device.kind,
            **describe_scene(setup.mesh, setup.tree, setup.hand, options, static, free),
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
        about: dict[str, Any] = {"scene": scene, "static": static, "tables": tables, "attributes": {LIVE: header}}
        self._writer = ResultWriter(path, **about, command=setup.command, free=free is not None)

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
        row = self._writer.ticks
        for first, records in taken["ticks"]:
            if self._began < 0:
                self._began = int(records["time_ns"][0])
            ticks.append(self._columns.block(first, records, self._began))
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
        # A tick counts as written with its row of /live/tick: its contacts come before that.
        tables = {CONTACT: contacts, LIVE_TICK: live, LIVE_SAMPLE: samples, LIVE_EVENT: events}
        named = as_text(dict(zip(COUNTERS, map(int, counters), strict=True)))
        attributes: dict[str, str | int] = {"counters": named, "ended": ended, **self._lost_attributes()}
        others = {group: _joined(rows) for group, rows in tables.items()}
        self._writer.append(_joined(ticks), others, {LIVE: attributes})

    def finish(self, ended: str, counters: AnyArray, missed: int, missed_by: Mapping[str, int]) -> Path:
        """Write the records that were taken and the summary, and mark the file complete.

        `ended` and `counters` are as in `write`, which raises the same; the others as of `session_figures`.
        """
        self.write(counters, ended)
        return self._writer.finish(session_figures(self.tally, missed, missed_by, self.penetration_max, self.lost))

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

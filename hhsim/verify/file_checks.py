"""Claims of a file about itself: seal and schema, the stamps of its ticks, measured times, and commands to a glove."""

import h5py
import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import BoolArray
from hhsim.hand.model import SIDES
from hhsim.metrics.run.registry import run_figure
from hhsim.metrics.run_ticks import ticks_alone
from hhsim.motion.trajectory import TickPhase
from hhsim.replay.stored_scene import part_words, stored_checksums
from hhsim.result import schema
from hhsim.result.reader import Result
from hhsim.system.hdf5_input import open_hdf5
from hhsim.verify.claim import HOLDS, NOT_CLAIMED, Claim, all_true, difference, judged
from hhsim.verify.second_run import is_measured

LARGEST, LEAST_SQUARE = 1e6, 1e-12
"""Limits of a usable hand: sum of its absolute values [m, rad], and squared length of its quaternion."""
STAMP = 1e-9
"""Tolerance between a stamp and its tick [s]."""
SAME = 1e-9
"""Relative rounding of figures of time."""
CLOCK = 5e-10
"""Half a nanosecond [s]: times are whole ones."""
BETWEEN_CLOCKS = 1e-3
"""Longest interrupt between the readings of two clocks [s]."""
SLICE = 2e-2
"""Longest time in which threads that help go on while the tick's own one waits between two clocks [s]."""


def file_claims(result: Result) -> list[Claim]:
    """Judge seal, schema, stamps and measured times, and of a session the commands to the glove."""
    judges = [_complete, _checksums, schema_claim, _time, _durations]
    return [judge(result) for judge in (*judges, *([] if result.live is None else [_commands]))]


def follows(result: Result) -> NDArray[np.bool_]:
    """True for ticks whose row before is the tick before: not the first, nor after a session's gap; shape (T,)."""
    after = np.zeros(result.ticks, bool)
    after[1:] = True if result.live is None else np.diff(result["live/tick/record"]) == 1
    return after


def _complete(result: Result) -> Claim:
    says = "the run was not stopped: the file is complete"
    if result.complete:
        stated = result.scene.get("ticks", result.ticks)
        if stated != result.ticks:
            return all_true("complete", says, [True], note=f"of {stated} ticks that it says it has {result.ticks:,}")
        return Claim("complete", says, HOLDS, checked=result.ticks)
    if figures := sorted(result.summary):
        # The summary is written when the run has ended.
        return all_true("complete", says, [True], note=f"it is said to be stopped, and has figures: {figures[0]}, …")
    return Claim("complete", says, NOT_CLAIMED, checked=result.ticks, note="the run was stopped; its ticks are judged")


def _checksums(result: Result) -> Claim:
    found, stated = stored_checksums(result), result.scene["checksums"]
    wrong = {part_words(part): digest != stated.get(part) for part, digest in found.items()}
    names = ", ".join(what for what, differs in wrong.items() if differs)
    note = f"not those of the run: {names}" if names else ""
    return all_true("checksums", "bodies, trees and hand are those of the run", list(wrong.values()), note=note)


def _time(result: Result) -> Claim:
    """Judge the stamps of ticks; of the frames of a repaired recording some may be lost."""
    ticks, time, period = np.arange(result.ticks), result["time"], 1.0 / result.rate
    if result.live is not None:
        deadline = np.asarray(result["live/tick/deadline"])
        says, off = "the time of a tick is that of its deadline", np.abs(time - 1e-9 * (deadline - deadline[0]))
    else:
        says, off = f"a tick every {1e3 * period:g} ms from 0 on, the solver's period", np.abs(time - ticks * period)
        if "recording" in result.scene:
            step = np.diff(time)
            says = "frames one after the other from 0 s on, the solver's period apart in the median"
            off = np.append(abs(time[0]), np.where(step > 0.0, abs(np.median(step) - period), np.inf))
        off = np.maximum(off, abs(float(result.scene["solver"]["period"]) - period))
    return judged("time", says, off, STAMP, "s", "rounding of time stamps", ticks=ticks)


def usable(result: Result) -> BoolArray:
    """True for ticks whose haptic hand is finite, of plausible size, with a quaternion of some length; shape (T,)."""
    parts = [np.asarray(result[f"haptic/{name}"]) for name in ("position", "flexion", "abduction")]
    total = np.sum([np.abs(values).reshape(result.ticks, -1).sum(axis=1) for values in parts], axis=0)
    square = (np.asarray(result["haptic/orientation"]) ** 2).sum(axis=1)
    return np.asarray((total < LARGEST) & (square > LEAST_SQUARE) & (square < LARGEST))


def _durations(result: Result) -> Claim:
    names = ("detect", "palm", "fingers", "force", "total", "total_cpu")
    *parts, total, cpu = (1e-9 * np.asarray(result[f"duration/{name}"], np.float64) for name in names)
    off = np.maximum(np.sum(parts, axis=0) - total, -np.min([*parts, total, cpu], axis=0))
    if result.gives("work"):
        threads = int(result.scene["solver"]["threads"])
        off = np.maximum(off, cpu - threads * total - BETWEEN_CLOCKS - (threads - 1) * SLICE)
    wrong: list[str] = []
    if result.complete and result.live is None:
        ticks = ticks_alone(result)
        for name in filter(is_measured, result.summary):
            stored, own = result.summary[name], run_figure(name, ticks)
            known = isinstance(stored, float | int | np.number)
            if not known or difference(np.array(stored), np.array(own)) > SAME * (CLOCK + abs(own)):
                wrong.append(f"{name} is stored as {stored}, the ticks give {own}")
    says = "the parts of a tick's time fit in the whole, as do its threads, and figures of time are those of the ticks"
    why = "one clock measures all; of CPU time an interrupt of 1 ms, of threads that help 20 ms"
    off = np.where(off > CLOCK, off, np.inf if wrong else 0.0)
    return judged("times", says, off, 0.0, "s", why, note="; ".join(wrong))


def _commands(result: Result) -> Claim:
    """Judge that a session leaves every finger free in ticks with a reason for it."""
    stiffness = np.asarray(result["live/tick/command_stiffness"])
    wrong = (np.asarray(result["live/tick/safety"]) != 0) & ~(stiffness <= 0.0).all(axis=1)
    says = "with any reason in safety, no finger of the glove is held"
    return all_true("commands", says, wrong, ticks=np.arange(result.ticks))


def schema_claim(result: Result) -> Claim:
    """Judge that each dataset of the file is a known one, with the unit and the description of its name."""
    known: dict[str, schema.Column | None] = dict.fromkeys(f"phase/{name}" for name in TickPhase._fields)
    for side in SIDES:
        groups = {
            "": schema.HAND_STATIC,
            "tick/": schema.hand_columns(),
            "skin/": schema.SKIN_COLUMNS,
            f"{schema.LIVE_TICK}/": schema.LIVE_TICK_COLUMNS,
            f"{schema.LIVE_SAMPLE}/": schema.sample_columns(0),
            f"{schema.LIVE_EVENT}/": schema.EVENT_COLUMNS,
        }
        known |= {f"hands/{side}/{of}{one.name}": one for of, columns in groups.items() for one in columns}
    for body in result.bodies:
        known |= {f"bodies/{body}/{column.name}": column for column in schema.BODY_STATIC}
        known |= {f"bodies/{body}/tick/{column.name}": column for column in schema.BODY_COLUMNS}
    known |= {f"contact/{column.name}": column for column in schema.CONTACT_COLUMNS}
    known |= {f"tick/{column.name}": column for column in (schema.TIME, *schema.BETWEEN_COLUMNS)}
    known |= {f"{schema.FRAME}/{column.name}": None for column in schema.POSE_COLUMNS}
    with open_hdf5(result.path) as file:
        found: dict[str, h5py.Dataset] = {}
        file.visititems(lambda path, item: found.update({path: item} if isinstance(item, h5py.Dataset) else {}))
        wrong = {
            path: path not in known
            or (
                (column := known[path]) is not None
                and (item.attrs.get("units"), item.attrs.get("long_name")) != (column.units, column.long_name)
            )
            for path, item in found.items()
        }
    note = ", ".join(path for path, differs in wrong.items() if differs)
    says = "each dataset is a known one, with the unit and the description of its name"
    return all_true("schema", says, [*wrong.values()], note=note)

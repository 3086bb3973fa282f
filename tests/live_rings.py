"""A session whose rings a test fills itself: ticks of the real solver, samples that are numbered."""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sphere_scenes import bumpy_ball

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.live.device import COUNTERS, GLOVE_SAMPLE
from hhsim.live.gloves import PoseConfig, configure
from hhsim.live.processes import SharedRing, Stage, write_setup
from hhsim.live.session.loop import loop_options
from hhsim.live.session.memory import EVENT, LIVE_TICK, SessionMemory
from hhsim.live.session.recorder import SessionWriter
from hhsim.live.session.setup import LiveSetup, WornGlove
from hhsim.result.reader import Result, load_result
from hhsim.result.safety import Safety
from hhsim.scene.scene import Scene, make_scene
from hhsim.scene.script import parse_script
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import HandSolver
from tools.shapes.generators import sphere

Records = NDArray[Any]

SCRIPT = """
title = "short"
[[phase]]
name = "approach"
duration = 0.2
[[phase]]
name = "grasp"
duration = 0.4
[[phase]]
name = "hold"
duration = 0.1
"""
PERIOD = 1_000_000
BEGAN = 5_000_000_000_000
"""CLOCK_MONOTONIC of the first deadline [ns]."""
SAMPLE_TICKS = 5
"""Ticks a sample: a glove of 200 Hz."""
CHANNELS = ("thumb_bend", "index_bend", "a/b")
GRANTED = {"fifo": 0, "memory_locked": False, "timer_slack_ns": 50_000, "cpu": -1, "gc_frozen": False}
FACTS: dict[str, Any] = {
    "real_time": {**GRANTED, "refused": ["not allowed"]},
    "device": {"name": "test", "hand": "right", "channels": list(CHANNELS), "unit": "count", "doubtful": []},
    "pose": "fixed",
}


@cache
def grasp() -> Scene:
    """A bumpy ball and how a hand closes on it."""
    script = parse_script(SCRIPT, name="short", where="short")
    return make_scene(sphere(0.076, 3), bumpy_ball(200), HandModel.default(), script)


def make_setup(record: Path | None, options: SolverOptions | None = None) -> LiveSetup:
    """A session on a bumpy ball; the object's own frame is not the world's."""
    scene = grasp()
    return LiveSetup(
        scene=scene.first(1),
        worn=(WornGlove(scene.hands[0].model, configure("sim"), PoseConfig(), {"object": "ball", "seed": 3}),),
        options=options or SolverOptions(),
        record=record,
        command=("hhsim", "live", "glove"),
    )


def solved_ticks(setup: LiveSetup) -> Records:
    """700 ticks as the loop publishes them: a grasp."""
    ticks = grasp().hands[0].ticks
    solver = HandSolver(setup.worn[0].model, setup.seen.tree.arrays(), loop_options(setup.options, setup.rate))
    haptic = {name: getattr(ticks, name)[:700] for name in HandConfiguration._fields}
    fields = solver.run(*haptic.values())._asdict()
    fields |= {f"haptic_{name}": values for name, values in haptic.items()}
    rows, count = np.zeros(700, LIVE_TICK), np.arange(700)
    for name, values in fields.items():
        rows[name] = values
    rows["tick"] = count
    rows["time_ns"] = BEGAN + PERIOD * count
    rows["wakeup_ns"] = 1000 + count
    rows["latency_ns"] = np.where(count % SAMPLE_TICKS == 0, 20_000 + count, -1)
    rows["input_seq"] = count // SAMPLE_TICKS
    rows["command_bend"] = 0.001 * count[:, None]
    rows["safety"][0] = Safety.NO_INPUT_YET
    return rows


def numbered_samples(ticks: Records) -> Records:
    """The samples that these ticks used; every tenth is one that is not good."""
    rows = np.zeros(len(ticks) // SAMPLE_TICKS, GLOVE_SAMPLE)
    first = ticks[::SAMPLE_TICKS]
    rows["seq"] = np.arange(len(rows))
    rows["time_ns"] = first["time_ns"] - 100_000
    rows["handed_ns"] = rows["time_ns"] + 10_000
    rows["device_time_ns"] = rows["device_seq"] = -1
    rows["battery"] = 77
    rows["good"] = rows["seq"] % 10 != 9
    rows["channels"] = np.nan
    rows["channels"][:, : len(CHANNELS)] = rows["seq"][:, None] + 0.25 * np.arange(len(CHANNELS))
    rows["flexion"], rows["abduction"] = first["haptic_flexion"], first["haptic_abduction"]
    return rows


def pour(ring: SharedRing, records: Records) -> None:
    """Publish records as a writer does."""
    for record in records:
        ring.records[ring.written % ring.capacity] = record
        ring.publish()


def ended(memory: SessionMemory, pid: int, reason: str = "duration") -> None:
    for hand in memory.hands:
        hand.status["loop_pid"] = pid
        hand.facts.write({**FACTS, "reason": reason})
        hand.status["stage"] = Stage.ENDED


@contextmanager
def session_process(setup: LiveSetup, memory: SessionMemory, *words: str) -> Iterator[subprocess.Popen[str]]:
    """A process of a session as the supervisor starts it, by Python's words for its module."""
    descriptor = write_setup(setup, memory)
    command, inherited = [sys.executable, *words, "--setup", str(descriptor)], [descriptor, *memory.descriptors]
    with subprocess.Popen(command, pass_fds=inherited, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()
            os.close(descriptor)


def session_file(
    path: Path,
    ticks: Records,
    reason: str,
    events: Sequence[tuple[int, int, str]] = (),
    samples: Records | None = None,
    **counted: int,
) -> Result:
    """Write a session of these ticks, and load it.

    Args:
        path: Of its file.
        ticks: As the loop publishes them; each fifth used a sample.
        reason: Of its end.
        events: Time [ns], level and text of each.
        samples: Of the glove; numbered ones where none are given.
        counted: Counters of the glove by their names.
    """
    setup, rows = make_setup(path), np.zeros(len(events), EVENT)
    for row, (time_ns, level, text) in zip(rows, events):
        row["time_ns"], row["level"], row["text"] = time_ns, level, text.encode()
    counters = np.array([counted.get(name, 0) for name in COUNTERS])
    samples = numbered_samples(ticks) if samples is None else samples
    taken = {"ticks": (0, ticks), "samples": (0, samples), "events": (0, rows)}
    with SessionWriter(path, setup, loop_options(setup.options, setup.rate), {**FACTS, "real_time": {}}) as writer:
        writer.write([taken], counters)
        writer.complete(reason, counters, 0, {})
    return load_result(path)

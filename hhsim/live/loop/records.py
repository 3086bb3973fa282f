"""Records of the compiled loop (`hhsim.kernels.live`), filled from a session's settings; each has shape (1,)."""

import math
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.kernels.live.deadlines import DEADLINES, begin_periods
from hhsim.kernels.live.finger_command import COMMANDER
from hhsim.kernels.live.interlock import DRY_RUN, INTERLOCK
from hhsim.kernels.live.plausibility import WATCH, begin_watch
from hhsim.live.device import GloveInfo
from hhsim.live.ipc.config import OutputLimits, SafetyLimits
from hhsim.solver.workspace import zeroed

NEVER = 1 << 60
"""More periods than a session can miss."""


def deadline_record(period_ns: int, now_ns: int) -> Any:
    """Return `DEADLINES` one period apart, the first one period after `now_ns`, CLOCK_MONOTONIC [ns]."""
    deadlines = zeroed(DEADLINES)
    deadlines[0].period_ns = period_ns
    begin_periods(deadlines[0], now_ns)
    return deadlines


def commander_record(
    limits: OutputLimits, bend_lines: tuple[FloatArray, FloatArray], period: float, *, feels: bool = False
) -> Any:
    """Return the `COMMANDER` of free fingers, with lines as of `Calibration.bend_lines` and the period of a tick [s].

    `feels` is True if the glove takes forces, or powers that are made of them.
    """
    commander = zeroed(COMMANDER)
    at = commander[0]
    slope, offset = bend_lines
    size = (slope * slope).sum(axis=1, keepdims=True)
    at.configured[:] = limits.stiffness
    at.rise = limits.stiffness_rise * period
    at.move = limits.bend_speed * period
    at.fall[:] = at.configured * (period / limits.ease)
    at.ramp_ticks = max(1, math.ceil(limits.ramp / period))
    at.contact_force = limits.contact_force
    at.feels = int(feels)
    # As `DexmoRegression.bends`, with the division done beforehand.
    at.gain[:] = np.divide(slope, size, out=np.zeros_like(slope), where=size > 0.0)
    at.offset[:] = offset
    return commander


def interlock_record(limits: SafetyLimits, *, dry_run: bool = False, period_ns: int = 1_000_000) -> Any:
    """Return the `INTERLOCK` by which `judge` frees the fingers; a dry run sends nothing and needs no watchdog."""
    interlock = zeroed(INTERLOCK)
    at = interlock[0]
    at.stale_ns = round(1e9 * limits.stale)
    at.watchdog_ns = round(1e9 * limits.watchdog_stale)
    at.eased = limits.overruns if limits.after_stall == "ease" else NEVER
    at.released = limits.release_at(period_ns)
    at.watched = limits.watchdog and not dry_run
    at.always = DRY_RUN if dry_run else 0
    return interlock


def watch_record(info: GloveInfo) -> Any:
    """Return the `WATCH` of a glove before its first sample."""
    watch = zeroed(WATCH)
    watch[0].always_free[list(info.kept_free)] = 1
    watch[0].noiseless = info.noiseless
    begin_watch(watch[0])
    return watch

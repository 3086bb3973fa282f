"""Motion of a free object, its slip and creep, and the agreement of forces and motion."""

import math
from functools import partial

import numpy as np

from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.metrics.run_metric import Judged, RunMetric, each_with
from hhsim.metrics.run_ticks import FreeRun, RunTicks

ROUNDING = 1e-9
"""Relative tolerance of the friction cone."""


def _free(run: RunTicks) -> FreeRun:
    assert run.free is not None
    return run.free


def _slip(run: RunTicks, part: slice = slice(None)) -> float:
    """Largest slip of a body of the hand along the object, summed over some ticks [m]."""
    free = _free(run)
    body, tick, slip = (free.contacts[name][free.of_hand] for name in ("body", "tick", "slip"))
    longest = 0.0
    for one in np.unique(body):
        farthest = np.zeros(run.ticks)
        np.maximum.at(farthest, tick[body == one], slip[body == one])
        longest = max(longest, float(farthest[part].sum()))
    return longest


def _creep(run: RunTicks) -> float:
    """Slip of a held object in the second half of a hold, the worst hold [m/s]; NaN where none is held."""
    borne = np.linalg.norm(_free(run)["hand_wrench"][:, :3], axis=1) > 0.0
    found = math.nan
    for hold in run.holds:
        part = slice((hold.start + hold.stop) // 2, hold.stop)
        if part.stop > part.start and borne[part].all():
            found = np.fmax(found, _slip(run, part) * run.rate / (part.stop - part.start))
    return float(found)


def _momentum(run: RunTicks) -> float:
    """Largest residual of m Δv / Δt and the forces [N]; a tick that lags makes a fraction of its change."""
    free = _free(run)
    mass, gravity = free.properties["mass"], np.array(free.properties["gravity"])
    velocity = np.vstack([free.properties["velocity"], free["velocity"]])
    before = velocity[:-1]
    force = free.borne[:, :3] + mass * gravity
    # Damping is implicit: of the velocity at the end of the tick.
    heavier = 1.0 + free.properties["damping"] / run.rate
    whole = (before + force / (mass * run.rate)) / heavier - before
    change, square = np.diff(velocity, axis=0), (whole**2).sum(axis=1)
    part = np.divide((change * whole).sum(axis=1), square, out=np.ones(len(square)), where=square > 0.0)
    late = (run["status"] & (STATUS_LAG | STATUS_STUCK)) != 0
    made = np.where(late, np.clip(part, 0.0, 1.0), 1.0)[:, None]
    off = mass * run.rate * heavier * np.linalg.norm(change - made * whole, axis=1)
    # Where a session's recorder lost ticks, the velocity before is not known.
    return float(off[~run.breaks].max(initial=0.0)) if run.breaks is not None else float(off.max(initial=0.0))


def _outside_cone(run: RunTicks) -> float:
    free = _free(run)
    normal = free.contacts["normal_force"]
    size = np.linalg.norm(free.contacts["friction_force"], axis=1)
    outside = (size > free.friction * normal * (1.0 + ROUNDING)) | (normal < 0.0)
    return 100.0 * float(outside.mean()) if outside.size else 0.0


def _friction_residual(run: RunTicks, share: float) -> float:
    """Percentile of the residuals in ticks with a contact force [m]."""
    free = _free(run)
    found = free["friction_residual"][np.unique(free.contacts["tick"])]
    return float(np.percentile(found, share)) if found.size else 0.0


METRICS = each_with(
    RunMetric(
        "object_raised", "object raised, max", digits=2, unit="mm", less_is_better=False, of_body=True,
        short="object_raised", compute=lambda run: _free(run).raised,
    ),
    RunMetric(
        "object_slip", "slip of a finger on the object, in all", digits=3, unit="mm", short="object_slip", compute=_slip
    ),
    RunMetric(
        "object_creep", "creep of the held object, max", digits=3, unit="µm/s", short="object_creep", compute=_creep
    ),
    RunMetric(
        "object_momentum", "object's momentum less the forces on it, max", digits=6, unit="N", needs=("status",),
        of_body=True, compute=_momentum,
    ),
    RunMetric(
        "cone_outside", "contacts outside their friction cone", digits=3, unit="%", of_body=True,
        compute=_outside_cone, judged=Judged(limit=0.0),
    ),
    RunMetric(
        "table_depth_max", "object in the table, max", digits=3, unit="µm", of_body=True, short="table_depth",
        compute=lambda run: max(0.0, -float(_free(run)["table_distance"].min())), judged=Judged(limit=1e-6),
    ),
    *(
        RunMetric(
            f"friction_residual_{name}", f"friction is off the slip by, {name}", digits=3, unit="µm", of_body=True,
            compute=partial(_friction_residual, share=share),
        )
        for name, share in (("p50", 50.0), ("p99", 99.0), ("max", 100.0))
    ),
    free_only=True,
)  # fmt: skip

"""What a free object does: how far it goes, slips and creeps, and whether forces and motion agree."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.metrics.free_run import FreeRun
from hhsim.metrics.run_metric import Judged, RunMetric
from hhsim.metrics.run_ticks import RunTicks

Array = NDArray[Any]

ROUNDING = 1e-9
"""A force that leaves its cone by no more than this share of μ times the normal force is on it."""


def _free(run: RunTicks) -> FreeRun:
    assert run.free is not None
    return run.free


def _raised(run: RunTicks) -> float:
    return _free(run).raised


def _slip(run: RunTicks) -> float:
    """The farthest that a body of the hand slips along the object, tick by tick added up [m]."""
    free = _free(run)
    body, tick, slip = (free[f"contact/{name}"][free.of_hand] for name in ("body", "tick", "slip"))
    way = 0.0
    for one in np.unique(body):
        farthest = np.zeros(run.ticks)
        np.maximum.at(farthest, tick[body == one], slip[body == one])
        way = max(way, float(farthest.sum()))
    return way


def _creep(run: RunTicks) -> float:
    """How fast a held object moves in the last half of a hold, the worst hold [m/s]; NaN where none is held."""
    free = _free(run)
    borne = np.linalg.norm(free["object/hand_wrench"][:, :3], axis=1) > 0.0
    found = math.nan
    for hold in run.holds:
        first, last = (hold.start + hold.stop) // 2, hold.stop - 1
        if last > first and borne[first : last + 1].all():
            found = np.fmax(found, free.displacement(first, last) * run.rate / (last - first))
    return float(found)


def _momentum(run: RunTicks) -> float:
    """The largest m Δv / Δt less the forces on the object, in a tick that lags less a share of them [N]."""
    free = _free(run)
    mass, gravity = free.properties["mass"], np.array(free.properties["gravity"])
    velocity = np.vstack([free.properties["velocity"], free["object/velocity"]])
    before = velocity[:-1]
    force = free["object/hand_wrench"][:, :3] + free["object/table_wrench"][:, :3] + mass * gravity
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
    normal = free["contact/normal_force"]
    size = np.linalg.norm(free["contact/friction_force"], axis=1)
    outside = (size > free.friction * normal * (1.0 + ROUNDING)) | (normal < 0.0)
    return 100.0 * float(outside.mean()) if outside.size else 0.0


def _table_depth(run: RunTicks) -> float:
    return max(0.0, -float(_free(run)["object/table_distance"].min()))


def _friction_residuals(run: RunTicks) -> Array:
    """Of the ticks in which a contact bears a force [m]."""
    free = _free(run)
    return np.asarray(free["object/friction_residual"][np.unique(free["contact/tick"])])


def _residual_share(share: float) -> Callable[[RunTicks], float]:
    def compute(run: RunTicks) -> float:
        found = _friction_residuals(run)
        return float(np.percentile(found, share)) if found.size else 0.0

    return compute


METRICS = (
    RunMetric(
        name="object_raised",
        label="object raised, max",
        digits=2,
        unit="mm",
        less_is_better=False,
        place=40,
        free_only=True,
        short="object_raised",
        compute=_raised,
    ),
    RunMetric(
        name="object_slip",
        label="slip of a finger on the object, in all",
        digits=3,
        unit="mm",
        place=41,
        free_only=True,
        short="object_slip",
        compute=_slip,
    ),
    RunMetric(
        name="object_creep",
        label="creep of the held object, max",
        digits=3,
        unit="µm/s",
        place=42,
        free_only=True,
        short="object_creep",
        compute=_creep,
    ),
    RunMetric(
        name="object_momentum",
        label="object's momentum less the forces on it, max",
        digits=6,
        unit="N",
        place=43,
        needs=("status",),
        free_only=True,
        compute=_momentum,
    ),
    RunMetric(
        name="cone_outside",
        label="contacts outside their friction cone",
        digits=3,
        unit="%",
        place=44,
        free_only=True,
        compute=_outside_cone,
        judged=Judged(limit=0.0),
    ),
    RunMetric(
        name="table_depth_max",
        label="object in the table, max",
        digits=3,
        unit="µm",
        place=45,
        free_only=True,
        short="table_depth",
        compute=_table_depth,
        judged=Judged(limit=1e-6),
    ),
    *(
        RunMetric(
            name=f"friction_residual_{name}",
            label=f"friction is off the slip by, {name}",
            digits=3,
            unit="µm",
            place=place,
            free_only=True,
            compute=_residual_share(share),
        )
        for place, name, share in ((46, "p50", 50.0), (47, "p99", 99.0), (48, "max", 100.0))
    ),
)

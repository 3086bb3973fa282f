"""Motion of a free object, its slip, creep and energy, and the agreement of forces and motion."""

import math
from functools import partial

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import conjugate, quaternion_product, rotation_matrix, rotation_vector
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.metrics.metrics import tracking_energy
from hhsim.metrics.run.input_hand import HAPTIC
from hhsim.metrics.run_metric import Judged, RunMetric, each_with
from hhsim.metrics.run_ticks import PALM, FreeRun, RunTicks
from hhsim.result.body import ON_TABLE

ON_CONE = 1e-9
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
    outside = (size > free.friction * normal * (1.0 + ON_CONE)) | (normal < 0.0)
    return 100.0 * float(outside.mean()) if outside.size else 0.0


def _friction_residual(run: RunTicks, share: float) -> float:
    """Percentile of the residuals in ticks with a contact force [m]."""
    free = _free(run)
    found = free["friction_residual"][np.unique(free.contacts["tick"])]
    return float(np.percentile(found, share)) if found.size else 0.0


_MOTION = each_with(
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


GRAPHIC = tuple(name.replace("haptic", "graphic") for name in HAPTIC)
TOTAL = "force/total"
FORCE = 1e-6
"""Share of the forces that their sum may be off by rounding."""
ROUNDING = 1e-14
"""Rounding of a pose [m] or [rad]; times the forces it is the energy that rounding may add [J]."""


def energy_gains(run: RunTicks) -> FloatArray:
    """Energy gained in each tick [J], shape (T,), negative for a loss; NaN where it is not known.

    That is where the tick before is missing, where another hand or body pushes the hand, and where one pushes the
    object in a tick that lags: the stated forces are then of the last program, of which a share was made.

    With the object's kinetic and potential energy K and P and the energy U of the springs between user's hand h and
    shown hand g, it is K(t) - K(t-1) + P(t) - P(t-1) + U(h(t), g(t)) - U(h(t), g(t-1)), less three terms. Both U have
    the user's hand of t, so the work of its motion is left out; so is what another hand or body does to the object.
    Where the hand does not touch the object nothing passes between them: the greater of both gains counts, and what
    the springs lose does not hide what the object gains. Subtracted are the work of finger abduction, which has no
    spring, by the contacts' moments about its axes; the clearance ε, by which a contact may push bodies apart in a
    tick, times the normal forces; and the rounding of poses: `ROUNDING` times m |v| / Δt, m g and the springs' force.
    """
    free = _free(run)
    user, shown = (
        HandConfiguration(free.moved.points(run[at]), free.moved.orientations(run[turn]), run[bend], run[spread])
        for at, turn, bend, spread in (HAPTIC, GRAPHIC)
    )
    mass, gravity = free.properties["mass"], np.array(free.properties["gravity"])
    spin = np.einsum("tji,tj->ti", rotation_matrix(free.moved.turn), free["angular_velocity"])
    kinetic = 0.5 * mass * (free["velocity"] ** 2).sum(axis=1)
    kinetic += 0.5 * np.einsum("ti,ij,tj->t", spin, np.array(free.properties["inertia"]), spin)
    before, after = slice(0, -1), slice(1, None)
    stretched, springs = (tracking_energy(user.at(after), shown.at(part), free.stiffness) for part in (before, after))
    by_others, late = _by_others(free), (run["status"][1:] & (STATUS_LAG | STATUS_STUCK)) != 0
    of_object, of_springs = np.diff(kinetic) - mass * np.diff(free.center, axis=0) @ gravity, springs - stretched
    touches = np.bincount(free.contacts["tick"][free.of_hand], minlength=run.ticks)[1:] > 0
    of_object -= by_others
    gained = np.where(touches, of_object + of_springs, np.maximum(of_object, of_springs))
    load = np.bincount(free.contacts["tick"], free.contacts["normal_force"], run.ticks)
    force = run.rate * np.sqrt(2.0 * mass * np.maximum(kinetic[before], kinetic[after]))
    force += mass * np.linalg.norm(gravity) + np.sqrt(2.0 * free.stiffness.max() * np.maximum(stretched, springs))
    gained -= free.offset * load[1:] + ROUNDING * force + _by_spread(run, shown)[1:]
    gained[_pushed_by_others(run)[1:] | (late & (by_others != 0.0))] = np.nan
    if run.breaks is not None:
        gained[run.breaks[1:]] = np.nan
    return np.concatenate([[np.nan], gained])


def _pushed_by_others(run: RunTicks) -> BoolArray:
    """Return True for ticks in which the force on the hand is not that of its contacts with the object, (T,)."""
    free = _free(run)
    own = np.flatnonzero(free.of_hand)
    force = free.force[own]
    total, tick = np.zeros((run.ticks, 3)), free.contacts["tick"][own]
    np.add.at(total, tick, force)
    size = 1.0 + np.bincount(tick, np.abs(force).sum(axis=1), run.ticks)
    return np.asarray(np.abs(total - free.moved.vectors(run[TOTAL])).max(axis=1) > FORCE * size)


def _by_others(free: FreeRun) -> FloatArray:
    """Work of a second hand's and of other bodies' contacts in each tick but the first [J], shape (T - 1,)."""
    body = free.contacts["body"]
    rows = np.flatnonzero((body > PALM) | (body < ON_TABLE))
    tick, center = free.contacts["tick"][rows], free.center
    normal, turn = free.contacts["normal"][rows], free.moved.turn
    # What is stated is the force on a hand, and of a body that on the object.
    sign = np.where(body[rows] < ON_TABLE, 1.0, -1.0)[:, None]
    force = sign * free.force[rows]
    moment = np.cross(free.contacts["point"][rows] - center[tick], force)
    moment += sign * free.contacts["torsional_moment"][rows, None] * normal
    way = np.diff(center, axis=0, prepend=center[:1])[tick]
    turned = rotation_vector(quaternion_product(turn[1:], conjugate(turn[:-1])))
    angle = np.concatenate([np.zeros((1, 3)), turned])[tick]
    return np.asarray(np.bincount(tick, (force * way + moment * angle).sum(axis=1), len(center))[1:])


def _by_spread(run: RunTicks, shown: HandConfiguration) -> FloatArray:
    """Work of the user by spreading the fingers [J], shape (T,)."""
    free, hand = _free(run), run.hand
    step = np.diff(shown.abduction, axis=0, prepend=shown.abduction[:1])
    body, tick = free.contacts["body"], free.contacts["tick"]
    # Neither the table nor the palm is on a finger.
    finger = np.where((body >= 0) & (body < 15), body // 3, 0)
    rows = np.flatnonzero((body >= 0) & (body < 15) & (step[tick, finger] != 0.0))
    if hand is None or not rows.size:
        return np.zeros(run.ticks)
    tick, finger = tick[rows], finger[rows]
    turned = rotation_matrix(shown.orientation[tick])
    base = shown.position[tick] + np.einsum("cij,cj->ci", turned, hand.base[finger])
    axis = hand.abduction_sign * np.einsum("cij,cj->ci", turned, hand.dorsal[finger])
    normal = free.contacts["normal"][rows]
    moment = np.cross(free.contacts["point"][rows] - base, free.force[rows])
    moment += free.contacts["torsional_moment"][rows, None] * normal
    work = -(axis * moment).sum(axis=1) * step[tick, finger]
    return np.asarray(np.bincount(tick, work, run.ticks), np.float64)


_ENERGY = (
    RunMetric(
        "energy_gained", "energy gained in a tick, max", digits=3, unit="µJ",
        needs=(*HAPTIC, *GRAPHIC, TOTAL, "status"), free_only=True, short="energy_gained",
        compute=lambda run: float(np.fmax.reduce(energy_gains(run), initial=0.0)),
        judged=Judged(rounding=1e-12, limit=0.0),
    ),
)  # fmt: skip

METRICS = (*_MOTION, *_ENERGY)

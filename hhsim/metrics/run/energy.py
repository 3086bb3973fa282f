"""Energy that a free object and the hand's springs gain in a tick beyond the user's work."""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import conjugate, quaternion_product, rotation_matrix, rotation_vector
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.metrics.metrics import tracking_energy
from hhsim.metrics.run.input_hand import HAPTIC
from hhsim.metrics.run_metric import Judged, RunMetric
from hhsim.metrics.run_ticks import PALM, FreeRun, RunTicks
from hhsim.result.contacts import ON_TABLE

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
    free = run.free
    assert free is not None
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
    free = run.free
    assert free is not None
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
    free, hand = run.free, run.hand
    assert free is not None
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


METRICS = (
    RunMetric(
        "energy_gained", "energy gained in a tick, max", digits=3, unit="µJ",
        needs=(*HAPTIC, *GRAPHIC, TOTAL, "status"), free_only=True, short="energy_gained",
        compute=lambda run: float(np.fmax.reduce(energy_gains(run), initial=0.0)),
        judged=Judged(rounding=1e-12, limit=0.0),
    ),
)  # fmt: skip

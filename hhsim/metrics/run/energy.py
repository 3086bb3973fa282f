"""The energy that a free object and the hand's springs gain in a tick, beyond what the user gives them."""

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import rotation_matrix
from hhsim.metrics.metrics import tracking_energy
from hhsim.metrics.run.input_hand import HAPTIC
from hhsim.metrics.run_metric import Judged, RunMetric
from hhsim.metrics.run_ticks import RunTicks

GRAPHIC = tuple(name.replace("haptic", "graphic") for name in HAPTIC)
ROUNDING = 1e-14
"""A pose is rounded by no more than this [m], or [rad]; so much times the forces is what rounding may add [J]."""


def energy_gains(run: RunTicks) -> FloatArray:
    """Energy gained in each tick [J], shape (T,), below 0 where energy is lost; NaN where it is not known.

    With K and P the object's kinetic and potential energy, U the energy of the springs between the user's hand h and
    the shown one g, it is K(t) - K(t-1) + P(t) - P(t-1) + U(h(t), g(t)) - U(h(t), g(t-1)), less three shares that are
    no gain. U is taken twice with the user's hand where it is at t: what its way there stretched the springs by is the
    user's work. The spread of the fingers, which has no spring, follows the user's: by the moments that the contacts
    have about its axes. The clearance ε, up to which a contact may push hand, object and table apart in a tick: ε times
    the normal forces. And the rounding of poses: `ROUNDING` times m |v| / Δt, m g and the springs' force.

    Of the first tick, and of those before which a recorder lost others, it is not known.
    """
    free = run.free
    assert free is not None
    user, shown = (
        HandConfiguration(free.moved.points(run[at]), free.moved.orientations(run[turn]), run[bend], run[spread])
        for at, turn, bend, spread in (HAPTIC, GRAPHIC)
    )
    mass, gravity = free.properties["mass"], np.array(free.properties["gravity"])
    spin = np.einsum("tji,tj->ti", rotation_matrix(free.moved.turn), free["object/angular_velocity"])
    kinetic = 0.5 * mass * (free["object/velocity"] ** 2).sum(axis=1)
    kinetic += 0.5 * np.einsum("ti,ij,tj->t", spin, np.array(free.properties["inertia"]), spin)
    before, after = slice(0, -1), slice(1, None)
    stretched, springs = (tracking_energy(user.at(after), shown.at(part), free.stiffness) for part in (before, after))
    gained = np.diff(kinetic) - mass * np.diff(free.center, axis=0) @ gravity + springs - stretched
    load = np.bincount(free["contact/tick"], free["contact/normal_force"], run.ticks)
    force = run.rate * np.sqrt(2.0 * mass * np.maximum(kinetic[before], kinetic[after]))
    force += mass * np.linalg.norm(gravity) + np.sqrt(2.0 * free.stiffness.max() * np.maximum(stretched, springs))
    gained -= free.offset * load[1:] + ROUNDING * force + _by_spread(run, shown)[1:]
    if run.breaks is not None:
        gained[run.breaks[1:]] = np.nan
    return np.concatenate([[np.nan], gained])


def _by_spread(run: RunTicks, shown: HandConfiguration) -> FloatArray:
    """Work that the user does by spreading the fingers [J], shape (T,)."""
    free, hand = run.free, run.hand
    assert free is not None
    step = np.diff(shown.abduction, axis=0, prepend=shown.abduction[:1])
    body, tick = free["contact/body"], free["contact/tick"]
    # Neither the table nor the palm is on a finger.
    finger = np.where((body >= 0) & (body < 15), body // 3, 0)
    rows = np.flatnonzero((body >= 0) & (body < 15) & (step[tick, finger] != 0.0))
    if hand is None or not rows.size:
        return np.zeros(run.ticks)
    tick, finger = tick[rows], finger[rows]
    turned = rotation_matrix(shown.orientation[tick])
    base = shown.position[tick] + np.einsum("cij,cj->ci", turned, hand.base[finger])
    axis = hand.abduction_sign * np.einsum("cij,cj->ci", turned, hand.dorsal[finger])
    normal = free["contact/normal"][rows]
    force = free["contact/normal_force"][rows, None] * normal + free["contact/friction_force"][rows]
    moment = np.cross(free["contact/point"][rows] - base, force)
    moment += free["contact/torsional_moment"][rows, None] * normal
    work = -(axis * moment).sum(axis=1) * step[tick, finger]
    return np.asarray(np.bincount(tick, work, run.ticks), np.float64)


METRICS = (
    RunMetric(
        name="energy_gained",
        label="energy gained in a tick, max",
        digits=3,
        unit="µJ",
        place=43,
        needs=(*HAPTIC, *GRAPHIC),
        free_only=True,
        short="energy_gained",
        compute=lambda run: float(np.fmax.reduce(energy_gains(run), initial=0.0)),
        judged=Judged(rounding=1e-12, limit=0.0),
    ),
)

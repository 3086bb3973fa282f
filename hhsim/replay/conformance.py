"""Conformance test of a method from outside: its mistakes, one line each."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import WORK_CANDIDATES, WORK_TOUCHING
from hhsim.metrics.metrics import penetration
from hhsim.scene.scene import open_scene
from hhsim.solver.method import FORCES, find_method
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import HandSolver
from hhsim.system.counted import counted
from hhsim.trees.contact_surface import contact_surface

OBJECT, MOTION = "sphere", "grasp"
"""Scene: a ball has no edge that could be blamed."""
OK, WRONG, NOTE = "ok", "wrong", "note"
FOLLOWS = 1e-3
"""A hand that touches nothing and is farther from the user's [m] does not follow it."""
AT_REST = 1e-5
"""A hand that moves by more per tick [m] is not at rest."""


class Finding(NamedTuple):
    """Outcome of one check: its name, `OK`, `WRONG` or `NOTE` (no fault but worth knowing), and a sentence."""

    name: str
    verdict: str
    says: str


def check_method(name: str) -> Iterator[Finding]:
    """Run a method of a name through a short grasp of a ball, and yield what is found, until it fails."""
    try:
        options = SolverOptions(method=name)
    except HhsimError as error:
        yield Finding("import", WRONG, str(error))
        return
    method = find_method(name)
    yield Finding("import", OK, method.summary)
    if method.missing:
        yield Finding("installed", WRONG, method.missing)
        return
    scene = open_scene(OBJECT, MOTION)
    hand, body = scene.hands[0].model, scene.solids[0]
    haptic = HandConfiguration.of(scene.hands[0].ticks).copy()
    # The way to the object and the closing of the fingers, then a hold.
    ticks = next(phase.first_tick for phase in scene.ticks.phases if phase.name == "hold") + 200
    haptic = haptic.part(0, ticks)
    try:
        surface = contact_surface(options.surface, body.placed_mesh, body.placed_tree)
        record, again = (HandSolver(hand, surface, options).run(*haptic) for _ in range(2))
    except HhsimError as error:
        yield Finding("run", WRONG, str(error))
        return
    yield Finding("run", OK, f"{counted(ticks, 'tick')}, each a hand of the right shapes, finite, its quaternion unit")
    pairs = zip(HandConfiguration.of(record), HandConfiguration.of(again))
    differ = np.any([(one != other).reshape(ticks, -1).any(axis=1) for one, other in pairs], axis=0)
    begun = f"a second run differs from tick {int(np.argmax(differ)):,} on"
    says = f"{begun}: its results cannot be run again bit for bit" if differ.any() else ""
    yield _judged("repeatable", "a second run gives the same hands, bit for bit", says)
    near = record.work[:, WORK_CANDIDATES] > 0
    yield _follows(record.position[~near], haptic.position[~near])
    shown = HandConfiguration.of(record).flexion
    beyond = float(np.maximum(hand.flexion_min - shown, shown - hand.flexion_max).max())
    says = f"a joint is {beyond:.3g} rad beyond its limit" if beyond > 1e-6 else ""
    if is_far := bool(says) and float(np.abs(shown).max()) > np.pi:
        says = "joints bend by more than half a turn: degrees?"
    yield _judged("joint limits", "no joint is beyond its limit", says, WRONG if is_far else NOTE)
    moved = float(np.linalg.norm(record.joints[-1] - record.joints[-2], axis=-1).max())
    says = (
        f"after 200 ticks of rest the shown hand still moves by {1e6 * moved:.3g} µm a tick" if moved > AT_REST else ""
    )
    yield _judged("rest", "where the user's hand rests, the shown hand comes to rest", says)
    placed = PlacedHand(record.joints, record.position, record.orientation)
    deepest = float(np.nanmax(penetration(surface.arrays, hand_shape(hand), placed).depth))
    more = ", although it promises not to (never_penetrates)" if method.never_penetrates else ""
    says = f"the shown hand is up to {1e3 * deepest:.3g} mm inside the object{more}" if deepest > 1e-12 else ""
    yield _judged("depth", "no tick penetrates", says, WRONG if method.never_penetrates else NOTE)
    touching = counted(int((record.work[:, WORK_TOUCHING] > 0).sum()), "tick")
    says = "" if near.any() else "the shown hand never comes near the object that the user grasps"
    yield _judged("contact", f"the hand touches the object in {touching}", says, WRONG)
    if FORCES in method.gives:
        yield _pushes(record, near)
    # As in replay's table: a tick in free space may take next to nothing.
    judged = near if near.any() else ~near
    total, native = (1e-3 * np.median(of[judged]) for of in (record.duration_cpu, record.duration[:, 1]))
    own = f", of which {native:.3g} µs are its own by its word" if native > 0.0 else ""
    yield Finding("time", OK, f"a tick in contact takes {total:,.1f} µs of CPU in the median{own}")
    first = 1e-3 * float(record.duration_cpu[0])
    if first > 100.0 * total and first > 1e4:
        advice = f"the first one took {1e-3 * first:.3g} ms: prepare in __init__, which is not timed"
        yield Finding("first tick", NOTE, advice)


def _judged(name: str, fine: str, fault: str, verdict: str = NOTE) -> Finding:
    """Return a finding with a verdict if there is a fault, else the one that all is fine."""
    return Finding(name, verdict, fault) if fault else Finding(name, OK, fine)


def _follows(shown: FloatArray, wanted: FloatArray) -> Finding:
    """Judge how near the shown palm is to the user's in free space, each (T, 3) [m]."""
    if not len(shown):
        return Finding("free space", WRONG, "the shown hand is never farther than the margin from the object")
    worst = float(np.linalg.norm(shown - wanted, axis=1).max())
    if worst <= FOLLOWS:
        return Finding("free space", OK, f"the shown palm follows the user's to {1e3 * worst:.3g} mm")
    says = f"the shown palm is up to {1e3 * worst:.3g} mm off the user's where nothing is near: another unit or frame?"
    return Finding("free space", WRONG, says)


def _pushes(record: TickRecord, near: BoolArray) -> Finding:
    """Judge the forces of ticks, which balance the coupling: Eq. 1 without inertia."""
    size = np.linalg.norm(record.total, axis=1)
    apart = float(size[~near].max(initial=0.0))
    if apart > 1e-3:
        return Finding("forces", NOTE, f"{apart:.3g} N where nothing is within the margin")
    says = "" if float(size.max()) > 0.0 else "it promises forces, and all are 0 in a grasp"
    if float(np.einsum("ti,ti->t", record.total, record.palm_wrench[:, :3]).sum()) < 0.0:
        says = "forces pull the hand towards the user's: meant are those on the hand; turned?"
    return _judged("forces", f"up to {size.max():.3g} N, and they push the shown hand off the user's", says, WRONG)

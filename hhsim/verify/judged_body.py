"""Rigid bodies that a hand touches, object or parts of a thing: the hand as each sees it, and claims of their motion.

A pose p, q of an object that began at P, Q maps x to q Q⁻¹ (x − P) + p; this is inverted, by scipy's rotations.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import AnyArray, FloatArray, IntArray
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import ObjectMotion
from hhsim.replay.stored_scene import stored_mesh
from hhsim.result.body import Body
from hhsim.result.reader import TURNS, Result
from hhsim.scene.synthesis import carried
from hhsim.verify.claim import Claim, judged
from hhsim.verify.contacts import Pairs, Places, ReadyTriangles, ball_places, ready_triangles, triangle_places
from hhsim.verify.file_checks import leaves, own_script
from hhsim.verify.kinematics import Posed, rotations

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

SOME = 200
"""Ticks by which a joint's place is found."""
JOINED = 1e-9
"""Tolerance of a joint's value, and of what hangs on it [m, rad]."""
ABOVE = 1e-6
"""Largest initial height of a free object above its place [m], from the solver's offset to the table."""


@dataclass(frozen=True, eq=False)
class JudgedBody:
    """Mesh and leaf spheres in a frame of their own, and where that is at n ticks."""

    mesh: Mesh  # in the body's frame [m]
    center: FloatArray  # leaf spheres [m], shapes (L, 3) and (L,)
    radius: FloatArray
    first: int  # number of its first sphere or triangle among those of all bodies
    on_mesh: bool  # True if the hand touched triangles
    # Rotation matrix (n, 3, 3) and translation [m] (n, 3) to the judge's frame; None: the body stands still there.
    turn: FloatArray | None
    shift: FloatArray

    @cached_property
    def triangles(self) -> ReadyTriangles:
        """Triangles of the mesh."""
        return ready_triangles(self.mesh.triangles)

    @cached_property
    def pieces(self) -> Places:
        """Spheres or triangles, whichever the hand touches."""
        return triangle_places(self.mesh.triangles) if self.on_mesh else ball_places(self.center, self.radius)

    def of(self, pairs: Pairs) -> IntArray:
        """Return the pairs that are with this body."""
        count = len(self.mesh.faces) if self.on_mesh else len(self.radius)
        return np.flatnonzero((pairs.leaf >= self.first) & (pairs.leaf < self.first + count))

    def seen_points(self, points: FloatArray, rows: IntArray) -> FloatArray:
        """Return points [m], shape (m, ..., 3), at the ticks of these rows as the body sees them."""
        if self.turn is None:
            return points
        flat = points.reshape(len(points), math.prod(points.shape[1:-1]), 3) - self.shift[rows][:, None]
        return np.asarray(np.einsum("tji,tkj->tki", self.turn[rows], flat).reshape(points.shape))

    def seen(self, posed: Posed, rows: IntArray) -> Posed:
        """Return the hands of these rows as the body sees them."""
        here = posed.at(rows)
        if self.turn is None:
            return here
        axes = np.einsum("tji,tfj->tfi", self.turn[rows], here.axes)
        joints, palm, position = (self.seen_points(points, rows) for points in (here.joints, here.palm, here.position))
        return Posed(joints, axes, palm, position)

    def seen_hand(self, posed: Posed, orientation: FloatArray, rows: IntArray) -> PlacedHand:
        """Return the hands of these rows as the body sees them; orientations (n, 4) are those of all rows."""
        if self.turn is None:
            return PlacedHand(posed.joints[rows], posed.position[rows], orientation[rows])
        from scipy.spatial.transform import Rotation

        turned = (Rotation.from_matrix(self.turn[rows]).inv() * rotations(orientation[rows])[0]).as_quat()
        joints, position = (self.seen_points(points[rows], rows) for points in (posed.joints, posed.position))
        return PlacedHand(joints, position, turned[:, [3, 0, 1, 2]])

    def placed(self, pairs: Pairs, rows: IntArray) -> Pairs:
        """Return pairs that the body sees, of ticks that are places in these rows, in the judge's frame."""
        pairs = pairs._replace(leaf=pairs.leaf + self.first)
        if self.turn is None:
            return pairs
        at = rows[pairs.tick]
        point, normal = (np.einsum("nij,nj->ni", self.turn[at], of) for of in (pairs.point, pairs.normal))
        return pairs._replace(point=point + self.shift[at], normal=normal)


def judged_bodies(result: Result, ticks: IntArray) -> tuple[JudgedBody, ...]:
    """Return the object of a result, which stands still in its frame, or the parts of its thing at some ticks."""
    on_mesh, found, first = result.surface == "mesh", list[JudgedBody](), 0
    moved_bodies = result.meshes_moved()
    if not moved_bodies:
        return (JudgedBody(stored_mesh(result.body), *leaves(result.body), 0, on_mesh, None, np.zeros((0, 3))),)
    for body, moved in zip(result.bodies.values(), moved_bodies, strict=True):
        mesh = Mesh(np.array(body.vertices), np.array(body.faces), name=body.group)
        turn = rotations(moved.turn[ticks])[0].as_matrix()
        found.append(JudgedBody(mesh, *leaves(body), first, on_mesh, turn, moved.shift[ticks]))
        first += len(mesh.faces) if on_mesh else len(found[-1].radius)
    return tuple(found)


def seen_by_referee(name: str, values: AnyArray, now: ObjectMotion, first: ObjectMotion) -> AnyArray:
    """Transform rows of a /tick dataset from the world to the object's frame, as `hhsim.result.reader.View`."""
    here, none = rotations(now.orientation)
    there = rotations(first.orientation[None])[0]
    back = there * here.inv()
    if TURNS[name] == "orientation":
        turned, neither = rotations(values)
        seen = (back * turned).as_quat()[:, [3, 0, 1, 2]]
        none |= neither
    else:
        rows = np.asarray(values, np.float64).reshape(len(values), -1, 3)
        matrix = back.as_matrix()
        at_point = TURNS[name] == "point"
        moved = rows - now.position[:, None] if at_point else rows
        seen = np.einsum("tij,tnj->tni", matrix, moved) + (first.position if at_point else 0.0)
    seen[none] = np.nan
    return np.asarray(seen.reshape(values.shape))


def _first_step(result: Result) -> float:
    """Largest first step of a free object [m], from its place in the file or `ABOVE` it.

    A quaternion changes by half the turn, and the origin of the frame goes round the centre of mass.
    """
    body = result.body
    arm = np.linalg.norm(np.array(body.properties["center"]) - body.place.position)
    turn = np.linalg.norm(body["angular_velocity"][0]) * max(0.5, float(arm))
    return ABOVE + float(np.linalg.norm(body["velocity"][0]) + turn) / result.rate


def object_motion_claims(result: Result) -> list[Claim]:
    """Judge a moving object's poses: valid, from the object's place on, and the script's; and those of parts."""
    if not result.driven:
        return _poses_of_parts(result)
    poses = result.poses(result.frame)
    place = result.body.place if len(result.bodies) == 1 else poses.at(0)
    off = np.abs(np.linalg.norm(poses.orientation, axis=1) - 1.0)
    off = np.where(np.isfinite(poses.position).all(axis=1) & np.isfinite(off), off, np.inf)
    # The opposite quaternion is the same rotation, but a jump of its numbers.
    off[1:][(poses.orientation[1:] * poses.orientation[:-1]).sum(axis=1) < 0.0] = np.inf
    says, note = "the object has a pose at every tick, with a unit quaternion", ""
    if not result.free:
        says += ", where the scene says that it moves"
        if result.scene.get("object_pose") == "fixed":
            off[:], note = np.inf, "the scene says that it is fixed"
        own = _of_the_script(result)
        if own is not None:
            says += ", and as its script carries it"
            off = np.max([off, *(np.abs(a - b).max(axis=1) for a, b in zip(poses, own))], axis=0)
    first = max(float(np.abs(values[0] - stored).max()) for values, stored in zip(poses, place, strict=True))
    tolerance = _first_step(result) if result.free else 0.0
    why = "its first step, and what it may be raised by to stand on its table" if result.free else "the same numbers"
    poses_claim = judged("object poses", says, off, 1e-9, "m, 1", "rounding", ticks=np.arange(result.ticks), note=note)
    says = "the object's mesh and tree lie where its first pose has them"
    at_first = judged("object at first", says, [first], tolerance, "m, 1", why)
    return [poses_claim, at_first, *_poses_of_parts(result)]


def _poses_of_parts(result: Result) -> list[Claim]:
    off = []
    for body in result.bodies.values() if len(result.bodies) > 1 else ():
        unit = np.abs(np.linalg.norm(body["orientation"], axis=1) - 1.0)
        off.append(np.where(np.isfinite(body["position"]).all(axis=1) & np.isfinite(unit), unit, np.inf))
    says = "every part has a pose at every tick, with a unit quaternion"
    ticks = np.arange(result.ticks)
    if not off:
        return []
    claims = [judged("poses of parts", says, np.max(off, axis=0), 1e-9, "1", "rounding", ticks=ticks)]
    joints = [_off_joint(result, body) for body in result.bodies.values() if "joint" in body]
    if joints:
        says = "a body on a joint turns about, or moves along, an axis of another one, as far as the joint's value says"
        claims.append(judged("joints", says, np.max(joints, axis=0), JOINED, "m, rad", "rounding", ticks=ticks))
    return claims


def _off_joint(result: Result, body: Body) -> FloatArray:
    """Compute how far a body is off its joint with the body beside which it moves most alike, [m, rad], shape (T,)."""
    value = body["joint"] - body["joint"][0]
    found = []
    for other in result.bodies.values():
        if other is not body:
            turns, places = zip(*((rotations(of.orientation)[0], of.position) for of in (body.poses(), other.poses())))
            turn, place = turns[1].inv() * turns[0], turns[1].inv().apply(places[0] - places[1])
            # In the other body's frame a point x of the first tick goes to D x + s.
            moved = turn * turn[0].inv()
            shift = place - moved.apply(place[0])
            found += [_off_hinge(moved, shift, sign * value) for sign in (1.0, -1.0)]
            found.append(_off_slider(moved, shift, value))
    return min((np.nan_to_num(off, nan=np.inf) for off in found), key=lambda off: float(off.max()))


def _off_hinge(moved: "Rotation", shift: FloatArray, value: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation

    way = moved.as_rotvec() * np.sign(value)[:, None]
    most = int(np.linalg.norm(way, axis=1).argmax())
    size = float(np.linalg.norm(way[most]))
    axis = way[most] / size if size > 0.0 else np.eye(3)[0]
    turned = (Rotation.from_rotvec(np.outer(value, axis)).inv() * moved).magnitude()
    across = np.eye(3) - moved.as_matrix()
    some = slice(None, None, max(1, len(value) // SOME))
    origin = np.linalg.lstsq(across[some].reshape(-1, 3), shift[some].ravel(), rcond=None)[0]
    return np.asarray(np.maximum(turned, np.linalg.norm(across @ origin - shift, axis=1)))


def _off_slider(moved: "Rotation", shift: FloatArray, value: FloatArray) -> FloatArray:
    most = int(np.abs(value).argmax())
    axis = shift[most] / (value[most] or 1.0)
    off = np.linalg.norm(shift - np.outer(value, axis), axis=1)
    long = abs(float(np.linalg.norm(axis)) - 1.0) * np.abs(value)
    return np.asarray(np.maximum(moved.magnitude(), np.maximum(off, long)))


def _of_the_script(result: Result) -> ObjectMotion | None:
    """Motion of the object in a script of the catalogue with a sample a tick; None for another motion."""
    script = own_script(result)
    if script is None or script.rate != result.rate:
        return None
    start = result.body.place if len(result.bodies) == 1 else result.poses(result.frame, slice(1)).at(0)
    moved = carried(script, np.arange(script.sample_count) / script.rate, start[0])
    if moved is None:
        return None
    position, orientation = (np.tile(values, (script.sample_count, 1)) for values in start)
    ticks = np.minimum(np.arange(result.ticks), script.sample_count - 1)
    return ObjectMotion(moved.points(position), moved.orientations(orientation)).at(ticks)

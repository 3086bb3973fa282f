"""Search for a hand's place on an object.

`python -m tools.placement_search trajectories/handle.toml cup [OPTIONS]` prints the [[placement]] table
that the script then keeps. Random places near the demanded regions, the best of them improved by a random walk of
shrinking steps, and the best of those played through by the solver, which has the last word: only a place where every
demanded touch happens in the replay is printed. The same seed finds the same place.
"""

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.paper.scene import check_holds
from hhsim.errors import HhsimError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, quaternion_from_matrix, rotation_matrix
from hhsim.kernels.hand import finger_closure as kernel
from hhsim.kernels.hand.kinematics import BODY_COUNT, PALM_BODY
from hhsim.mesh.catalogue import load_object
from hhsim.scene.contact_goals import ANYWHERE, PALM, TOUCHING, Touch, holds, object_region
from hhsim.scene.finger_closure import FingerClosure, PlacedCloser, body_distances
from hhsim.scene.script import Placement, Script, ScriptTable
from hhsim.scene.synthesis import synthesize
from hhsim.solver.options import SolverOptions
from hhsim.system.settings_file import read_settings
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

DRAWS = 4000
"""Random places."""
LEADERS = 12
"""The best of them, which are improved."""
STEPS = 250
"""Random steps of each."""
PLAYED = 8
"""The best of those, which the solver plays; then the best is improved by it."""
PLAYED_STEPS = 60

SCALE = np.concatenate([np.full(3, 0.008), np.full(3, 0.15), np.full(3, 0.15), np.full(5, 0.25), np.full(5, 0.08)])
"""Standard deviation of a first step: position [m], rotation [rad], back, opening [rad], abduction [rad]."""
CLEAR = 0.001
"""The open hand keeps this distance [m] on its way."""


@dataclass(frozen=True, eq=False)
class Genes:
    """A place as the search varies it."""

    rotation: FloatArray
    position: FloatArray
    back: FloatArray
    open: FloatArray
    abduction: FloatArray
    slide: FloatArray

    def moved(self, step: FloatArray, turn: FloatArray | None = None) -> "Genes":
        """The place after a step of the units of `SCALE`; `turn` turns the slide."""
        back = self.back + step[6:9]
        slide = self.slide if turn is None or not self.slide.any() else self.slide + turn
        return Genes(
            rotation_matrix(quaternion(step[3:6])) @ self.rotation,
            self.position + step[:3],
            back / np.linalg.norm(back),
            self.open + step[9:14],
            self.abduction + step[14:],
            slide / np.linalg.norm(slide) if slide.any() else slide,
        )

    def placement(self, object_name: str) -> Placement:
        """The place as a script keeps it, with the digits that it keeps."""
        q = quaternion_from_matrix(self.rotation)
        r = [np.round(v, 4) for v in (q, self.back, self.open, self.abduction, self.slide)]
        unit = [v / np.linalg.norm(v) if v.any() else v for v in (r[0], r[1], r[4])]
        return Placement(object_name, np.round(self.position, 5), unit[0], unit[1], r[2], r[3], unit[2])


class PlacementSearch:
    """The search for one script on one object.

    Args:
        script: What is to be touched.
        object_name: Of the catalogue.
        hand: The hand.
        tree: The object's spheres, its own frame.
        come_from: Where the hand is to come from, a direction of shape (3,) or None for any.
        seed: Of everything random.
    """

    def __init__(
        self,
        script: Script,
        object_name: str,
        hand: HandModel,
        tree: SphereTree,
        come_from: FloatArray | None = None,
        seed: int = 0,
    ) -> None:
        """Prepare; nothing is searched yet."""
        self.script, self.object_name, self.hand, self.tree = script, object_name, hand, tree
        self.come_from, self.random = come_from, np.random.default_rng(seed)
        self.closer = PlacedCloser(script, hand, tree)
        self.touches = script.hold_touches
        self.leaves = {t.region: self._leaves(t.region) for touches in self.touches for t in touches}
        self.middle = 0.5 * (tree.leaf_center.min(axis=0) + tree.leaf_center.max(axis=0))
        self.floor = float((tree.leaf_center[:, 2] - tree.leaf_radius).min())
        self.limits = hand.abduction_min, hand.abduction_max
        self.idle = [f for f in range(len(FINGERS)) if f not in self.closer.fingers]

    def run(self) -> tuple[Placement, float]:
        """The best place, and the largest distance [m] of a demanded touch in its replay."""
        drawn = [self._draw() for _ in range(DRAWS)]
        ranked = sorted(((self.score(genes), n) for n, genes in enumerate(drawn)), key=lambda item: (-item[0], item[1]))
        better = []
        for score, n in ranked[:LEADERS]:
            better.append(self._walk(drawn[n], score, STEPS, self.score))
            print(f"  {score:9.2f} -> {better[-1][0]:9.2f}", file=sys.stderr, flush=True)
        better.sort(key=lambda item: -item[0])
        played = [(self.played_score(genes), n) for n, (_, genes) in enumerate(better[:PLAYED])]
        print("  played: " + ", ".join(f"{score:.2f}" for score, _ in played), file=sys.stderr, flush=True)
        score, n = max(played, key=lambda item: (item[0], -item[1]))
        score, genes = self._walk(better[n][1], score, PLAYED_STEPS, self.played_score, 0.3)
        print(f"  at last: {score:.2f}", file=sys.stderr, flush=True)
        placement = genes.placement(self.object_name)
        return placement, float(np.concatenate(self._play(placement, "coupled")).max(initial=0.0))

    def score(self, genes: Genes) -> float:
        """How good a place is by geometry alone: all demanded touches, a free way in, idle fingers away."""
        placement = genes.placement(self.object_name)
        worst = [0.0]

        def clear(position: FloatArray, rotation: FloatArray, opened: FloatArray) -> bool:
            near = self._body_distances(position, rotation, opened, placement.abduction)
            worst[0] = min(0.0, float(near.min()) - CLEAR)
            return worst[0] > -0.002

        closure = self.closer.close(placement, clear=clear)
        if worst[0] <= -0.002:
            return -200.0 + 5e3 * worst[0]
        score = 2e3 * worst[0] - self._strain(placement, closure)
        back = closure.back
        far = closure.position + self.script.start_distance * back
        gap = np.full(BODY_COUNT, 0.0005)
        travel, body = kernel.advance_hand(
            *(far, closure.rotation, closure.open, closure.abduction, -back),
            *(gap, self.script.start_distance, self.closer.work),
        )
        if body >= 0:
            score -= 10.0 + 600.0 * (self.script.start_distance - travel - max(0.0, self.script.palm_depth))
        near = self._body_distances(closure.position, closure.rotation, closure.contact, closure.abduction)
        joints = self.closer.work.joints.copy()
        score -= 250.0 * max(0.0, self.floor - float(joints[..., 2].min()))
        for touch in self.touches[0]:
            score -= 300.0 * min(0.05, max(0.0, self._distance(touch, joints, closure.position, closure.rotation)))
            if touch.part != PALM and touch.part not in closure.reached:
                score -= 6.0
        if self.idle:
            away = float(near[:PALM_BODY].reshape(len(FINGERS), 3)[self.idle].min())
            score -= 400.0 * max(0.0, self.script.clearance - away)
        if self.script.palm_depth == 0.0:
            score -= 400.0 * max(0.0, 0.004 - float(near[PALM_BODY]))
        self._body_distances(closure.position, closure.rotation, closure.command, closure.abduction)
        moved = self.closer.work.joints[:, 3] - joints[:, 3]
        for touch in self.touches[0]:
            if touch.part == PALM:
                continue
            f = FINGERS.index(touch.part)
            # Pressed in, not along: the command ends inside the object.
            score += 200.0 * min(0.01, max(0.0, -float(closure.distance[3 * f : 3 * f + 3].min())))
            score += 20.0 * min(0.01, float(np.linalg.norm(moved[f])))
        for touches, way in zip(self.touches[1:], self._slid()):
            for touch in touches if way else ():
                shifted = self.closer.work.joints + way * closure.slide
                place = closure.position + way * closure.slide
                score -= 200.0 * min(0.05, max(0.0, self._distance(touch, shifted, place, closure.rotation)))
        return score

    def played_score(self, genes: Genes) -> float:
        """How good a place is when the solver plays it: touches first, then the geometry's score."""
        placement = genes.placement(self.object_name)
        score = 0.02 * self.score(genes)
        try:
            for method, weight in (("coupled", 1.0), ("progressive", 0.3)):
                distance = np.concatenate(self._play(placement, method))
                score -= weight * float((distance > TOUCHING).sum() * 10.0 + 500.0 * np.minimum(distance, 0.05).sum())
        except HhsimError:
            return -1e3
        return score

    def _play(self, placement: Placement, method: str) -> list[FloatArray]:
        motion = synthesize(self.script, self.hand, self.tree, placement=placement)
        return check_holds(self.script, self.object_name, self.hand, self.tree, motion, SolverOptions(method=method))

    def _walk(
        self, genes: Genes, score: float, steps: int, judge: Callable[[Genes], float], width: float = 1.0
    ) -> tuple[float, Genes]:
        """The best of a random walk that only ever improves; its steps shrink while nothing does."""
        for _ in range(steps):
            some = self.random.random(SCALE.size) < 0.5
            step = width * SCALE * some * self.random.standard_normal(SCALE.size)
            tried = self._allowed(genes.moved(step, width * 0.2 * self.random.standard_normal(3)))
            found = judge(tried)
            if found > score:
                genes, score, width = tried, found, min(1.5 * width, 2.0)
            else:
                width = max(0.93 * width, 0.02)
        return score, genes

    def _allowed(self, genes: Genes) -> Genes:
        low, high = self.limits
        back = genes.back
        if self.come_from is not None:
            # Within 35° of where it is to come from.
            along = float(back @ self.come_from)
            if along < math.cos(math.radians(35.0)):
                across = back - along * self.come_from
                across /= max(float(np.linalg.norm(across)), 1e-9)
                back = math.cos(math.radians(35.0)) * self.come_from + math.sin(math.radians(35.0)) * across
        return replace(
            genes,
            back=back,
            open=np.clip(genes.open, 0.0, 1.6),
            abduction=np.clip(genes.abduction, 0.9 * low, 0.9 * high),
        )

    def _draw(self) -> Genes:
        """A random place, with the fingertips of half-closed fingers near what they are to touch."""
        random = self.random
        closed = self.closer.opened(
            Placement("", np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3), random.uniform(0.2, 1.3, len(FINGERS)))
        )
        low, high = self.limits
        abduction = np.clip(0.1 * random.standard_normal(len(FINGERS)), 0.9 * low, 0.9 * high)
        self._body_distances(np.zeros(3), np.eye(3), closed, abduction)
        tips = self.closer.work.joints[:, 3].copy()
        q, r = np.linalg.qr(random.standard_normal((3, 3)))
        prior = q * np.sign(np.diag(r))
        prior[:, 0] *= np.linalg.det(prior)
        named = [t for t in self.touches[0] if t.part != PALM]
        points = np.array([self._target(t) for t in named])
        sources = np.array([tips[FINGERS.index(t.part)] for t in named])
        center, origin = points.mean(axis=0), sources.mean(axis=0)
        u, _, vt = np.linalg.svd((points - center).T @ (sources - origin) + 2e-4 * prior)
        rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
        position = center - rotation @ origin
        back = rotation[:, 2] + 0.7 * random.standard_normal(3)
        if self.come_from is not None:
            back = self.come_from + 0.3 * random.standard_normal(3)
        slide = random.standard_normal(3) if self.script.way("slide") > 0.0 else np.zeros(3)
        genes = Genes(rotation, position, back / np.linalg.norm(back), random.uniform(0.0, 0.5, 5), abduction, slide)
        return self._allowed(genes.moved(np.zeros(SCALE.size), np.zeros(3)))

    def _target(self, touch: Touch) -> FloatArray:
        centers, _ = self.leaves[touch.region]
        return np.asarray(centers[self.random.integers(len(centers))])

    def _strain(self, placement: Placement, closure: FingerClosure) -> float:
        """What looks unnatural: spread fingers, a hand from below, a palm that looks away from where it goes."""
        up = float(closure.rotation[2, 2])
        return 4.0 * float(np.abs(placement.abduction).sum()) + 2.0 * max(0.0, -up) + 0.5 * float(placement.open.sum())

    def _leaves(self, region: str) -> tuple[FloatArray, FloatArray]:
        """Spheres that may be touched in a region: some point near their centre, or of their surface, lies in it."""
        center, radius = self.tree.leaf_center, self.tree.leaf_radius
        if region == ANYWHERE:
            return center, radius
        shape = object_region(self.object_name, region)
        held = holds(shape, center)
        for axis in (*np.eye(3), *-np.eye(3)):
            held |= holds(shape, center + radius[:, None] * axis)
        return center[held], radius[held]

    def _distance(self, touch: Touch, joints: FloatArray, position: FloatArray, rotation: FloatArray) -> float:
        """About how far [m] a part of the hand is from a region; negative inside."""
        center, radius = self.leaves[touch.region]
        if touch.part == PALM:
            places = self.hand.palm_tree.leaf_center @ rotation.T + position
            apart = np.linalg.norm(center[:, None] - places[None], axis=2)
            return float((apart - radius[:, None] - self.hand.palm_tree.leaf_radius[None]).min())
        f = FINGERS.index(touch.part)
        best = np.inf
        for k in range(3):
            a, b = joints[f, k], joints[f, k + 1]
            axis = b - a
            share = np.clip((center - a) @ axis / (axis @ axis), 0.0, 1.0)
            apart = np.linalg.norm(center - a - share[:, None] * axis, axis=1)
            thick, thin = self.hand.radius[f, k : k + 2]
            best = min(best, float((apart - radius - thick - share * (thin - thick)).min()))
        return best

    def _slid(self) -> list[float]:
        """How far the palm has slid [m] at each hold but the first."""
        ways, way = [], 0.0
        for phase in self.script.phases:
            if phase.name == "slide":
                way += phase.distance
            elif phase.name == "hold":
                ways.append(way)
        return ways[1:]

    def _body_distances(
        self, position: FloatArray, rotation: FloatArray, flexion: FloatArray, abduction: FloatArray
    ) -> FloatArray:
        return body_distances(position, rotation, flexion, np.ascontiguousarray(abduction), self.closer.work)


def table_of(placement: Placement) -> str:
    """Return a placement as a table of a script; lengths to 10 µm, angles and directions to 10⁻⁴."""
    lines = ["[[placement]]", f'object = "{placement.object_name}"']
    for name in ("position", "orientation", "back", "open", "abduction", "slide"):
        values, digits = getattr(placement, name), 5 if name == "position" else 4
        if name in ("position", "orientation", "back") or values.any():
            lines.append(f"{name} = [{', '.join(f'{round(float(v), digits) + 0.0:g}' for v in values)}]")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m tools.placement_search", description=__doc__)
    parser.add_argument("script", type=Path)
    parser.add_argument("object")
    parser.add_argument("--from", dest="come_from", help="direction that the hand comes from, such as 0,0,1")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--level", type=int)
    given = parser.parse_args(arguments)
    try:
        table = read_settings(given.script, ScriptTable, "script", TrajectoryError)
        script, found = table.script(given.script.stem), load_object(given.object)
        tree = cached_sphere_tree(found.mesh, TreeOptions(level=given.level or found.level))
        towards = None
        if given.come_from:
            towards = np.array([float(v) for v in given.come_from.split(",")])
            towards /= np.linalg.norm(towards)
        search = PlacementSearch(
            replace(script, placements=()), given.object, HandModel.default(), tree, towards, given.seed
        )
        placement, distance = search.run()
    except HhsimError as error:
        raise SystemExit(str(error)) from error
    if distance > TOUCHING:
        raise SystemExit(f"no place found: a touch is {1e3 * distance:.3g} mm from happening; try another --seed")
    print(table_of(placement))


if __name__ == "__main__":
    main()

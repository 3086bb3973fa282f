"""Claims on several things: each one's motion, the forces between them, and that none is in another one."""

import numpy as np

from hhsim.mesh.mesh import Mesh
from hhsim.motion.object_motion import RigidMotion
from hhsim.result.reader import Result
from hhsim.scene.parts_of_thing import points_on
from hhsim.verify.claim import Claim, judged
from hhsim.verify.force_checks import FORCE, WHY_FORCE
from hhsim.verify.free_object_checks import CLEAR
from hhsim.verify.tick_data import LAG, STUCK
from hhsim.verify.tree_checks import TrueSurface

LOOKED_AT = 100
"""Ticks in which the things are looked for in each other."""


def thing_claims(result: Result) -> list[Claim]:
    """Judge what the file claims of several things; none where there is one."""
    stated = [result.scene["free"], *result.scene.get("others", ())] if result.free else []
    return [_motion(result, stated), _between(result), _apart(result)] if len(stated) > 1 else []


def _motion(result: Result, stated: list[dict[str, float]]) -> Claim:
    ticks, off = np.arange(result.ticks), np.zeros(result.ticks)
    size = np.ones(result.ticks)
    for part, free in zip(result.parts, stated):
        mass, first = float(free["mass"]), np.array([free["velocity"]])
        velocity = np.concatenate([first, np.asarray(result[f"{part}/velocity"])])
        force = sum(np.asarray(result[f"{part}/{by}_wrench"])[:, :3] for by in ("hand", "table", "thing"))
        if free.get("fixed"):
            wrong = np.abs(velocity).max(axis=1)[1:]
        else:
            heavier = 1.0 + float(free["damping"]) / result.rate
            gained = mass * result.rate * (heavier * velocity[1:] - velocity[:-1])
            wrong = np.abs(gained - force - mass * np.array(free["gravity"])).max(axis=1)
        off, size = np.maximum(off, wrong), size + np.abs(force).max(axis=1)
    # A tick that lags makes a share of its last program's step.
    off[(np.asarray(result["status"]) & (LAG | STUCK)) != 0] = 0.0
    says = "each thing's velocity changes as the hand's, the table's and the others' forces and its weight have it"
    return judged("things move", says, off, FORCE * size, "N", WHY_FORCE, ticks=ticks)


def _between(result: Result) -> Claim:
    force = np.stack([np.asarray(result[f"{part}/thing_wrench"])[:, :3] for part in result.parts])
    says = "the forces of the things on each other are equal and opposite"
    size, off = FORCE * (1.0 + np.abs(force).sum(axis=(0, 2))), np.abs(force.sum(axis=0)).max(axis=1)
    return judged("between things", says, off, size, "N", WHY_FORCE, ticks=np.arange(result.ticks))


def _apart(result: Result) -> Claim:
    """Look for points of each thing's triangles and edges in each other one, by winding and nearest triangle."""
    ticks = np.unique(np.linspace(0, result.ticks - 1, LOOKED_AT).astype(int))
    meshes = [Mesh(result[f"{part}/vertices"], result[f"{part}/faces"]) for part in result.parts]
    shells, points = [TrueSurface(mesh) for mesh in meshes], [points_on(mesh) for mesh in meshes]
    moved = [
        RigidMotion(*(np.asarray(result[f"{part}/{column}"])[ticks] for column in ("orientation", "position")))
        for part in result.parts
    ]
    depth = np.zeros(len(ticks))
    for i, shell in enumerate(shells):
        low, high = meshes[i].bounds - [[CLEAR], [-CLEAR]]
        for j in range(len(shells)):
            seen = moved[i].seen_points(moved[j].points(np.broadcast_to(points[j], (len(ticks), *points[j].shape))))
            inside = ((seen > low) & (seen < high)).all(axis=2) if i != j else np.zeros(seen.shape[:2], bool)
            for t in np.flatnonzero(inside.any(axis=1)):
                depth[t] = max(depth[t], -float(shell.signed_distance(seen[t][inside[t]]).min()))
    says = f"no thing is in another one, by points of its triangles in {len(ticks)} ticks"
    return judged("things apart", says, depth, CLEAR, "m", "the clearance", ticks=ticks)

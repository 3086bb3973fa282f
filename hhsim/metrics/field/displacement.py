"""Simulation displacement (SD): motion of a free object in the fixed hand, by the settings of ObMan's code in PyBullet.

obman_train (Hasson et al. 2019), mano_train/simulation/simulate.py: the hand is its fixed triangles, the object falls
in convex parts, from rest, with its centre of mass at the mean of its vertices.
"""

import tempfile
from functools import lru_cache
from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import InputError
from hhsim.metrics.field.hands import FieldHands, FieldMetric, FieldPair, largest, mean, of_frames
from hhsim.metrics.field.volume import hand_solids
from hhsim.metrics.run_metric import each_with
from hhsim.system.posix import quiet_libraries

STEPS, STEP = 35, 1.0 / 240.0
"""Number of steps, and their length [s]."""
GRAVITY = 9.8
"""[m/s²]."""
MASS = 1.0
"""Mass of the object [kg]."""
FRICTION = 3.0
"""Friction of each body; Bullet multiplies the two."""
RESTITUTION = 0.5
"""Restitution of the object; the hand has none."""
ITERATIONS = 150
"""Iterations of the contact solver."""
DECOMPOSITION = {
    "resolution": 1000,
    "concavity": 0.001,
    "planeDownsampling": 4,
    "convexhullDownsampling": 4,
    "alpha": 0.05,
    "beta": 0.0,
    "pca": 0,
    "mode": 0,
    "maxNumVerticesPerCH": 64,
    "minVolumePerCH": 0.0001,
}
"""Settings of V-HACD."""


@lru_cache(maxsize=2)
def simulation_displacements(hands: FieldHands, frames: tuple[int, ...]) -> FloatArray:
    """Compute the displacement of the object's centre at some frames [m], NaN without a hand there.

    Raises InputError without PyBullet, or for a frame that does not exist, a hand without skin and cones, or parts.
    """
    outside = [frame for frame in frames if not 0 <= frame < len(hands.time)]
    if outside:
        raise InputError(f"no frame {outside[0]} for the simulation displacement; expected 0 to {len(hands.time) - 1}")
    try:
        with quiet_libraries():
            import pybullet
    except ImportError:
        raise InputError("the simulation displacement needs PyBullet: pip install 'hhsim[pybullet]'") from None
    solids_of = hand_solids(hands, margin=np.inf)
    if solids_of is None or hands.parts is not None:
        raise InputError("the simulation displacement needs a hand with a skin or with cones, and a rigid object")
    from manifold3d import Manifold, OpType

    down = np.tile([0.0, 0.0, -1.0], (len(hands.time), 1)) if hands.down is None else hands.down
    center = hands.mesh.vertices.mean(axis=0)
    found = np.full(len(frames), np.nan)
    with tempfile.TemporaryDirectory() as folder:
        whole, parts, hand = (Path(folder) / name for name in ("object.obj", "parts.obj", "hand.obj"))
        _write(whole, hands.mesh.vertices - center, hands.mesh.faces)
        with quiet_libraries():
            pybullet.vhacd(str(whole), str(parts), str(Path(folder) / "log.txt"), **DECOMPOSITION)
        for row, frame in enumerate(frames):
            solids = solids_of(frame) if hands.known[frame] else None
            if solids is None:
                continue
            surface = Manifold.batch_boolean(solids, OpType.Add).to_mesh64()
            _write(hand, np.asarray(surface.vert_properties)[:, :3], np.asarray(surface.tri_verts))
            found[row] = _moved(hand, parts, center, GRAVITY * down[frame])
    return found


def _moved(hand: Path, parts: Path, center: FloatArray, gravity: FloatArray) -> float:
    """Compute the displacement of an object in the hand of a file, from its centre of mass [m]."""
    import pybullet

    server = pybullet.connect(pybullet.DIRECT)
    to = {"physicsClientId": server}
    try:
        pybullet.setPhysicsEngineParameter(
            enableFileCaching=0, numSolverIterations=ITERATIONS, fixedTimeStep=STEP, **to
        )
        pybullet.setGravity(*gravity.tolist(), **to)
        concave = pybullet.GEOM_FORCE_CONCAVE_TRIMESH
        for file, mass, place, restitution, flags in (
            (hand, 0.0, np.zeros(3), 0.0, {"flags": concave}),
            (parts, MASS, center, RESTITUTION, {}),
        ):
            shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=str(file), **flags, **to)
            body = pybullet.createMultiBody(
                baseMass=mass, basePosition=place.tolist(), baseCollisionShapeIndex=shape, **to
            )
            pybullet.changeDynamics(body, -1, lateralFriction=FRICTION, restitution=restitution, **to)
        for _ in range(STEPS):
            pybullet.stepSimulation(**to)
        return float(np.linalg.norm(np.array(pybullet.getBasePositionAndOrientation(body, **to)[0]) - center))
    finally:
        pybullet.disconnect(server)


def _write(path: Path, vertices: FloatArray, faces: IntArray) -> None:
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces.astype(np.int64) + 1).tolist()]
    path.write_text("\n".join(lines) + "\n")


def _displacements(pair: FieldPair, hands: FieldHands) -> FloatArray:
    frames = pair.displacement_frames
    return simulation_displacements(hands, frames) if frames else np.zeros(0)


METRICS = each_with(
    FieldMetric("displacement_mean", "SD, PyBullet, mean", compute=of_frames(_displacements, mean)),
    FieldMetric("displacement_max", "SD, PyBullet, max", compute=of_frames(_displacements, largest)),
    unit="cm",
    digits=2,
    parameters=lambda pair: (
        f"{len(pair.displacement_frames)} frames, {STEPS} steps of 1/240 s, friction {FRICTION:g}, {MASS:g} kg"
    ),
)

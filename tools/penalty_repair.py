"""Repair of recorded hands frame by frame as papers do it, for comparison: a penalty on depth, minimised by L-BFGS.

python -m tools.penalty_repair RECORDING.npz MESH: keypoints with object_pos and object_quat (w, x, y, z) beside them.

The objective of a frame is the sum of squared displacements of 20 joints and the palm [m²], plus `WEIGHT` times the
squared depths of balls along the bones and in the palm. The penalty pushes out only what is inside, so that a depth is
left where both terms balance; and it pushes to the nearest side, which is the wrong one beyond the middle of a thin
part. OPENBLAS_NUM_THREADS=1 keeps threads of tiny products from taking most of the time.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, quaternion_product, rotation_matrix
from hhsim.kernels.mesh.bvh import MeshBvh, closest_points
from hhsim.mesh.mesh import Mesh, load_mesh
from hhsim.metrics.field.field_table import field_rows, field_table
from hhsim.metrics.field.hands import FieldHands, FieldPair, object_bvh
from hhsim.motion.trajectory import ObjectMotion
from hhsim.recordings.fitted_hand import fitted_hand
from hhsim.recordings.registry import ReadOptions, read_recording

WEIGHT = 100.0
"""Weight of a squared depth against a squared displacement."""
ITERATIONS = 200
BALLS = 8
"""Balls along a bone."""
STEP = 1e-6
"""Difference of a parameter for the derivative of the joints [m, rad]."""


def penalty_repair(
    hand: HandModel, mesh: Mesh, posture: HandConfiguration, weight: float = WEIGHT, iterations: int = ITERATIONS
) -> tuple[HandConfiguration, FloatArray]:
    """Return the repaired hand of each frame, and the seconds that each one took, shape (T,).

    Args:
        hand: Model of the hand.
        mesh: Closed surface of the object.
        posture: Recorded hand, in the object's frame.
        weight: Weight of a squared depth.
        iterations: Most iterations of L-BFGS in a frame.
    """
    from scipy.optimize import minimize

    bvh = object_bvh(mesh)
    low = np.concatenate([np.full(6, -np.inf), hand.flexion_min.ravel(), hand.abduction_min])
    high = np.concatenate([np.full(6, np.inf), hand.flexion_max.ravel(), hand.abduction_max])
    seconds = np.empty(posture.ticks)
    repaired = []
    for frame in range(posture.ticks):
        given = posture.part(frame, frame + 1)
        start = np.concatenate([np.zeros(6), given.flexion.ravel(), given.abduction.ravel()])
        bounds = list(zip(np.minimum(low, start), np.maximum(high, start)))
        begun = time.perf_counter()
        target = _placed(hand, given, start[None]).points[0]
        found = minimize(
            _objective,
            start,
            args=(hand, given, target, bvh, weight),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"maxiter": iterations},
        )
        seconds[frame] = time.perf_counter() - begun
        repaired.append(_configuration(given, found.x[None]))
    return HandConfiguration(*(np.concatenate(parts) for parts in zip(*repaired))), seconds


def _configuration(given: HandConfiguration, parameters: FloatArray) -> HandConfiguration:
    """Return the hands of parameters, shape (n, 26): shift and rotation vector from the given palm, then angles."""
    count = len(parameters)
    turn = quaternion_product(quaternion(parameters[:, 3:6]), np.repeat(given.orientation, count, axis=0))
    flexion = parameters[:, 6:21].reshape(count, 5, 3)
    return HandConfiguration(given.position + parameters[:, :3], turn, flexion, parameters[:, 21:])


def _placed(hand: HandModel, given: HandConfiguration, parameters: FloatArray) -> PlacedHand:
    return forward_kinematics(hand, *_configuration(given, parameters))


def _balls(hand: HandModel, placed: PlacedHand) -> tuple[FloatArray, FloatArray]:
    """Return centres of balls in a hand [m], shape (n, m, 3), and their radii, shape (m,)."""
    shape, count = hand_shape(hand), len(placed.joints)
    share = np.linspace(0.0, 1.0, BALLS)[:, None]
    chains = placed.joints[:, :, :, None]
    bones = chains[:, :, :-1] + share * (chains[:, :, 1:] - chains[:, :, :-1])
    radius = shape.phalanx_radius[:, :, None]
    radii = radius[:, :-1] + share[:, 0] * (radius[:, 1:] - radius[:, :-1])
    turned = np.einsum("tij,pj->tpi", rotation_matrix(placed.orientation), shape.palm_center)
    centres = np.concatenate([bones.reshape(count, -1, 3), turned + placed.position[:, None]], axis=1)
    return centres, np.concatenate([radii.ravel(), shape.palm_radius])


def _objective(
    parameters: FloatArray, hand: HandModel, given: HandConfiguration, target: FloatArray, bvh: MeshBvh, weight: float
) -> tuple[float, FloatArray]:
    """Return the objective [m²] and its gradient, shape (26,)."""
    placed = _placed(hand, given, np.concatenate([parameters[None], parameters + STEP * np.eye(26)]))
    points = placed.points
    offset = points[0] - target
    centres, radii = _balls(hand, placed)
    at = np.ascontiguousarray(centres[0])
    closest, distance = np.empty_like(at), np.empty(len(at))
    closest_points(bvh, at, closest, distance)
    depth = np.maximum(radii - distance, 0.0)
    # A centre on the surface has no direction to it; its derivative is left out.
    away = (at - closest) / np.where(distance == 0.0, np.inf, distance)[:, None]
    along = np.einsum("pmi,mi->pm", (centres[1:] - centres[0]) / STEP, away)
    gradient = 2.0 * np.einsum("pmi,mi->p", (points[1:] - points[0]) / STEP, offset) - 2.0 * weight * along @ depth
    return float((offset**2).sum() + weight * (depth**2).sum()), gradient


def _field_hands(hand: HandModel, mesh: Mesh, time: FloatArray, posture: HandConfiguration) -> FieldHands:
    """Return a hand with its palm's origin in the place of the wrist."""
    placed = forward_kinematics(hand, *posture)
    joints = np.concatenate([placed.position[:, None], placed.joints.reshape(-1, 20, 3)], axis=1)
    return FieldHands(time, joints, mesh, shape=hand_shape(hand), placed=placed)


def main() -> None:
    """Print the table of the field of a recording's fitted hand and its repair, and the time of a frame."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--weight", type=float, default=WEIGHT)
    given = parser.parse_args()
    reading = ReadOptions(form="keypoints", world_up="z", length_unit="m", pose_order="wxyz")
    recording = read_recording(given.recording, reading)
    fitted, text = fitted_hand(recording, given.recording.name)
    hand = HandModel.of_text(text, "fitted hand", recording.hand or "right")
    mesh = load_mesh(given.mesh)
    with np.load(given.recording) as file:
        motion = ObjectMotion(file["object_pos"], file["object_quat"])
    frame = motion.since(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    flexion = np.clip(fitted.flexion, hand.flexion_min, hand.flexion_max)
    abduction = np.clip(fitted.abduction, hand.abduction_min, hand.abduction_max)
    seen = frame.seen_points(fitted.position), frame.seen_orientations(fitted.orientation)
    posture = HandConfiguration(*map(np.ascontiguousarray, (*seen, flexion, abduction)))
    repaired, seconds = penalty_repair(hand, mesh, posture, given.weight)
    before, after = (_field_hands(hand, mesh, recording.time, hands) for hands in (posture, repaired))
    print(field_table(field_rows(FieldPair(before, after))).markdown())
    print(f"{1e3 * np.median(seconds):.0f} ms a frame (median), {1e3 * seconds.max():.0f} ms at most")


if __name__ == "__main__":
    main()

"""Changes from hands to others, and hands after changes; numbers of a change as of `hhsim.repair.written_hand`."""

from hhsim.kernels.jit import Array, jit
from hhsim.kernels.rotation import rotate_quaternion, rotation_vector_between

FINGER_JOINTS, ABDUCTIONS = 15, 5


@jit
def apply_changes(
    orientation: Array, flexion: Array, abduction: Array, change: Array, turned_out: Array, bent_out: Array, out: Array
) -> None:
    """Compute orientations (T, 4), flexions (T, 15) and abductions (T, 5) [rad] after changes, shape (T, 26).

    A turn of exactly zero leaves the quaternion as it is.
    """
    for t in range(change.shape[0]):
        row = change[t]
        if row[3] == 0.0 and row[4] == 0.0 and row[5] == 0.0:
            for i in range(4):
                turned_out[t, i] = orientation[t, i]
        else:
            rotate_quaternion(orientation[t], row[3], row[4], row[5], turned_out[t])
        for i in range(FINGER_JOINTS):
            bent_out[t, i] = flexion[t, i] + row[6 + i]
        for i in range(ABDUCTIONS):
            out[t, i] = abduction[t, i] + row[6 + FINGER_JOINTS + i]


@jit
def turns_between(first: Array, second: Array, turn_out: Array) -> None:
    """Compute the rotation vectors [rad], shape (T, 3), from quaternions to others, (T, 4); of equal ones exactly 0."""
    for t in range(first.shape[0]):
        a, b = first[t], second[t]
        if a[0] == b[0] and a[1] == b[1] and a[2] == b[2] and a[3] == b[3]:
            turn_out[t, 0] = turn_out[t, 1] = turn_out[t, 2] = 0.0
        else:
            rotation_vector_between(a, b, turn_out[t])

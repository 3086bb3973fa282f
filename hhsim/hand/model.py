"""Virtual hand: five chains of three round cones on a palm, from published anthropometry.

Hand length HL runs from the wrist crease to the middle fingertip, hand breadth HB across the knuckles; the default is a
male hand (Binvignat et al. 2012, n = 267: mean HL 184.9 mm). Sources: segment lengths by Buchholz, Armstrong &
Goldstein, Ergonomics 35(3), 1992, proximal phalanges by the ratios to the middle ones in An, Chao, Cooney & Linscheid,
J. Biomechanics 12, 1979; thicknesses, knuckle positions and joint limits by the kinematic hand model of Sancho-Bru and
colleagues; thumb abduction by clinical ranges.

The thumb's metacarpal counts as its first phalanx; the palm is the rest (paper, Section III-B). Positive abduction
turns a finger towards the thumb side and the thumb out of the palm's plane.

A TOML file replaces any size; lengths in m, angles in rad, points in the palm frame of a *right* hand (x from thumb to
little finger, y to the fingers, z out of the back). Keys; a left hand is its mirror::

    hand_length = 0.18          # everything below that is not named scales with it
    hand_breadth = 0.080
    palm_level = 2              # of the palm's sphere tree

    [index]
    base = [-0.026, 0.041, 0.003]      # first joint (MCP; CMC of the thumb)
    distal = [-0.087, 0.996, 0.0]      # direction of the straight finger at zero abduction
    dorsal = [-0.07, 0.0, 0.998]       # out of the finger's back
    length = [0.048, 0.026, 0.011]     # between joint centres; the last one to the CENTRE of the tip sphere
    radius = [0.009, 0.0085, 0.0075, 0.006]  # at the three joints and the tip, not growing towards the tip
    flexion_min = [-0.35, 0.0, -0.17]
    flexion_max = [1.57, 1.75, 1.57]
    abduction_min = -0.26
    abduction_max = 0.73
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, UnknownNameError, named
from hhsim.hand.fingers import FINGERS
from hhsim.hand.palm_mesh import palm_mesh
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.hand.kinematics import HandArrays, forward_kinematics
from hhsim.kernels.round_cone import cone_slope
from hhsim.mesh.mesh import Mesh
from hhsim.reproducible import dot, norm, sine_and_cosine
from hhsim.system.settings_file import Settings, between, parse_settings, read_toml_text, typed
from hhsim.trees.cache import cached_sphere_tree, shipped_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

Side = Literal["right", "left"]
SIDES: tuple[Side, Side] = ("right", "left")
"""Names of hands, in their order."""

DEFAULT_HAND_LENGTH = 0.19
BREADTH_PER_LENGTH = 0.085 / 0.19
HAND_LENGTH_RANGE = (0.05, 0.40)
"""Accepted hand lengths [m]; outside of it the unit is probably wrong."""

LENGTH_SHARES = (
    (0.251, 0.196, 0.158),
    (0.265, 0.143, 0.097),
    (0.277, 0.170, 0.108),
    (0.259, 0.165, 0.107),
    (0.206, 0.117, 0.093),
)
"""Segment lengths [HL]; the distal one runs to the surface of the fingertip."""

THICKNESS_SHARES = (
    ((0.438, 0.231), (0.231, 0.227), (0.239, 0.185)),
    ((0.231, 0.227), (0.210, 0.186), (0.198, 0.153)),
    ((0.212, 0.220), (0.206, 0.187), (0.200, 0.159)),
    ((0.202, 0.204), (0.192, 0.172), (0.187, 0.148)),
    ((0.186, 0.180), (0.172, 0.157), (0.165, 0.133)),
)
"""Diameters [HB] at the proximal and distal end of each segment."""

PALM_CENTER = (0.223, -0.070)
"""Palm origin from the wrist's middle: distal [HL], towards the thumb [HB]; halfway to the knuckles, halfway across."""

CARPAL = (0.073, (0.196, 0.126, 0.0, -0.129, -0.223))
"""Proximal ends of the metacarpals from the wrist's middle: distal [HL], towards the thumb [HB]."""

METACARPAL = ((0.374, 0.126), (0.373, 0.0), (0.336, -0.077), (0.295, -0.179))
"""Finger metacarpals: length [HL], run towards the thumb [HB]."""

BASE_HEIGHT = (-0.085, 0.030, 0.045, 0.030, -0.005)
"""Height of the first joints over the palm's middle plane [HB]: the transverse arch, highest at the middle finger."""

FAN = (5.0, 0.0, -5.0, -11.0)
"""Directions of the straight index to little finger at zero abduction, towards the thumb side [degrees]."""

ROLL = (6.0, 0.0, -5.0, -12.0)
"""Lean of the finger's back towards the thumb side [degrees]: it follows the arch, so that curling fingers converge."""

THUMB_DISTAL = (-0.50, 0.70, -0.51)
THUMB_DORSAL = (-0.80, -0.59, -0.03)
"""Thumb at zero flexion and abduction: chosen so that its pad meets the pads of all four fingers within the limits."""

FLEXION_DEGREES = (
    ((-25.0, 35.0), (-10.0, 80.0), (-15.0, 80.0)),
    ((-20.0, 90.0), (0.0, 100.0), (-10.0, 90.0)),
    ((-20.0, 90.0), (0.0, 100.0), (-10.0, 90.0)),
    ((-20.0, 90.0), (0.0, 100.0), (-20.0, 90.0)),
    ((-20.0, 90.0), (0.0, 100.0), (-30.0, 90.0)),
)
ABDUCTION_DEGREES = ((-20.0, 45.0), (-15.0, 42.0), (-8.0, 35.0), (-14.0, 20.0), (-40.0, 30.0))

FILE_DIGITS = 6
"""Decimals of a length [m] in a hand file: a micrometre."""

MIRROR = np.array([-1.0, 1.0, 1.0])
"""Factors from a right hand to a left one, palm frame."""

Place = Annotated[float, between(-0.5, 0.5, "m")]
Direction = Annotated[float, between(-1e6, 1e6)]
Length = Annotated[float, between(1e-4, 0.5, "m")]
Radius = Annotated[float, between(1e-4, 0.1, "m")]
Angle = Annotated[float, between(-math.pi, math.pi, "rad")]


class FingerTable(Settings, frozen=True):
    """Sizes of one finger in a TOML file; the module's docstring explains the keys."""

    base: tuple[Place, Place, Place] | None = None
    distal: tuple[Direction, Direction, Direction] | None = None
    dorsal: tuple[Direction, Direction, Direction] | None = None
    length: tuple[Length, Length, Length] | None = None
    radius: tuple[Radius, Radius, Radius, Radius] | None = None
    flexion_min: tuple[Angle, Angle, Angle] | None = None
    flexion_max: tuple[Angle, Angle, Angle] | None = None
    abduction_min: Angle | None = None
    abduction_max: Angle | None = None

    def check(self) -> None:
        """Check that the finger does not grow towards the tip."""
        if self.radius and (np.diff(self.radius) > 0.0).any():
            raise InputError(f"radius = {_text(self.radius)}: must not grow towards the tip")


class HandTable(Settings, frozen=True):
    """Sizes of a hand in a TOML file; the module's docstring explains the keys."""

    hand_length: Annotated[float, between(*HAND_LENGTH_RANGE, "m, wrist to middle fingertip")] = DEFAULT_HAND_LENGTH
    hand_breadth: float | None = None
    palm_level: Annotated[int, between(1, 5)] = 2
    thumb: FingerTable = FingerTable()
    index: FingerTable = FingerTable()
    middle: FingerTable = FingerTable()
    ring: FingerTable = FingerTable()
    little: FingerTable = FingerTable()

    @property
    def breadth(self) -> float:
        """Hand breadth across the knuckles [m]."""
        return BREADTH_PER_LENGTH * self.hand_length if self.hand_breadth is None else self.hand_breadth

    def check(self) -> None:
        """Check the breadth against the length."""
        low, high = 0.25 * self.hand_length, 0.75 * self.hand_length
        if not low <= self.breadth <= high:
            raise InputError(
                f"hand_breadth = {self.breadth:g}; expected {low:.3g} to {high:.3g} m for this hand_length"
            )


def palm_arrays(tree: SphereTree, length: FloatArray) -> dict[str, Any]:
    """Return the fields of `HandArrays` that depend on the palm's tree; `length` is that of the phalanges [m]."""
    center = np.ascontiguousarray(tree.leaf_center, dtype=np.float64)
    # Two points that move by d at most move by 2 d at most against each other. The palm's rotation is that of two sides
    # of the box around its centres: its square is at most the sum of theirs.
    palm = 1.0 / np.sqrt(np.sum(1.0 / np.maximum(np.sort(np.ptp(center, axis=0))[1:], 1e-9) ** 2))
    # The spheres above the leaves, as rows x, y, z, radius, and the first leaf of each, and the end.
    leaves = np.flatnonzero(tree.level == tree.depth)
    parent, first = np.unique(tree.parent[leaves], return_index=True)
    nodes = np.maximum(parent, 0)
    return {
        **{f"palm_{axis}": np.ascontiguousarray(column) for axis, column in zip("xyz", center.T)},
        "palm_radius": np.ascontiguousarray(tree.leaf_radius, dtype=np.float64),
        "palm_group": np.ascontiguousarray(np.concatenate([tree.center[nodes].T, tree.radius[None, nodes]])),
        "palm_group_start": np.append(first, len(leaves)).astype(np.int64),
        "palm_box": np.array(list(product(*np.stack([center.min(axis=0), center.max(axis=0)]).T))),
        "palm_reach": np.array([np.linalg.norm(center, axis=1).max()]),
        "turning_lever": np.maximum(0.5 * np.append(length.ravel(), palm), 1e-9),
    }


@dataclass(frozen=True, eq=False, repr=False)
class HandModel:
    """Sizes and limits of one hand, palm frame; fingers in the order of `FINGERS`."""

    side: Side
    hand_length: float  # wrist crease to middle fingertip [m]
    hand_breadth: float  # across the knuckles [m]
    base: FloatArray  # first joint of each finger [m], shape (5, 3)
    distal: FloatArray  # unit direction of the straight finger at zero abduction, shape (5, 3)
    dorsal: FloatArray  # unit direction out of the finger's back, perpendicular to distal, shape (5, 3)
    length: FloatArray  # between joint centres, the last one to the tip sphere's centre [m], shape (5, 3)
    radius: FloatArray  # at each joint and at the tip, not growing towards the tip [m], shape (5, 4)
    flexion_min: FloatArray  # joint limits [rad], shape (5, 3)
    flexion_max: FloatArray
    abduction_min: FloatArray  # abduction limits, positive towards the thumb side [rad], shape (5,)
    abduction_max: FloatArray
    palm_mesh: Mesh  # palm without the thumb's metacarpal [m], closed, palm frame
    palm_tree: SphereTree  # its sphere tree; the leaves are what collides

    def __repr__(self) -> str:
        size = f"{1e3 * self.hand_length:.1f} mm long, {1e3 * self.hand_breadth:.1f} mm broad"
        return f"HandModel({self.side}, {size}, {self.palm_tree.leaf_count} palm spheres)"

    @classmethod
    def default(
        cls,
        side: Side = "right",
        hand_length: float = DEFAULT_HAND_LENGTH,
        hand_breadth: float | None = None,
        palm_level: int = 2,
    ) -> "HandModel":
        """Return the hand of the published shares and these sizes [m], in x the mirror of a right one if it is left.

        The default breadth is in proportion to the length. InputError for a size that no hand has, or an unknown side.
        """
        given = {"hand_length": hand_length, "hand_breadth": hand_breadth, "palm_level": palm_level}
        # Numbers of numpy count as numbers too.
        sizes = {key: np.asarray(value).item() for key, value in given.items()}
        return _model(typed(sizes, HandTable, "hand"), side, "hand")

    @classmethod
    def from_toml(cls, path: str | Path, side: Side = "right") -> "HandModel":
        """Return the default hand with the sizes of a TOML file; the module's docstring explains the keys.

        Raises InputError for no such file, a robot's URDF or MJCF, broken TOML, an unknown key, or a size of wrong
        shape or sign.
        """
        text = read_toml_text(Path(path), "hand")
        if robot := re.match(r"\s*<(?:.*<)?(robot|mujoco)\b", text, re.DOTALL):
            what = "URDF" if robot[1] == "robot" else "MJCF"
            raise InputError(
                f"{path}: a {what}, which is of a robot's hand; expected the sizes of a person's hand (TOML)"
            )
        return cls.of_text(text, str(path), side)

    @classmethod
    @lru_cache(maxsize=4)
    def of_text(cls, text: str, where: str, side: Side = "right") -> "HandModel":
        """Return the hand of the text of a TOML file, named `where` in messages; errors as of `from_toml`."""
        return _model(parse_settings(text, HandTable, where), side, where)

    @property
    def abduction_sign(self) -> float:
        """Sign of rotation about `dorsal` of a positive abduction: +1 in a right hand, else -1."""
        return 1.0 if self.side == "right" else -1.0

    @property
    def wrist(self) -> FloatArray:
        """Middle of the wrist crease [m], palm frame, shape (3,)."""
        distal, lateral = PALM_CENTER
        middle = np.array([lateral * self.hand_breadth, -distal * self.hand_length, 0.0])
        return middle * MIRROR if self.side == "left" else middle

    @property
    def flexion_axis(self) -> FloatArray:
        """Unit vector in the palm about which a positive angle bends each finger to its pad, shape (5, 3)."""
        return np.cross(self.dorsal, self.distal)

    def arrays(self) -> HandArrays:
        """Return the hand in the kernels' form."""
        cones = [cone_slope(*cone) for cone in zip(self.length.flat, self.radius[:, :3].flat, self.radius[:, 1:].flat)]
        slope = np.array(cones).reshape(len(FINGERS), 3, 2)
        # A chain stretches at most to the sum of its lengths, whatever the joint angles are.
        lever = np.zeros((len(FINGERS), 3, 3))
        for k in range(3):
            for i in range(k + 1):
                lever[:, k, i] = self.length[:, i : k + 1].sum(axis=1)
        own = ("base", "distal", "dorsal", "length", "radius", "flexion_min", "flexion_max")
        return HandArrays(
            **{name: getattr(self, name).copy() for name in own},
            abduction_sign=np.array([self.abduction_sign]),
            tan_slope=np.ascontiguousarray(slope[:, :, 0]),
            inverse_length=np.ascontiguousarray(slope[:, :, 1]),
            reach=np.linalg.norm(self.base, axis=1)[:, None] + np.cumsum(self.length, axis=1),
            lever=lever,
            **palm_arrays(self.palm_tree, self.length),
        )

    @cached_property
    def shared_arrays(self) -> HandArrays:
        """Hand in the kernels' form, made once: nobody writes there."""
        return self.arrays()

    def joints(
        self, position: ArrayLike, orientation: ArrayLike, flexion: ArrayLike, abduction: ArrayLike
    ) -> FloatArray:
        """Compute the three joints and the tip sphere's centre of each finger [m], world, shape (5, 4, 3).

        Arguments as a single `hhsim.hand.configuration.HandConfiguration`; InputError for another shape.
        """
        joints = np.empty((5, 4, 3))
        palm = _array("position", position, (3,)), rotation_matrix(_array("orientation", orientation, (4,)))
        fingers = _array("flexion", flexion, (5, 3)), _array("abduction", abduction, (5,))
        rest = np.empty((5, 3, 3)), np.empty((5, 3)), np.empty((5, 3))
        forward_kinematics(self.shared_arrays, *palm, *fingers, joints, *rest)
        return joints


def default_fingers(hand_length: float, hand_breadth: float) -> dict[str, FloatArray]:
    """Return the finger arrays of `HandModel` for a right hand of these sizes [m]."""
    thickness = np.array(THICKNESS_SHARES)
    between = 0.5 * (thickness[:, :2, 1] + thickness[:, 1:, 0])
    radius = np.column_stack([thickness[:, 0, 0], between, thickness[:, 2, 1]])
    # A round cone of the paper narrows towards the tip: a slight bulge is levelled.
    radius = 0.5 * hand_breadth * np.minimum.accumulate(radius, axis=1)
    length = hand_length * np.array(LENGTH_SHARES)
    length[:, 2] -= radius[:, 3]

    carpal_y, carpal_lateral = CARPAL
    base = np.empty((5, 3))
    base[0, :2] = -carpal_lateral[0] * hand_breadth, carpal_y * hand_length
    for finger, (bone, run) in enumerate(METACARPAL, start=1):
        base[finger, 0] = -(carpal_lateral[finger] + run) * hand_breadth
        base[finger, 1] = carpal_y * hand_length + math.sqrt((bone * hand_length) ** 2 - (run * hand_breadth) ** 2)
    base[:, 0] += PALM_CENTER[1] * hand_breadth
    base[:, 1] -= PALM_CENTER[0] * hand_length
    base[:, 2] = np.array(BASE_HEIGHT) * hand_breadth

    (sine, cosine), none = sine_and_cosine(np.radians(FAN)), np.zeros(4)
    distal = np.vstack([THUMB_DISTAL, np.stack([-sine, cosine, none], axis=1)])
    sine, cosine = sine_and_cosine(np.radians(ROLL))
    dorsal = np.vstack([THUMB_DORSAL, np.stack([-sine, none, cosine], axis=1)])
    flexion, abduction = np.radians(FLEXION_DEGREES), np.radians(ABDUCTION_DEGREES)
    return {
        "base": base,
        "distal": distal,
        "dorsal": dorsal,
        "length": length,
        "radius": radius,
        "flexion_min": flexion[:, :, 0],
        "flexion_max": flexion[:, :, 1],
        "abduction_min": abduction[:, 0],
        "abduction_max": abduction[:, 1],
    }


def _model(sizes: HandTable, side: Side, where: str) -> HandModel:
    if side not in ("right", "left"):
        raise UnknownNameError("hand side", str(side), ("right", "left"))
    hand_length, hand_breadth = sizes.hand_length, sizes.breadth
    arrays = default_fingers(hand_length, hand_breadth)
    for index, finger in enumerate(FINGERS):
        given: FingerTable = getattr(sizes, finger)
        for key in given.__struct_fields__:
            if getattr(given, key) is not None:
                arrays[key][index] = getattr(given, key)
        for kind in ("flexion", "abduction"):
            low, high = arrays[f"{kind}_min"][index], arrays[f"{kind}_max"][index]
            if not np.all(low < high):
                span = f"{kind}_min {_text(low)} must lie below {kind}_max {_text(high)} [rad]"
                raise InputError(f"{where}: {finger}.{span}")
    arrays["distal"], arrays["dorsal"] = _frames(arrays["distal"], arrays["dorsal"], where)
    with named(where):
        mesh = palm_mesh(hand_length, hand_breadth, arrays["base"][1:], arrays["radius"][1:, 0])
    options = TreeOptions(level=sizes.palm_level)
    if side == "right":
        tree = cached_sphere_tree(mesh, options)
    else:
        for key in ("base", "distal", "dorsal"):
            arrays[key] = arrays[key] * MIRROR
        right, source = mesh, f"{mesh.source}, left"
        mesh = Mesh(right.vertices * MIRROR, right.faces[:, ::-1], name=f"left-{right.name}", source=source)
        shipped = shipped_tree(mesh, options)
        if shipped is None:
            from hhsim.trees.builder import proved_anew

            shipped = proved_anew(cached_sphere_tree(right, options).transformed(np.diag(MIRROR), np.zeros(3)), mesh)
        tree = shipped
    return HandModel(
        side=side,
        hand_length=hand_length,
        hand_breadth=hand_breadth,
        palm_mesh=mesh,
        palm_tree=tree,
        **{key: np.ascontiguousarray(value) for key, value in arrays.items()},
    )


def _frames(distal: FloatArray, dorsal: FloatArray, where: str) -> tuple[FloatArray, FloatArray]:
    for finger, u, w in zip(FINGERS, distal, dorsal):
        sine = norm(np.cross(u, w))
        if not sine > 1e-3 * norm(u) * norm(w) > 0.0:
            pair = f"{finger}.distal {_text(u)} and {finger}.dorsal {_text(w)}"
            raise InputError(f"{where}: {pair}: expected two directions across each other")
    distal = distal / np.linalg.norm(distal, axis=1, keepdims=True)
    dorsal = dorsal - dot(dorsal, distal)[:, None] * distal
    return distal, dorsal / np.linalg.norm(dorsal, axis=1, keepdims=True)


def _array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return a finite float64 array of a shape; raise InputError for anything else."""
    try:
        array = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise InputError(f"{name} is {value!r}: expected numbers of shape {shape}") from None
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}: expected {shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} {_text(array)}: expected finite numbers")
    return array


def _text(value: ArrayLike) -> str:
    array = np.asarray(value) + 0.0  # no -0 in messages
    return f"{float(array):g}" if array.ndim == 0 else f"[{', '.join(f'{x:g}' for x in array.ravel())}]"


def format_hand_file(
    hand_length: float, hand_breadth: float, fingers: Mapping[str, Mapping[str, ArrayLike]], remark: str = ""
) -> str:
    """Return the text of a hand file, with a remark in the first line; lengths in m.

    `fingers` has the non-default sizes of each finger by the keys of a hand file, in a right hand's palm frame.
    """
    lines = [f"# {' '.join(remark.split())}"] if remark else []
    lines += [f"hand_length = {_decimal(hand_length)}", f"hand_breadth = {_decimal(hand_breadth)}"]
    for finger, sizes in fingers.items():
        lines += ["", f"[{finger}]"]
        for key, value in sizes.items():
            array = np.asarray(value, dtype=np.float64)
            numbers = ", ".join(_decimal(x) for x in array.ravel())
            lines.append(f"{key} = [{numbers}]" if array.ndim else f"{key} = {numbers}")
    return "\n".join(lines) + "\n"


def _decimal(value: float) -> str:
    # No negative zero, and always a point: an integer is read as well, but looks like a count.
    return repr(round(float(value), FILE_DIGITS) + 0.0)

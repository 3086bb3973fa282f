"""Free objects with friction: known answers.

Motions from rest are compared with the sum of the implicit Euler method, a Δt² n (n + 1) / 2, the stated
discretisation: it is a Δt t / 2 ahead of a t² / 2, 0.3 % after 0.3 s.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from hhsim.arrays import BoolArray
from hhsim.bench import manipulation_stage as stage
from hhsim.bench.suite import Row, Suite
from hhsim.errors import check_known
from hhsim.hand.quaternion import rotation_matrix
from hhsim.motion.analytic_motion import still
from hhsim.solver.free_object import FreeObject
from hhsim.solver.options import SolverOptions
from hhsim.system.progress import Progress
from hhsim.system.settings_file import between
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree

GRAVITY = 9.81
SLOPE = math.radians(30.0)
DOWN = (GRAVITY * math.sin(SLOPE), 0.0, -GRAVITY * math.cos(SLOPE))
"""Gravity on a slope, in the frame of its surface."""
WITHIN = 0.01
"""Allowed relative error of a figure that is not 0."""
SLIPS = 1e-7
"""Way of a contact in a tick above which it slips [m]."""
TURNS = 1e-3
"""Angle above which a block has turned in the grip [rad]."""
TIP_RADIUS = 0.008
AWAY = (0.0, 0.0, 5.0)
"""Place of a hand that touches nothing [m]."""
QUIET = 500
"""Ticks of a hold, or a quarter of it, until the lift has decayed."""
LIFTED = 0.9
"""Least share of the way of a block that was lifted."""
EASED_FROM, EASED_TO = 1.3, 0.8
"""Shares of the threshold between which a squeeze is eased to find it."""


def answer(case: str, what: str, unit: str, exact: float, measured: float, allowed: float | None = None) -> Row:
    """Return the row of one figure in its SI unit; it holds if it is off by no more than allowed, or `WITHIN`."""
    off, most = measured - exact, WITHIN * abs(exact) if allowed is None else allowed
    figures = {"exact": exact, "measured": measured, "off": off, "allowed": most, "holds": int(abs(off) <= most)}
    return {"case": case, "figure": what, "unit": unit, **figures}


@dataclass(frozen=True, kw_only=True)
class Manipulation(Suite):
    """Cases, none for all, and durations of rest and hold [s]."""

    cases: tuple[str, ...]
    rest: Annotated[float, between(1.0)]
    held: Annotated[float, between(1.0)]
    is_portable = True

    def check(self) -> None:
        """Raise InputError for an unknown case."""
        check_known("case", self.cases, list(CASES))

    def cells(self, progress: Progress) -> list[str]:
        """Return the names of the cases."""
        return list(self.cases or CASES)

    def run(self, cell: str, before: None) -> list[Row]:
        """Play a case."""
        return CASES[cell](self)

    def named(self, cell: str) -> str:
        """Return the name of the case."""
        return cell

    def missed(self, rows: Sequence[Row]) -> list[str]:
        """Return the figures that are off by more than allowed."""
        return [f"{row['case']}, {row['figure']}" for row in rows if row["holds"] == 0]

    def lines(self, rows: Sequence[Row]) -> list[str]:
        """Say that all holds."""
        return [] if self.missed(rows) else ["every figure of ours holds"]


def _way(acceleration: float, ticks: int) -> float:
    """Way from the end of the first tick to that of the last one, by implicit Euler from rest [m]."""
    return acceleration * (ticks * (ticks + 1) / 2 - 1) / stage.RATE**2


def _alone(free: FreeObject, size: tuple[float, float, float], ticks: int) -> stage.Played:
    hand, options = stage.gripper(0.05, TIP_RADIUS), stage.gripper_options()
    return stage.play(free, stage.touched(stage.block(size)), hand, options, still(AWAY, ticks=ticks))


def slope(options: Manipulation) -> list[Row]:
    """Answer for a block on a slope of 30° that slides, and one that sticks."""
    size, ticks = (0.06, 0.06, 0.04), 300
    free = FreeObject.of_mesh(stage.block(size), mass=0.1, friction=0.3, table=-0.02, gravity=DOWN)
    slides, sticks = _alone(free, size, ticks), _alone(replace(free, friction=0.6), size, 10 * ticks)
    pull = GRAVITY * (math.sin(SLOPE) - 0.3 * math.cos(SLOPE))
    creep = float(np.linalg.norm(sticks.center - sticks.center[0], axis=1).max())
    way = float(slides.center[-1, 0] - slides.center[0, 0])
    return [
        answer("block on 30°, μ 0.3", "way in 0.3 s", "m", _way(pull, ticks), way),
        answer(
            "block on 30°, μ 0.3", "floats above the table, most", "m", 0.0, float(slides.table_distance.max()), 1e-6
        ),
        answer("block on 30°, μ 0.6", "creep in 3 s", "m", 0.0, creep, 1e-6),
    ]


def rolling(options: Manipulation) -> list[Row]:
    """Answer for balls on a slope of 30°: one rolls with 5/7 g sin θ, one slides and spins up by friction."""
    radius, mass, ticks = 0.038, 0.2, 500
    inertia = 0.4 * mass * radius**2
    rows = ((inertia, 0.0, 0.0), (0.0, inertia, 0.0), (0.0, 0.0, inertia))
    found = []
    for friction in (0.6, 0.1):
        free = FreeObject(mass, (0.0, 0.0, 0.0), rows, friction=friction, table=-radius, gravity=DOWN)
        solver = SolverOptions(method="coupled", surface="spheres", fingers=("thumb", "index"))
        ball = SphereTree(np.zeros((2, 3)), np.full(2, radius), np.array([0, 1]), np.array([-1, 0]))
        surface, hand = contact_surface("spheres", None, ball), stage.gripper(0.05, TIP_RADIUS)
        played = stage.play(free, surface, hand, solver, still(AWAY, ticks=ticks))
        rolls = friction > 2.0 / 7.0 * math.tan(SLOPE)
        rolled = 5.0 / 7.0 * GRAVITY * math.sin(SLOPE)
        slid = GRAVITY * (math.sin(SLOPE) - friction * math.cos(SLOPE))
        spun = rolled / radius if rolls else 2.5 * friction * GRAVITY * math.cos(SLOPE) / radius
        case = f"ball on 30°, μ {friction:g}"
        way = float(played.center[-1, 0] - played.center[0, 0])
        found.append(answer(case, "way in 0.5 s", "m", _way(rolled if rolls else slid, ticks), way))
        found.append(
            answer(case, "spin after 0.5 s", "rad/s", spun * ticks / stage.RATE, float(played.angular_velocity[-1, 1]))
        )
    return found


def flight(options: Manipulation) -> list[Row]:
    """Answer for a body in free flight, and one that tumbles on a table."""
    size, ticks = (0.1, 0.06, 0.02), 2000
    motion: dict[str, Any] = {"velocity": (1.0, 2.0, 3.0), "angular_velocity": (1.0, 12.0, 0.5)}
    free = FreeObject.of_mesh(stage.block(size), mass=0.3, gravity=(0.0, 0.0, 0.0), **motion)
    flies = _alone(free, size, ticks)
    momentum = 0.3 * np.linalg.norm(flies.velocity - np.array(free.velocity), axis=1).max()
    turn = rotation_matrix(flies.orientation)
    inertia = turn @ np.array(free.inertia) @ turn.transpose(0, 2, 1)
    spin = np.linalg.norm(np.einsum("tij,tj->ti", inertia, flies.angular_velocity), axis=1)
    free = replace(free, gravity=(0.0, 0.0, -GRAVITY), table=-0.3, friction=0.5)
    free = replace(free, velocity=(0.5, 0.0, 0.0), angular_velocity=(3, 5, 0.5))
    falls = _alone(free, size, ticks)
    force = falls.table_wrench[:, :3].sum(axis=0) / stage.RATE + 0.3 * np.array(free.gravity) * ticks / stage.RATE
    gained = 0.3 * (falls.velocity[-1] - np.array(free.velocity))
    turning = np.einsum("tji,tj->ti", rotation_matrix(falls.orientation), falls.angular_velocity)
    rotational = 0.5 * np.einsum("ti,ij,tj->t", turning, np.array(free.inertia), turning)
    potential = -0.3 * falls.center @ np.array(free.gravity)
    energy = rotational + 0.15 * (falls.velocity**2).sum(axis=1) + potential
    return [
        answer("body in flight", "momentum gained in 2 s", "N·s", 0.0, float(momentum), 1e-9),
        # First order in the period: 12 rad/s about the middle axis, which is the hardest to keep.
        answer("body in flight", "angular momentum after 1 s", "N·m·s", float(spin[0]), float(spin[1000])),
        answer("body that tumbles", "energy gained in a tick, most", "J", 0.0, float(np.diff(energy).max()), 1e-12),
        answer("body that tumbles", "impulse less momentum", "N·s", 0.0, float(np.abs(force - gained).max()), 1e-9),
    ]


def tipping(options: Manipulation) -> list[Row]:
    """Answer for a cube pushed by a smooth fingertip: it slides below a height of a / 2 μ, and tips above it."""
    side, friction, low, high = 0.07, 0.8, 0.02, 0.065
    while high - low > 1e-4:
        height = 0.5 * (low + high)
        low, high = (low, height) if _tips(side, friction, height) else (height, high)
    return [answer("cube pushed, μ 0.8", "height at which it tips", "m", 0.5 * side / friction, 0.5 * (low + high))]


def _tips(side: float, friction: float, height: float) -> bool:
    hand = stage.gripper(0.05, TIP_RADIUS)
    base = hand.base.copy()
    base[stage.INDEX], base[stage.THUMB] = 0.0, stage.BEHIND
    mesh = stage.block([side] * 3, [0.0, stage.REACH + TIP_RADIUS + 0.001 + 0.5 * side, 0.0])
    free = FreeObject.of_mesh(mesh, mass=0.24, friction=0.0, table_friction=friction, table=-0.5 * side)
    ticks = 800
    position = np.zeros((ticks, 3))
    position[:, 1], position[:, 2] = 0.015 * np.arange(1, ticks + 1) / ticks, height - 0.5 * side
    options = replace(stage.gripper_options(), fingers=("index",))
    played = stage.play(
        free, stage.touched(mesh), replace(hand, base=base), options, stage.closed(np.zeros(ticks), position)
    )
    return max(stage.turned_by(played.orientation[0], turn) for turn in played.orientation[::50]) > math.radians(1.0)


def thresholds(options: Manipulation) -> list[Row]:
    """Answer for held blocks, let go slowly: each begins to slip at a squeeze of m g / 2 μ."""
    found = []
    for mass in (0.01, 0.1, 1.0):
        for friction in (0.2, 0.5, 1.0):
            # The same sag for every block that is not light.
            pinch = stage.Pinch(mass=mass, friction=friction, hold=0.1, easing=4.0, stiffness=max(1000.0, 1e4 * mass))
            pinch = replace(pinch, squeeze=EASED_FROM * pinch.threshold, eased=EASED_TO / EASED_FROM)
            played = stage.gripped(pinch)
            case = f"pinch of {1e3 * mass:g} g, μ {friction:g}"
            slips = played.slipped() > SLIPS
            measured = _normal_before(played, slips, pinch)
            found.append(answer(case, "squeeze at which it slips", "N", pinch.threshold, measured))
    return found


def torsion(options: Manipulation) -> list[Row]:
    """Answer for a block held beside its centre, which turns once friction and torsion exceed their common limit.

    A contact bears (|f| / μ)² + (τ / γ)² up to its normal force squared: the weight's share is m g / 2 μ, the moment's
    m g d / 2 γ.
    """
    found = []
    for limit, off_center in ((0.005, 0.01), (0.002, 0.01), (0.01, 0.015)):
        pinch = stage.Pinch(friction=2.0, hold=0.1, easing=4.0)
        exact = math.hypot(pinch.threshold, 0.5 * pinch.mass * pinch.gravity * off_center / limit)
        pinch = replace(pinch, squeeze=EASED_FROM * exact, eased=EASED_TO / EASED_FROM)
        played = stage.gripped(pinch, torsion=limit, off_center=off_center)
        first = played.orientation[pinch.eased_from]
        turned = np.array([stage.turned_by(first, turn) for turn in played.orientation]) > TURNS
        case = f"block held {1e3 * off_center:g} mm off, γ {1e3 * limit:g} mm"
        found.append(answer(case, "squeeze at which it turns", "N", exact, _normal_before(played, turned, pinch)))
    return found


def _normal_before(played: stage.Played, event: BoolArray, pinch: stage.Pinch) -> float:
    """Normal force on a fingertip [N] right before an event in the easing; NaN without one."""
    normal = 0.5 * played.of_hand(played.normal_force)
    at = np.flatnonzero(event[pinch.eased_from :])
    return float(normal[pinch.eased_from + at[0] - 1]) if at.size and at[0] > 0 else math.nan


def held(options: Manipulation) -> list[Row]:
    """Answer for a block that is held at 1.05 times the least squeeze: its height, and that it stays there."""
    pinch = stage.Pinch(hold=options.held, easing=1.0)
    pinch = replace(pinch, squeeze=1.3 * pinch.threshold, eased=1.05 / 1.3)
    played = stage.gripped(pinch)
    quiet = pinch.held_from + round(0.25 * stage.RATE)
    center = played.center[quiet:]
    height = float(center[-1, 2] - played.center[0, 2])
    sinks = pinch.mass * pinch.gravity * (1.0 + stage.REACH**2) / pinch.stiffness
    case = "100 g held at 1.05 times the least squeeze"
    creep = float(np.linalg.norm(center - center[0], axis=1).max()) if height > 0.5 * pinch.lift else math.nan
    return [
        answer(case, "hangs below the command", "m", sinks, pinch.lift - height),
        answer(case, f"creep in {options.held:g} s", "m", 0.0, creep, 1e-6),
    ]


def rest(options: Manipulation) -> list[Row]:
    """Answer for a cube on a table."""
    side = 0.07
    size = (side, side, side)
    free = FreeObject.of_mesh(stage.block(size), mass=0.24, friction=0.6, table=-0.5 * side)
    played = _alone(free, size, round(stage.RATE * options.rest))
    moved = float(np.linalg.norm(played.center - played.center[0], axis=1).max())
    # The largest way of a corner.
    creep = moved + 0.5 * side * math.sqrt(3.0) * stage.turned_by(*played.orientation[[0, -1]])
    depth = max(0.0, -float(played.table_distance.min()))
    return [
        answer("cube on a table", f"creep in {options.rest:g} s", "m", 0.0, creep, 1e-9),
        answer("cube on a table", "in the table, most", "m", 0.0, depth, 0.0),
    ]


def pinch(options: Manipulation) -> list[Row]:
    """Answer for a block that is pinched, lifted by 30 mm and held by several times the least squeeze."""
    found = []
    for share in (1.05, 1.5, 3.0):
        task = stage.Pinch(hold=options.held)
        task = replace(task, squeeze=share * task.threshold)
        played = stage.gripped(task)
        height = (played.center[:, 2] - played.center[0, 2])[task.held_from :]
        lifted, quiet = bool(height[0] > LIFTED * task.lift), height[min(QUIET, len(height) // 4) :]
        creep = float(np.abs(quiet - quiet[0]).max()) if lifted else math.nan
        depth = max(0.0, -float(stage.clearance(played, task).min()))
        case = f"100 g pinched with {share:g} times the least squeeze, μ 0.5"
        found += [
            answer(case, "lifted", "1", 1.0, float(lifted), 0.0),
            answer(case, f"creep in {options.held - 0.5:g} s", "m", 0.0, creep, 1e-6),
            answer(case, "fingertip in the block, most", "m", 0.0, depth, 1e-9),
        ]
    return found


CASES: dict[str, Callable[[Manipulation], list[Row]]] = {
    case.__name__: case for case in (slope, rolling, flight, tipping, thresholds, torsion, held, rest, pinch)
}
"""Cases by name."""


SUITE = Manipulation

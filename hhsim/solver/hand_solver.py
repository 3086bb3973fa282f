"""The graphic hand's solver: one object's sphere tree, one hand, one tick after another."""

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import HhsimError
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.detection import CONTACT_ROWS, PALM_PAIRS
from hhsim.kernels.contact.linearise import ROW_CAPACITY
from hhsim.kernels.contact.penetration import clearances
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.hand.pose import is_finite_configuration
from hhsim.kernels.jit import JIT_ENABLED
from hhsim.kernels.qp.active_set import new_work
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.tick.block import TickRecord, run_block
from hhsim.kernels.tick.paper import begin_paper
from hhsim.kernels.tick.paper_block import run_block_paper
from hhsim.kernels.tick.penalty import run_block_penalty
from hhsim.kernels.tick.state import METHOD_COUPLED, STATUS_FULL, STATUS_START_INSIDE, TickOptions
from hhsim.kernels.tick.tick import gather_anew
from hhsim.solver.options import SolverOptions
from hhsim.solver.tick_threads import Crew
from hhsim.solver.workspace import paper_state, penalty_state, tick_record, tick_state

FloatArray = NDArray[np.float64]

CONFIGURATION = ("position", "orientation", "flexion", "abduction")

START_LINEARISATIONS = 4000
"""Budget for the way from a free place back to an object that the haptic hand is inside of at the first tick."""


class HandSolver:
    """Keeps the graphic hand between ticks.

    Args:
        hand: The hand.
        tree: The object's sphere tree in the world frame.
        options: Method, stiffness and lengths.
    """

    def __init__(self, hand: HandModel, tree: TreeArrays, options: SolverOptions) -> None:
        """Allocate the workspaces; nothing is computed yet."""
        self.options = options
        self.model = hand
        self.hand = hand.arrays()
        self.tree = tree
        self.tick_options = options.tick_options()
        self.states = tick_state(options.stiffness.diagonal(), options.modelled())
        self.qp = new_work(DOF, ROW_CAPACITY)
        self.paper = paper_state(options.frustum_ends == "spheres") if options.method == "paper" else None
        self.palm_tree = hand.palm_tree.arrays()
        self.crew = Crew(self.states, options.threads if JIT_ENABLED else 1)
        self.penalty = penalty_state() if options.method == "penalty" else None
        self._started = False

    def run(
        self, position: FloatArray, orientation: FloatArray, flexion: FloatArray, abduction: FloatArray
    ) -> TickRecord:
        """Run one tick for each haptic configuration.

        Args:
            position: Palm origin [m], shape (B, 3), world.
            orientation: Palm quaternion (w, x, y, z), shape (B, 4).
            flexion: Joint angles [rad], shape (B, 5, 3).
            abduction: [rad], shape (B, 5).

        Returns:
            The B ticks.

        Raises:
            HhsimError: More pairs were near than the arrays hold.
        """
        haptic = [np.ascontiguousarray(a, np.float64) for a in (position, orientation, flexion, abduction)]
        ticks = len(haptic[0])
        record = tick_record(ticks)
        if ticks == 0:
            return record
        if self._advance(haptic, record) & STATUS_FULL:
            raise self._full()
        return record

    def tick(self, haptic: list[FloatArray], record: TickRecord) -> int:
        """Run one tick in memory that is there already: for a loop that must not wait for any.

        The same bytes as `run` with that configuration alone; a tick whose pairs did not fit says so instead of
        raising, since a loop goes on.

        Args:
            haptic: Position, orientation, flexion and abduction as in `run` with B = 1, float64 and C-contiguous.
            record: Of one tick; overwritten.

        Returns:
            The tick's status bits (`hhsim.kernels.tick.state`).
        """
        return self._advance(haptic, record)

    def _advance(self, haptic: list[FloatArray], record: TickRecord) -> int:
        """One tick for each configuration, at least one; returns the status bits of the last one that was run."""
        start = 0 if self._started else self._start(haptic)
        done = self._run(self.tick_options, haptic, record)
        record.status[0] |= start
        return int(record.status[done - 1])

    def place(self, position: FloatArray, orientation: FloatArray, flexion: FloatArray, abduction: FloatArray) -> None:
        """Put the graphic hand at a configuration, shapes (3,), (4,), (5, 3), (5,), that does not penetrate.

        Method `paper` takes any.
        """
        pose = self.states[0].pose
        pose.position[:] = position
        pose.orientation[:] = orientation
        pose.flexion[:] = flexion
        pose.abduction[:] = abduction
        self.states[0].warm.count = 0
        self.states[0].parted = False
        if self.penalty is not None:
            self.penalty[0].velocity[:] = 0.0
        self._settle()
        self._started = True

    def _run(self, options: TickOptions, haptic: list[FloatArray], record: TickRecord) -> int:
        """Run the ticks by the method's kernel; returns how many were, fewer where the pairs of one did not fit."""
        position, orientation, flexion, abduction = haptic
        if self.paper is not None and options.method != METHOD_COUPLED:
            done = run_block_paper(
                self.hand,
                self.palm_tree,
                self.tree,
                options,
                self.states,
                self.paper,
                self.qp,
                position,
                orientation,
                flexion,
                abduction,
                record,
            )
        elif self.penalty is not None and options.method != METHOD_COUPLED:
            done = run_block_penalty(
                self.hand,
                self.tree,
                options,
                self.options.penalty_options(),
                self.states,
                self.penalty,
                position,
                orientation,
                flexion,
                abduction,
                record,
            )
        elif self.options.qp == "active-set":
            with self.crew.at_work(self.hand, self.tree, options):
                done = run_block(
                    *(self.hand, self.tree, options, self.states, self.qp),
                    *(position, orientation, flexion, abduction, record),
                )
        else:
            from hhsim.solver.external_qp_loop import run_block_with_backend

            done = run_block_with_backend(
                self.hand, self.tree, options, self.states[0], self.qp, self.options.qp, haptic, record
            )
        return int(done)

    def _clearance(self) -> float:
        """Signed distance [m] between the graphic hand and the object's leaves, up to ten times the margin.

        Without the tick's own lists, which are not made for a hand deep inside.
        """
        pose = self.states[0].pose
        joints = self.model.joints(pose.position, pose.orientation, pose.flexion, pose.abduction)
        rotation = np.empty((3, 3))
        quaternion_to_matrix(np.array(pose.orientation), rotation)
        hand, palm, finger = self.hand, np.empty(1), np.empty((1, FINGER_COUNT))
        clearances(
            hand.radius,
            hand.palm_x,
            hand.palm_y,
            hand.palm_z,
            hand.palm_radius,
            self.tree,
            np.ascontiguousarray(joints)[None],
            np.array(pose.position)[None],
            rotation[None],
            10.0 * self.options.margin,
            palm,
            finger,
        )
        used = self.options.modelled()[:PALM_BODY:PHALANX_COUNT]
        return float(min(palm[0], finger[0, used].min(initial=np.inf)))

    def _settle(self) -> None:
        """Let the tick's lists follow a configuration that was set from outside.

        Raises:
            HhsimError: More pairs are near than the arrays hold.
        """
        if self.paper is not None:
            begin_paper(self.hand, self.states, self.paper)
        elif gather_anew(self.hand, self.tree, self.tick_options, self.states) != 0:
            raise self._full()

    def _full(self) -> HhsimError:
        return HhsimError(
            f"more than {CONTACT_ROWS:,} contacts, or {PALM_PAIRS:,} pairs of palm and object spheres, lie within the "
            f"margin of {self.options.margin * 1e3:g} mm: use a smaller --margin or a coarser sphere tree"
        )

    def _start(self, haptic: list[FloatArray]) -> int:
        """Put the graphic hand on the first haptic one that is finite.

        Where that is inside the object, start at a free place nearby and come as near as possible.
        """
        self._started = True
        samples = zip(*haptic)
        first = next((sample for sample in samples if is_finite_configuration(*sample)), None)
        pose = self.states[0].pose
        if first is not None:
            pose.position[:] = first[0]
            pose.orientation[:] = first[1] / np.linalg.norm(first[1])
            pose.flexion[:] = np.clip(first[2], self.hand.flexion_min, self.hand.flexion_max)
            pose.abduction[:] = first[3]
        haptic_pose = self.states[0].haptic
        for name in CONFIGURATION:
            haptic_pose[name][:] = pose[name]
        inside = self._clearance() < 0.0
        if inside:
            self._retreat()
        self._settle()
        if not inside:
            return 0
        options = self.tick_options._replace(linearisations=START_LINEARISATIONS)
        if self.paper is not None or self.penalty is not None:
            # The start is no part of the method: every method begins from the same place.
            options = options._replace(method=METHOD_COUPLED)
            gather_anew(self.hand, self.tree, options, self.states)
        way = tick_record(1)
        self._run(options, [np.array(haptic_pose[name])[None] for name in CONFIGURATION], way)
        if way.status[0] & STATUS_FULL:
            raise self._full()
        if self.paper is not None:
            self._settle()
        return STATUS_START_INSIDE

    def _retreat(self) -> None:
        """Shift the hand by the least distance that frees it, over 26 directions and the one away from the object."""
        pose = self.states[0].pose
        origin = pose.position.copy()
        directions = [np.array(d) - 1.0 for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]
        joints = self.model.joints(pose.position, pose.orientation, pose.flexion, pose.abduction)
        away = joints.reshape(-1, 3).mean(axis=0) - np.array([self.tree.x[0], self.tree.y[0], self.tree.z[0]])
        if np.linalg.norm(away) > 0.0:
            directions.insert(0, away)
        step = self.options.margin
        best = np.inf
        nearest = origin
        for direction in directions:
            unit = direction / np.linalg.norm(direction)
            shift = 0.0
            while shift < best:
                pose.position[:] = origin + shift * unit
                clearance = self._clearance()
                if clearance >= step:
                    best, nearest = shift, pose.position.copy()
                    break
                shift += max(step, -clearance)
        pose.position[:] = nearest

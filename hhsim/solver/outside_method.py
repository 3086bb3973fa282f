"""Methods from outside: a class that returns the graphic hand tick by tick, see docs/outside-methods.md."""

import copy
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from numbers import Integral, Real
from time import perf_counter_ns, process_time_ns
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import SHAPES, HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.reproducible import norm
from hhsim.trees.sphere_tree import SphereTree

if TYPE_CHECKING:
    from hhsim.kernels.tick.block import HapticBlock, TickRecord
    from hhsim.kernels.world.record import WorldRecord
    from hhsim.solver.options import SolverOptions
    from hhsim.solver.workspace import TickWorkspace

NATIVE = 1
"""Index of the method's own time among the durations of a tick: the optimisation of the whole hand."""
MOST_WORK = 10**12
"""Largest work of a tick, so that the sum over a run is an exact integer of 64 bits."""
UNIT = 1e-6
"""Accepted deviation of a quaternion's length from 1."""


@dataclass(frozen=True)
class MethodScene:
    """Copies of hand, options, mesh and tree for a method: world [m], None where the object has only one of the two."""

    hand: HandModel
    mesh: Mesh | None
    tree: SphereTree | None
    options: "SolverOptions"

    @property
    def period(self) -> float:
        """Period of a tick [s]."""
        return self.options.period


class TickAnswer(NamedTuple):
    """Answer of a method to a tick."""

    pose: HandConfiguration  # graphic hand
    phalanx_force: FloatArray | None = None  # on each phalanx [N], world, (5, 3, 3); None without forces
    palm_force: FloatArray | None = None  # on the palm [N], world, (3,); None is zero
    native_ns: int = 0  # time of the method's own engine [ns], as it measured; 0 where it has none
    work: int = 0  # in the method's own unit: a count that is the same on every machine

    def __repr__(self) -> str:
        forces = "without forces" if self.phalanx_force is None and self.palm_force is None else "with forces"
        return f"TickAnswer({self.pose!r}, {forces})"


class OutsideMethod(Protocol):
    """A method from outside; made anew for every run.

    A class may state `summary` (else the first line of its docstring is taken), `gives_forces = True` if its ticks have
    forces, `gives_work = True` if they count their work, `never_penetrates = True` as a promise, and `missing`, what
    has to be installed before it can be made, or "".
    """

    def __init__(self, scene: MethodScene) -> None:
        """Prepare everything: what is left for the first tick is timed with it."""

    def begin(self, pose: HandConfiguration) -> None:
        """Continue from this free graphic hand; called before the first tick, and whenever the hand is placed."""

    def tick(self, haptic: HandConfiguration) -> HandConfiguration | TickAnswer:
        """Return the graphic hand for the haptic hand of this tick."""


class OutsideEngine:
    """Runs a method from outside, made by `make` for a scene; computes from its hands what hhsim's own methods record.

    `ticks` counts the answered ones. Raises InputError where the method fails or answers with no hand.
    """

    def __init__(self, make: Callable[[MethodScene], OutsideMethod], forces: bool, workspace: "TickWorkspace") -> None:
        self.name, self.forces, self.workspace, self.ticks = workspace.options.method, forces, workspace, 0
        # Views: to find a field of a record takes longer than to write it, and a tick has a dozen.
        states = workspace.states
        self.haptic = {field: states["haptic"][field][0] for field in HandConfiguration._fields}
        self.pose = {field: states["pose"][field][0] for field in (*HandConfiguration._fields, "joints")}
        self.palm_wrench, self.work = states["forces"]["palm_wrench"][0], states["work"][0]
        touched = workspace.touched
        scene = MethodScene(workspace.model, touched.mesh, touched.tree, workspace.options)
        self.method, *_ = self._call("cannot be made", make, copy.deepcopy(scene))

    def begin(self) -> None:
        """See `Engine.begin`."""
        pose = HandConfiguration(*(self.pose[field].copy() for field in HandConfiguration._fields))
        self._call("fails in begin()", self.method.begin, pose)

    def run(self, haptic: "HapticBlock", record: "TickRecord", bodies: "WorldRecord") -> int:
        """See `Engine.run`; InputError if the method fails, or its answer is no hand."""
        of_hand = type(record)._make(values[0] for values in record)
        for i, sample in enumerate(zip(*(values[0] for values in haptic))):
            self._tick(HandConfiguration(*sample), i, of_hand)
        return len(haptic.position[0])

    def _call(self, what: str, function: Callable[..., Any], *arguments: Any) -> tuple[Any, int, int]:
        """Return the value of a call, and its wall and CPU time [ns]."""
        try:
            # What it prints is no part of this program's output.
            with redirect_stdout(sys.stderr):
                cpu, wall = process_time_ns(), perf_counter_ns()
                value = function(*arguments)
                return value, perf_counter_ns() - wall, process_time_ns() - cpu
        except InputError:
            raise
        except (Exception, SystemExit) as error:
            where = f" (tick {self.ticks:,})" if what == "fails" else ""
            raise InputError(f"method '{self.name}' {what}: {type(error).__name__}: {error}{where}") from error

    def _wrong(self, what: str) -> InputError:
        return InputError(f"method '{self.name}' {what} (tick {self.ticks:,})")

    def _array(self, part: str, values: Any, shape: tuple[int, ...]) -> FloatArray:
        try:
            array = np.asarray(values, np.float64)
        except (TypeError, ValueError) as error:
            raise self._wrong(f"answers with a {part} that is no array of numbers") from error
        if array.shape != shape:
            raise self._wrong(f"answers with a {part} of shape {array.shape}: expected {shape}")
        if not np.isfinite(array).all():
            raise self._wrong(f"answers with a {part} that is not finite")
        return array

    def _checked(self, found: Any, most: int) -> TickAnswer:
        """Return the answer to a tick, which took `most` ns, as arrays of float64 with a unit quaternion."""
        answer = found if isinstance(found, TickAnswer) else TickAnswer(found)
        pose = answer.pose
        if not isinstance(pose, tuple) or len(pose) != len(SHAPES):
            raise self._wrong(f"answers with {type(pose).__name__}: expected a HandConfiguration or a TickAnswer")
        arrays = {part: self._array(part, values, shape) for (part, shape), values in zip(SHAPES.items(), pose)}
        length = float(norm(arrays["orientation"]))
        if abs(length - 1.0) > UNIT:
            raise self._wrong(f"answers with an orientation of length {length:.6g}: expected a unit quaternion w x y z")
        arrays["orientation"] = arrays["orientation"] / length
        native, work = answer.native_ns, answer.work
        if not isinstance(native, Real) or not 0 <= native <= most:
            expected = f"expected 0 to the {most:,} ns that the tick took"
            raise self._wrong(f"answers with a native_ns of {native!r:.40}: {expected}")
        if not isinstance(work, Integral) or not 0 <= work <= MOST_WORK:
            raise self._wrong(f"answers with a work of {work!r:.40}: expected a whole number from 0 to {MOST_WORK:,}")
        phalanx = palm = None
        if self.forces:
            if answer.phalanx_force is None:
                raise self._wrong("promises forces (gives_forces) and gives none")
            phalanx = self._array("phalanx_force", answer.phalanx_force, (5, 3, 3))
            palm = np.zeros(3) if answer.palm_force is None else self._array("palm_force", answer.palm_force, (3,))
        return TickAnswer(HandConfiguration(**arrays), phalanx, palm, int(native), int(work))

    def _tick(self, sample: HandConfiguration, i: int, record: "TickRecord") -> None:
        from hhsim.kernels.hand.pose import is_finite_configuration
        from hhsim.kernels.tick.evaluation import look_at
        from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, STATUS_INPUT_INVALID, WORK_UNITS

        good = is_finite_configuration(*sample)
        if good:
            for name, values in sample._asdict().items():
                self.haptic[name][:] = values
            self.haptic["orientation"] /= norm(self.haptic["orientation"])
        # Copies, so that nothing of ours is the method's to write to.
        sample = HandConfiguration(*(values.copy() for values in self.haptic.values()))
        found, wall, cpu = self._call("fails", self.method.tick, sample)
        answer = self._checked(found, max(wall, cpu))
        self.ticks += 1
        for name, values in answer.pose._asdict().items():
            self.pose[name][:] = values
        workspace = self.workspace
        full = look_at(workspace.hand, workspace.code, workspace.tick_options, workspace.states)
        for field, values in self.pose.items():
            getattr(record, field)[i] = values
        record.palm_wrench[i] = self.palm_wrench
        record.work[i] = self.work
        record.work[i, WORK_UNITS] = answer.work
        if full & STATUS_CAPACITY_EXCEEDED:
            # It touches, however many pairs there are.
            record.work[i] = np.maximum(record.work[i], 1)
        record.status[i] = 0 if good else STATUS_INPUT_INVALID
        record.duration_total[i], record.duration_cpu[i] = wall, cpu
        record.duration[i, NATIVE] = answer.native_ns
        record.fingertip_normal[i] = np.nan
        if self.forces:
            record.phalanx[i] = answer.phalanx_force
            record.total[i] = record.phalanx[i].sum(axis=(0, 1)) + answer.palm_force
        else:
            record.phalanx[i] = record.total[i] = np.nan

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
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.reproducible import norm
from hhsim.trees.sphere_tree import SphereTree

if TYPE_CHECKING:
    from hhsim.kernels.tick.block import HapticBlock, TickRecord
    from hhsim.solver.options import SolverOptions
    from hhsim.solver.workspace import TickWorkspace

SHAPES = {"position": (3,), "orientation": (4,), "flexion": (5, 3), "abduction": (5,)}
"""Shapes of a hand's configuration."""
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


class Timed(NamedTuple):
    """Value that a call returned, and its wall and CPU time [ns]."""

    value: Any
    wall: int
    cpu: int


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


class MethodHere:
    """Runs a method, made by `make` for a scene; `ticks` counts the answered ones.

    Raises InputError where the method fails or answers with no hand.
    """

    def __init__(
        self, name: str, make: Callable[[MethodScene], OutsideMethod], forces: bool, scene: MethodScene
    ) -> None:
        self.name, self.forces, self.ticks = name, forces, 0
        self.method = self._call("cannot be made", make, scene).value

    def begin(self, pose: HandConfiguration) -> None:
        """Call `OutsideMethod.begin`."""
        self._call("fails in begin()", self.method.begin, pose)

    def tick(self, haptic: HandConfiguration) -> Timed:
        """Call `OutsideMethod.tick`; the value is a `TickAnswer` as `checked_answer` makes it."""
        found = self._call("fails", self.method.tick, haptic)
        answer = checked_answer(self.name, self.ticks, found, self.forces)
        self.ticks += 1
        return found._replace(value=answer)

    def _call(self, what: str, function: Callable[..., Any], *given: Any) -> Timed:
        try:
            # What it prints is no part of this program's output.
            with redirect_stdout(sys.stderr):
                cpu, wall = process_time_ns(), perf_counter_ns()
                value = function(*given)
                return Timed(value, perf_counter_ns() - wall, process_time_ns() - cpu)
        except InputError:
            raise
        except (Exception, SystemExit) as error:
            where = f" (tick {self.ticks:,})" if what == "fails" else ""
            raise InputError(f"method '{self.name}' {what}: {type(error).__name__}: {error}{where}") from error


def checked_answer(name: str, tick: int, found: Timed, forces: bool) -> TickAnswer:
    """Return the answer to a tick as arrays of float64 with a unit quaternion; `forces` requires forces.

    Raises InputError where it is no hand, or claims a time that the tick did not take.
    """

    def wrong(what: str) -> InputError:
        return InputError(f"method '{name}' {what} (tick {tick:,})")

    def array(part: str, values: Any, shape: tuple[int, ...]) -> FloatArray:
        try:
            array = np.asarray(values, np.float64)
        except (TypeError, ValueError) as error:
            raise wrong(f"answers with a {part} that is no array of numbers") from error
        if array.shape != shape:
            raise wrong(f"answers with a {part} of shape {array.shape}: expected {shape}")
        if not np.isfinite(array).all():
            raise wrong(f"answers with a {part} that is not finite")
        return array

    answer = found.value if isinstance(found.value, TickAnswer) else TickAnswer(found.value)
    pose = answer.pose
    if not isinstance(pose, tuple) or len(pose) != len(SHAPES):
        raise wrong(f"answers with {type(pose).__name__}: expected a HandConfiguration or a TickAnswer")
    arrays = {part: array(part, values, shape) for (part, shape), values in zip(SHAPES.items(), pose)}
    length = float(norm(arrays["orientation"]))
    if abs(length - 1.0) > UNIT:
        raise wrong(f"answers with an orientation of length {length:.6g}: expected a unit quaternion w x y z")
    arrays["orientation"] = arrays["orientation"] / length
    native, most = answer.native_ns, max(found.wall, found.cpu)
    if not isinstance(native, Real) or not 0 <= native <= most:
        raise wrong(f"answers with a native_ns of {native!r:.40}: expected 0 to the {most:,} ns that the tick took")
    if not isinstance(answer.work, Integral) or not 0 <= answer.work <= MOST_WORK:
        raise wrong(f"answers with a work of {answer.work!r:.40}: expected a whole number from 0 to {MOST_WORK:,}")
    phalanx = palm = None
    if forces:
        if answer.phalanx_force is None:
            raise wrong("promises forces (gives_forces) and gives none")
        phalanx = array("phalanx_force", answer.phalanx_force, (5, 3, 3))
        palm = np.zeros(3) if answer.palm_force is None else array("palm_force", answer.palm_force, (3,))
    return TickAnswer(HandConfiguration(**arrays), phalanx, palm, int(native), int(answer.work))


class OutsideEngine:
    """Runs a method from outside, made by `run_by`, and computes from its hands what hhsim's own methods record."""

    def __init__(self, run_by: Callable[[MethodScene], MethodHere], forces: bool, workspace: "TickWorkspace") -> None:
        self.forces, self.workspace = forces, workspace
        # Views: to find a field of a record takes longer than to write it, and a tick has a dozen.
        states = workspace.states
        self.haptic = {field: states["haptic"][field][0] for field in HandConfiguration._fields}
        self.pose = {field: states["pose"][field][0] for field in (*HandConfiguration._fields, "joints")}
        self.palm_wrench, self.work = states["forces"]["palm_wrench"][0], states["work"][0]
        scene = MethodScene(workspace.model, workspace.mesh, workspace.tree, workspace.options)
        self.runner = run_by(copy.deepcopy(scene))

    def begin(self) -> None:
        """See `Engine.begin`."""
        self.runner.begin(HandConfiguration(*(self.pose[field].copy() for field in HandConfiguration._fields)))

    def run(self, haptic: "HapticBlock", record: "TickRecord") -> int:
        """See `Engine.run`; InputError if the method fails, or its answer is no hand."""
        for i, sample in enumerate(zip(*haptic)):
            self._tick(HandConfiguration(*sample), i, record)
        return len(haptic.position)

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
        answer, wall, cpu = self.runner.tick(HandConfiguration(*(values.copy() for values in self.haptic.values())))
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

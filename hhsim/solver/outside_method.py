"""Methods from outside: a class that is given the user's hand tick by tick, and says where the shown hand goes.

hhsim times it, and measures its hands as it does its own. See docs/outside-methods.md.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.solver.options import SolverOptions
from hhsim.trees.sphere_tree import SphereTree

if TYPE_CHECKING:
    from hhsim.kernels.tick.block import HapticBlock, TickRecord
    from hhsim.solver.workspace import TickWorkspace

SHAPES = {"position": (3,), "orientation": (4,), "flexion": (5, 3), "abduction": (5,)}
"""Of a hand's configuration."""
NATIVE = 1
"""Place of the method's own time among the parts of a tick: the optimisation of the whole hand."""
UNIT = 1e-6
"""A quaternion whose length is farther than this from 1 is none."""


@dataclass(frozen=True)
class MethodScene:
    """What a method is told before the first tick.

    Attributes:
        hand: Sizes, joint limits, and the spheres of the palm.
        mesh: The object [m], world; None where it is spheres alone.
        tree: Its sphere tree [m], world; None where it is triangles alone.
        options: Stiffness of the coupling, tick period, margin, and which surface is judged.
    """

    hand: HandModel
    mesh: Mesh | None
    tree: SphereTree | None
    options: SolverOptions

    @property
    def period(self) -> float:
        """Of a tick [s]."""
        return self.options.period


class TickAnswer(NamedTuple):
    """What a method may say of a tick besides the pose.

    Attributes:
        pose: The shown hand.
        phalanx_force: Contact force on each phalanx [N], world, shape (5, 3, 3); None where the method has no forces.
        palm_force: Contact force on the palm [N], world, shape (3,); None is none.
        native_ns: Of the tick, what the method's own engine took [ns], by its own measure; 0 where it has none.
    """

    pose: HandConfiguration
    phalanx_force: FloatArray | None = None
    palm_force: FloatArray | None = None
    native_ns: int = 0


class OutsideMethod(Protocol):
    """A method from outside; made anew for every run.

    A class may say `summary` (else the first line of its docstring is taken), `gives_forces = True` where its ticks
    have forces, `never_penetrates = True` where it promises that, and `missing`, what has to be installed before it can
    be made, or "".
    """

    def __init__(self, scene: MethodScene) -> None:
        """Prepare everything: what waits for the first tick is timed with it."""

    def begin(self, pose: HandConfiguration) -> None:
        """Go on from this shown hand, which is free; called before the first tick, and whenever the hand is moved."""

    def tick(self, haptic: HandConfiguration) -> HandConfiguration | TickAnswer:
        """Say where the shown hand goes, for the user's hand of this tick."""


class OutsideEngine:
    """Runs a method from outside, and finds out of its hands what `hhsim.kernels` would know.

    Args:
        name: For messages.
        make: Of the method for a scene.
        forces: Whether its ticks have forces.
    """

    def __init__(
        self, name: str, make: Callable[[MethodScene], OutsideMethod], forces: bool, workspace: "TickWorkspace"
    ) -> None:
        self.name, self.forces, self.workspace = name, forces, workspace
        # Views: to find a field of a record takes longer than to write it, and a tick has a dozen.
        states = workspace.states
        self.haptic = {field: states["haptic"][field][0] for field in HandConfiguration._fields}
        self.pose = {field: states["pose"][field][0] for field in (*HandConfiguration._fields, "joints")}
        self.palm_wrench, self.work = states["forces"]["palm_wrench"][0], states["work"][0]
        scene = MethodScene(workspace.model, workspace.mesh, workspace.tree, workspace.options)
        self.method = self._call("cannot be made", make, scene)
        self.ticks = 0

    def begin(self) -> None:
        """See `Engine.begin`."""
        self._call("fails in begin()", self.method.begin, self._shown())

    def run(self, haptic: "HapticBlock", record: "TickRecord") -> int:
        """See `Engine.run`.

        Raises:
            InputError: The method fails, or answers with what is no hand.
        """
        for i in range(len(haptic.position)):
            self._tick(HandConfiguration(*(values[i] for values in haptic)), i, record)
        return len(haptic.position)

    def _tick(self, sample: HandConfiguration, i: int, record: "TickRecord") -> None:
        from hhsim.kernels.hand.pose import is_finite_configuration
        from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, STATUS_INPUT_INVALID

        good = is_finite_configuration(*sample)
        if good:
            for name, values in sample._asdict().items():
                self.haptic[name][:] = values
            self.haptic["orientation"] /= np.linalg.norm(self.haptic["orientation"])
        # Copies, so that nothing of ours is the method's to write to.
        given = HandConfiguration(*(values.copy() for values in self.haptic.values()))
        cpu, wall = time.process_time_ns(), time.perf_counter_ns()
        found = self._call("fails", self.method.tick, given)
        wall, cpu = time.perf_counter_ns() - wall, time.process_time_ns() - cpu
        answer = found if isinstance(found, TickAnswer) else TickAnswer(found)
        for name, values in self._checked(answer.pose).items():
            self.pose[name][:] = values
        full = self._look()
        for field, values in self.pose.items():
            getattr(record, field)[i] = values
        record.palm_wrench[i] = self.palm_wrench
        record.work[i] = self.work
        if full & STATUS_CAPACITY_EXCEEDED:
            # It touches, however many pairs there are.
            record.work[i] = np.maximum(record.work[i], 1)
        record.status[i] = 0 if good else STATUS_INPUT_INVALID
        record.duration_total[i], record.duration_cpu[i] = wall, cpu
        record.duration[i, NATIVE] = int(answer.native_ns)
        self._take_forces(answer, i, record)
        self.ticks += 1

    def _look(self) -> int:
        from hhsim.kernels.tick.shown_hand import look_at

        workspace = self.workspace
        return int(look_at(workspace.hand, workspace.surface, workspace.tick_options, workspace.states))

    def _shown(self) -> HandConfiguration:
        return HandConfiguration(*(self.pose[field].copy() for field in HandConfiguration._fields))

    def _take_forces(self, answer: TickAnswer, i: int, record: "TickRecord") -> None:
        record.fingertip_normal[i] = np.nan
        if not self.forces:
            record.phalanx[i] = record.total[i] = np.nan
            return
        if answer.phalanx_force is None:
            raise self._wrong("promises forces (gives_forces) and gives none")
        record.phalanx[i] = self._array("phalanx_force", answer.phalanx_force, (5, 3, 3))
        palm = np.zeros(3) if answer.palm_force is None else self._array("palm_force", answer.palm_force, (3,))
        record.total[i] = record.phalanx[i].sum(axis=(0, 1)) + palm

    def _checked(self, pose: Any) -> dict[str, FloatArray]:
        if not isinstance(pose, tuple) or len(pose) != len(SHAPES):
            raise self._wrong(
                f"answers with {type(pose).__name__}: expected a HandConfiguration (position, orientation, flexion, "
                "abduction), or a TickAnswer"
            )
        found = {name: self._array(name, values, shape) for (name, shape), values in zip(SHAPES.items(), pose)}
        length = float(np.linalg.norm(found["orientation"]))
        if abs(length - 1.0) > UNIT:
            raise self._wrong(f"answers with an orientation of length {length:.6g}: expected a unit quaternion w x y z")
        found["orientation"] = found["orientation"] / length
        return found

    def _array(self, name: str, values: Any, shape: tuple[int, ...]) -> FloatArray:
        try:
            array = np.asarray(values, np.float64)
        except (TypeError, ValueError) as error:
            raise self._wrong(f"answers with a {name} that is no array of numbers") from error
        if array.shape != shape:
            raise self._wrong(f"answers with a {name} of shape {array.shape}: expected {shape}")
        if not np.isfinite(array).all():
            raise self._wrong(f"answers with a {name} that is not finite")
        return array

    def _wrong(self, what: str) -> InputError:
        return InputError(f"method '{self.name}' {what} (tick {self.ticks:,})")

    def _call(self, what: str, function: Callable[..., Any], *given: Any) -> Any:
        try:
            return function(*given)
        except InputError:
            raise
        except Exception as error:
            where = f" (tick {self.ticks:,})" if what == "fails" else ""
            raise InputError(f"method '{self.name}' {what}: {type(error).__name__}: {error}{where}") from error

"""Methods from outside, right and wrong, that tests name as `outside_methods:Class`."""

import itertools
import time

import numpy as np

import hhsim
from hhsim.hand.configuration import HandConfiguration
from hhsim.solver.outside_method import MethodScene, TickAnswer


class Follow:
    """The user's hand, through everything.

    More lines are not its summary.
    """

    def __init__(self, scene: MethodScene) -> None:
        self.scene = scene
        self.begun: list[HandConfiguration] = []

    def begin(self, pose: HandConfiguration) -> None:
        self.begun.append(pose)

    def tick(self, haptic: HandConfiguration) -> HandConfiguration | TickAnswer:
        return self.answer(haptic)

    def answer(self, haptic: HandConfiguration) -> HandConfiguration | TickAnswer:
        return haptic


class OurOwn(Follow):
    """The method `coupled` as somebody from outside would wrap it."""

    gives_forces = True
    never_penetrates = True

    def __init__(self, scene: MethodScene) -> None:
        super().__init__(scene)
        assert scene.tree is not None
        self.solver = hhsim.HandSolver(scene.hand, scene.tree.arrays(), hhsim.SolverOptions(period=scene.period))

    def begin(self, pose: HandConfiguration) -> None:
        self.solver.place(*pose)

    def answer(self, haptic: HandConfiguration) -> TickAnswer:
        tick = self.solver.run(*(values[None] for values in haptic))
        palm = tick.total[0] - tick.phalanx[0].sum(axis=(0, 1))
        return TickAnswer(HandConfiguration.of(tick).at(0), tick.phalanx[0], palm, int(tick.duration_cpu[0]))


class TurnedForces(OurOwn):
    """Gives the forces on the object for those on the hand."""

    def answer(self, haptic: HandConfiguration) -> TickAnswer:
        right = super().answer(haptic)
        assert right.phalanx_force is not None and right.palm_force is not None
        return right._replace(phalanx_force=-right.phalanx_force, palm_force=-right.palm_force)


class NoForces(Follow):
    """Promises forces."""

    gives_forces = True


class Promises(Follow):
    """Promises not to penetrate, and does."""

    never_penetrates = True


class Millimetres(Follow):
    """Positions in another unit."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        return haptic._replace(position=1e3 * haptic.position)


class Mirrored(Follow):
    """A left-handed frame."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        return haptic._replace(position=haptic.position * [1.0, -1.0, 1.0])


class Degrees(Follow):
    """Angles in another unit."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        return haptic._replace(flexion=np.degrees(haptic.flexion))


class Random(Follow):
    """Never the same twice."""

    count = itertools.count()

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        return haptic._replace(position=haptic.position + 1e-9 * next(self.count))


class Boasts(Follow):
    """Claims more time of its own than the tick took."""

    def answer(self, haptic: HandConfiguration) -> TickAnswer:
        return TickAnswer(haptic, native_ns=1_000_000_000)


class Lazy(Follow):
    """Prepares in the first tick."""

    ready = False

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        if not self.ready:
            self.ready = True
            until = time.process_time() + 0.03
            while time.process_time() < until:
                pass
        return haptic


class Writes(Follow):
    """Writes to what it is given."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        answer = haptic.copy()
        for values in haptic:
            values[...] = np.nan
        return answer


class Raises(Follow):
    """Fails in its third tick."""

    ticks = 0

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        self.ticks += 1
        if self.ticks == 3:
            raise ZeroDivisionError("of no\nuse")
        return haptic


class CannotBeMade(Follow):
    """Fails before the first tick."""

    def __init__(self, scene: MethodScene) -> None:
        raise FileNotFoundError("no weights")


class NotUnit(Follow):
    """A quaternion that is none."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        return haptic._replace(orientation=2.0 * haptic.orientation)


class WrongShape(Follow):
    """Joint angles in a row."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        return haptic._replace(flexion=haptic.flexion.ravel())


class NotFinite(Follow):
    """A hand that is nowhere."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        return haptic._replace(position=np.full(3, np.nan))


class NoNumbers(Follow):
    """Words."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        return haptic._replace(abduction="wide")  # type: ignore[arg-type]


class NoHand(Follow):
    """Nothing at all."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        return None  # type: ignore[return-value]


class NoTick:
    """Lacks what a method must have."""

    def begin(self, pose: HandConfiguration) -> None: ...


INSTANCE = Follow(None)  # type: ignore[arg-type]

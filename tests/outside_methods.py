"""Methods from outside, right and wrong, that tests name as `outside_methods:Class`."""

import ctypes
import itertools
import os
import sys
import time

import numpy as np

import hhsim
from hhsim.hand.configuration import HandConfiguration
from hhsim.solver.outside_method import MethodScene, TickAnswer

PROCESS_TIME = time.process_time


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


class NotBuilt(Follow):
    missing = "needs a library that is not built"

    def __init__(self, scene: MethodScene) -> None:
        raise OSError("cannot open shared object file")


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


class Modest(Follow):
    """Says what its own engine took."""

    def answer(self, haptic: HandConfiguration) -> TickAnswer:
        return TickAnswer(haptic, native_ns=123)


class Boasts(Follow):
    """Claims more time of its own than the tick took."""

    def answer(self, haptic: HandConfiguration) -> TickAnswer:
        return TickAnswer(haptic, native_ns=10**15)


class Owes(Follow):
    """Claims less than no time."""

    def answer(self, haptic: HandConfiguration) -> TickAnswer:
        return TickAnswer(haptic, native_ns=-(10**18))


class Leaves(Follow):
    """Ends the interpreter."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        sys.exit(0)


class Interrupts(Follow):
    """Raises what Ctrl-C raises."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        raise KeyboardInterrupt


class Talks(Follow):
    """Prints in three ways, and goes elsewhere."""

    def begin(self, pose: HandConfiguration) -> None:
        self.answer(pose)

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        print("printed")
        os.write(1, b"written\n")
        ctypes.CDLL(None).puts(b"by C")
        os.chdir("/")
        return haptic


class StopsTheClock(Follow):
    """Has the time stand still, and works for 2 ms."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        until = PROCESS_TIME() + 0.003
        for name in ("perf_counter_ns", "process_time_ns", "perf_counter", "process_time"):
            setattr(time, name, lambda: 0)
        while PROCESS_TIME() < until:
            pass
        return haptic


class Rewrites(Follow):
    """Writes to all arrays of its scene."""

    def __init__(self, scene: MethodScene) -> None:
        super().__init__(scene)
        assert scene.mesh is not None
        for array in (scene.mesh.vertices, scene.hand.length):
            array.flags.writeable = True
            array[...] = 7.0


class Dies(Follow):
    """Its process ends in its third tick by a fault of the memory."""

    count = 0

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        self.count += 1
        if self.count == 3:
            ctypes.string_at(0)
        return haptic


class Exits(Follow):
    """Its process ends in its first tick without a word."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        os._exit(0)


class Grows(Follow):
    """Asks for more memory than there is."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        self.kept = np.ones(2**44)
        return haptic


class NeverEnds(Follow):
    """Its second tick does not end."""

    count = 0

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        self.count += 1
        while self.count == 2:
            pass
        return haptic


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

"""Methods from outside, right and wrong, that tests name as `outside_methods:Class`."""

import itertools
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import hhsim
from hhsim.hand.configuration import HandConfiguration
from hhsim.solver.outside_method import MethodScene, TickAnswer

PROCESS_TIME = time.process_time
COUNT = itertools.count()


class Follow:
    """The user's hand, through everything.

    More lines are not its summary.
    """

    def __init__(self, scene: MethodScene) -> None:
        self.scene = scene
        self.begun: list[HandConfiguration] = []
        self.ticks = 0

    def begin(self, pose: HandConfiguration) -> None:
        self.begun.append(pose)

    def tick(self, haptic: HandConfiguration) -> HandConfiguration | TickAnswer:
        self.ticks += 1
        return self.answer(haptic)

    def answer(self, haptic: HandConfiguration) -> HandConfiguration | TickAnswer:
        return haptic


def answering(answer: Callable[[HandConfiguration], Any]) -> type[Follow]:
    """A class whose ticks answer so."""
    return type("Answering", (Follow,), {"answer": lambda _, haptic: answer(haptic)})


def work_for(seconds: float) -> None:
    until = PROCESS_TIME() + seconds
    while PROCESS_TIME() < until:
        pass


Millimetres = answering(lambda haptic: haptic._replace(position=1e3 * haptic.position))
Mirrored = answering(lambda haptic: haptic._replace(position=haptic.position * [1.0, -1.0, 1.0]))
Degrees = answering(lambda haptic: haptic._replace(flexion=np.degrees(haptic.flexion)))
Random = answering(lambda haptic: haptic._replace(position=haptic.position + 1e-9 * next(COUNT)))
NotUnit = answering(lambda haptic: haptic._replace(orientation=2.0 * haptic.orientation))
WrongShape = answering(lambda haptic: haptic._replace(flexion=haptic.flexion.ravel()))
NotFinite = answering(lambda haptic: haptic._replace(position=np.full(3, np.nan)))
NoNumbers = answering(lambda haptic: haptic._replace(abduction="wide"))  # type: ignore[arg-type]
NoHand = answering(lambda haptic: None)
Boasts = answering(lambda haptic: TickAnswer(haptic, native_ns=10**15))
Owes = answering(lambda haptic: TickAnswer(haptic, native_ns=-(10**18)))
Leaves = answering(lambda haptic: sys.exit(0))
Grows = answering(lambda haptic: np.ones(2**44))


class NotBuilt(Follow):
    gives_forces = True
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


class PushedEverywhere(Follow):
    """Says that the palm of the user's own hand is pushed."""

    gives_forces = True

    def answer(self, haptic: HandConfiguration) -> TickAnswer:
        return TickAnswer(haptic, np.zeros((5, 3, 3)), np.array([0.0, 0.0, 1.0]), native_ns=7)


class NoForces(Follow):
    gives_forces = True


class Promises(Follow):
    never_penetrates = True


class Interrupts(Follow):
    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        raise KeyboardInterrupt


class Talks(Follow):
    def begin(self, pose: HandConfiguration) -> None:
        self.answer(pose)

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        print("printed")
        return haptic


class StopsTheClock(Follow):
    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        for name in ("perf_counter_ns", "process_time_ns", "perf_counter", "process_time"):
            setattr(time, name, lambda: 0)
        work_for(0.003)
        return haptic


class Lazy(Follow):
    """Prepares in the first tick."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        if self.ticks == 1:
            work_for(0.03)
        return haptic


class Writes(Follow):
    """Writes to what it is given."""

    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        answer = haptic.copy()
        for values in haptic:
            values[...] = np.nan
        return answer


class Raises(Follow):
    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        if self.ticks == 3:
            raise ZeroDivisionError("of no\nuse")
        return haptic


class Crashes(Follow):
    def answer(self, haptic: HandConfiguration) -> HandConfiguration:
        os._exit(3)


class CannotBeMade(Follow):
    def __init__(self, scene: MethodScene) -> None:
        raise FileNotFoundError("no weights")


class NoTick:
    def begin(self, pose: HandConfiguration) -> None: ...


INSTANCE = Follow(None)  # type: ignore[arg-type]

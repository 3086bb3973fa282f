"""Session of two gloves, one for each hand of a user: two loops, one watchdog, one file.

Each hand has a loop, a driver and a recorder, as it has alone, and does not know where the other one is. The watchdog
watches both: what frees all fingers of one hand by a fault frees those of the other one.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Self

import numpy as np

from hhsim.errors import HhsimError, InputError
from hhsim.hand.model import SIDES
from hhsim.live.ipc.config import LiveSetup
from hhsim.live.ipc.status import Stage
from hhsim.live.session.supervisor import Say, SessionOutcome, Supervisor
from hhsim.result.merge import merge_hands
from hhsim.result.reader import load_result
from hhsim.result.schema import INFORMATION
from hhsim.system.output_path import free_name


class TwoGloves:
    """A session of the right and the left glove, as a context manager that ends it in order on every way out.

    Setups are of one object, time and file, InputError otherwise; what each hand records lies in files of their own
    until the session has ended. `say` is as of `Supervisor`, its lines begin with the hand; `hands` are both sessions.
    """

    def __init__(self, setups: Sequence[LiveSetup], say: Say = lambda text, level: None) -> None:
        _check(setups)
        self._record, self._say = setups[0].record, say
        if self._record is not None:
            path = self._record
            parts = [free_name(path.with_name(f"{path.stem}.{side}.partial{path.suffix}")) for side in SIDES]
            setups = [replace(setup, record=part) for setup, part in zip(setups, parts)]
        right = Supervisor(setups[0], lambda text, level: say(f"right hand: {text}", level))
        left = Supervisor(setups[1], lambda text, level: say(f"left hand: {text}", level), right)
        self.hands = (right, left)
        self._running = ExitStack()
        self._joined = False
        self._failed = ""

    def __enter__(self) -> Self:
        """Start both hands' processes; HhsimError if one cannot be started, with none left running."""
        with ExitStack() as stack:
            for hand in self.hands:
                stack.enter_context(hand)
            self._running = stack.pop_all()
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        self._stop_others("an error" if kind is not None else "")
        self._running.close()

    def poll(self) -> bool:
        """Watch both hands' processes, as `Supervisor.poll`; True while the session goes on.

        A hand that ends before its time ends the session.
        """
        going = [hand.poll() and hand.stage < Stage.ENDING for hand in self.hands]
        if not all(going) and not all(on or hand.over for on, hand in zip(going, self.hands)):
            self._stop_others("the other hand's session ended")
            return False
        return any(going)

    def request_stop(self, reason: str) -> None:
        """Request both loops to free the fingers and end; the first reason is kept."""
        for hand in self.hands:
            hand.request_stop(reason)

    def end(self, reason: str = "") -> tuple[SessionOutcome, SessionOutcome]:
        """End all processes, the watchdog last, and join the recordings; returns the right and the left hand's outcome.

        A hand of a file that is not whole keeps its own.
        """
        self._stop_others(reason)
        right, left = self.hands
        second = left.end(reason)
        outcomes = right.end(reason), second
        if self._record is None:
            return outcomes
        if not self._joined and not self._failed:
            self._join(outcomes)
        if not self._joined:
            return outcomes
        return replace(outcomes[0], record=self._record), replace(outcomes[1], record=self._record)

    def check(self) -> None:
        """Raise the failure of the session after `end`, as `Supervisor.check`, of the hand that failed."""
        self.end()
        for hand, side in zip(self.hands, SIDES):
            try:
                hand.check()
            except HhsimError as error:
                raise type(error)(f"{side} hand: {error}") from error
        if self._failed:
            raise HhsimError(f"the recording {self._record} is not whole: {self._failed}")

    def _stop_others(self, reason: str) -> None:
        """Request hands to end that have neither ended nor are about to."""
        for hand in self.hands:
            if hand.stage < Stage.ENDING and not hand.over and not hand.memory.status["stop_requested"]:
                hand.request_stop(reason)

    def _join(self, outcomes: Sequence[SessionOutcome]) -> None:
        assert self._record is not None
        parts = [outcome.record for outcome in outcomes if outcome.record is not None]
        whole = [outcome.recorded > 0 and load_result(part).complete for outcome, part in zip(outcomes, parts)]
        if not all(whole):
            kept = [str(part) for part in parts if part.exists()]
            missing = " and ".join(side for side, there in zip(SIDES, whole) if not there)
            self._failed = f"the {missing} hand's is missing or was cut short; what there is: {', '.join(kept) or '-'}"
            return
        self._say(f"joining both hands in {self._record}", INFORMATION)
        try:
            merge_hands(parts, self._record)
            self._joined = True
        except HhsimError as error:
            self._failed = f"{error}; each hand's own: {', '.join(map(str, parts))}"


def _check(setups: Sequence[LiveSetup]) -> None:
    right, left = setups
    if (right.hand.side, left.hand.side) != SIDES:
        raise InputError(f"gloves of the {right.hand.side} and the {left.hand.side} hand: expected right, left")
    if right.free is not None or left.free is not None:
        raise InputError("two hands on a free object are not solved: leave --free out, or name one glove")
    if not np.array_equal(right.mesh.vertices, left.mesh.vertices):
        raise InputError("the motions of the two gloves have the object at different places")

"""The report's pictures of the hand: skin for the graphic hand, blue glass for the haptic one, forces in red."""

from hhsim.report_figures import ReportFigure
from hhsim.result import Result


def overview_picture(result: Result) -> ReportFigure:
    """The hand on the object at the end of the first hold, or at the last tick where nothing is held.

    Raises:
        InputError: the result holds no tick, or its hand cannot be told (`hhsim.result_hand.hand_of`).
    """
    raise NotImplementedError


def hand_picture(result: Result, tick: int, view: tuple[float, float] | None = None) -> ReportFigure:
    """The hand at one tick, with contact points and forces.

    Args:
        result: what was run.
        tick: number of the tick, from 0.
        view: azimuth from x to y and elevation [degrees] of the viewer; None for the clearest of some.

    Raises:
        InputError: there is no such tick, or the result's hand cannot be told (`hhsim.result_hand.hand_of`).
    """
    raise NotImplementedError

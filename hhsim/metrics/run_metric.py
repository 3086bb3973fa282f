"""Figures of a run: name, display, judgement and computation."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from hhsim.metrics.run_ticks import RunTicks
from hhsim.table.table import shown, stored_unit, unit_size

F = TypeVar("F", bound="Figure")


@dataclass(frozen=True)
class Figure:
    """Named number, and its display in a table."""

    name: str  # attribute of the result file and key in JSON
    label: str  # label for people
    digits: int = 0  # digits after the decimal point
    unit: str = ""  # unit of the shown value
    less_is_better: bool = True  # False where more is neither better nor worse
    signed: bool = False  # True if it may be negative, and the nearer to 0 the better
    paper: str = ""  # the paper's figure as printed there, in `unit`, or ""

    @property
    def scale(self) -> float:
        """Factor from a shown value to the stored one."""
        return unit_size(self.unit)

    @property
    def stored_unit(self) -> str:
        """Unit of the stored value: SI, % where the figure is defined so, "1" for counts."""
        return stored_unit(self.unit)

    def shown(self, value: float) -> str:
        """Return a stored value as the table shows it; "—" where it is undefined."""
        return shown(value / self.scale, self.digits)


@dataclass(frozen=True)
class Judged:
    """Judgement of a figure by the gate."""

    rounding: float = 0.0  # difference up to which values are the same [SI, or %]
    limit: float | None = None  # largest value by default [SI, or %], the same for every method; None for no limit
    growth: float = math.nan  # largest excess over the base's value where there is no limit; NaN for any
    # attribute of `hhsim.solver.method.Method` without which a method is exempt from the limit; "" for none
    promise: str = ""


@dataclass(frozen=True, kw_only=True)
class RunMetric(Figure):
    """Figure of a run, in SI units, or in % where it is defined so; NaN where it is undefined.

    Either `compute` computes it from the ticks in the file, or it needs further runs of the solver: then `own_run` says
    which, and `hhsim.replay.summary` computes it.
    """

    needs: tuple[str, ...] = ()  # datasets of /tick that `compute` reads, or a run of its own makes anew
    compute: Callable[[RunTicks], float] | None = None  # function of the ticks; None for a figure of runs of its own
    own_run: str = ""  # reason why it does not follow from the ticks, or ""
    # relative difference of a time between equal runs; infinite where single ticks decide; 0 for exact figures
    noise: float = 0.0
    judged: Judged | None = None  # judgement by the gate; None for none
    moving_hold: Figure | None = None  # display where the hold's input moves, as a live hand's does
    moving_hold_only: bool = False  # True if it is shown only there
    # line of the short table that it stands in, or ""; the last defined of a line's figures stands there
    short: str = ""
    free_only: bool = False  # True for a figure of a free object
    of_body: bool = False  # True for one of a body alone, which is the same whichever hand it is computed for
    unless_zero: bool = False  # True if it has no line where it is 0


def each_with(*metrics: F, **also: Any) -> tuple[F, ...]:
    """Return figures with what holds for each of them."""
    return tuple(replace(metric, **also) for metric in metrics)

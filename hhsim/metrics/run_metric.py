"""What a figure of a run is: its names, how it is shown, how it is judged, and how it is computed."""

from collections.abc import Callable
from dataclasses import dataclass

from hhsim.metrics.run_ticks import RunTicks
from hhsim.table.table import shown, stored_unit, unit_size

PAPER_RATE = 1000.0
"""Ticks per second of the paper's haptic loop [Hz]."""

STORED = {
    "": ("1", 1.0),
    "units": ("1", 1.0),
    "% of hold": ("%", 1.0),
    "mm": ("m", 1e-3),
    "µm": ("m", 1e-6),
    "µm/s": ("m/s", 1e-6),
    "µs": ("s", 1e-6),
    "µJ": ("J", 1e-6),
}
"""Of units that are shown, the one that is stored, and the size of the shown one in it; others are stored as shown."""


@dataclass(frozen=True)
class Figure:
    """A number under a name, and how a table shows it.

    Attributes:
        name: Of the attribute in the result file and of the key in JSON.
        label: For people.
        digits: Behind the point.
        unit: Of what is shown.
        less_is_better: False where more is neither better nor worse.
        signed: Whether it may be below 0, where it is as wrong as above: the nearer to 0 the better.
        paper: The paper's figure as printed there, in `unit`, or "".
    """

    name: str
    label: str
    digits: int = 0
    unit: str = ""
    less_is_better: bool = True
    signed: bool = False
    paper: str = ""

    @property
    def scale(self) -> float:
        """Return what a shown value is multiplied by to be the value itself."""
        return unit_size(self.unit)

    @property
    def stored_unit(self) -> str:
        """Of the value itself: SI, % where the figure is defined so, "1" for counts."""
        return stored_unit(self.unit)

    def shown(self, value: float) -> str:
        """A value, SI or % where the figure is defined so, as the table shows it; "—" where it is undefined."""
        return shown(value / self.scale, self.digits)


@dataclass(frozen=True)
class Judged:
    """How the gate judges a figure.

    Attributes:
        rounding: Values that differ by no more are the same [SI, or %].
        limit: Largest value of a project that sets none [SI, or %], the same for every method; None for no limit.
        promise: Attribute of `hhsim.solver.method.Method` without which a method is not held to the limit; "" where
            every method is.
    """

    rounding: float = 0.0
    limit: float | None = None
    promise: str = ""


@dataclass(frozen=True, kw_only=True)
class RunMetric(Figure):
    """A figure of a run, in SI units, or in % where it is defined so; NaN where it is undefined.

    One kind is computed from the ticks in the file, by `compute`. The other kind needs further runs of the solver
    and does not follow from the file: `own_run` says what it is of, and `hhsim.replay.summary` computes it.

    Attributes:
        place: In the table; those of the same place are in the order of their modules.
        needs: Datasets of /tick that `compute` reads, or a run of its own makes anew.
        compute: From the ticks; None for a figure of runs of its own.
        own_run: Why it does not follow from the ticks, or "".
        noise: Of a time, the share by which it may differ from run to run and say nothing; infinite where single ticks
            decide, so that no two runs can be compared by it; 0 for what is exact.
        per_tick: Whether it is a change from tick to tick: the paper's figure is then of ticks of 1 ms.
        judged: How the gate judges it; None where it does not.
        moving_hold: How it is shown where the hold's input moves, as a live hand's does.
        moving_hold_only: Whether it is shown there alone.
        short: Line of the short table that it stands in, or ""; of several figures for one line the last that is
            defined stands there.
        free_only: Whether it is one of a free object, and absent where the object is not.
        unless_zero: Whether it has no line where it is 0: of nothing there is no largest.
    """

    place: int = 1000
    needs: tuple[str, ...] = ()
    compute: Callable[[RunTicks], float] | None = None
    own_run: str = ""
    noise: float = 0.0
    per_tick: bool = False
    judged: Judged | None = None
    moving_hold: Figure | None = None
    moving_hold_only: bool = False
    short: str = ""
    free_only: bool = False
    unless_zero: bool = False

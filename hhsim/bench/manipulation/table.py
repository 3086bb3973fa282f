"""Table of `hhsim bench manipulation`: a row for each figure and method, exact and measured."""

import importlib.util
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from hhsim.bench.manipulation.answers import CASES, Answer, Lengths, rest_answers
from hhsim.bench.manipulation.gripper import own_outcome
from hhsim.bench.manipulation.mujoco_block import CONFIGURATIONS, mujoco_pinch, mujoco_rest
from hhsim.bench.manipulation.pinch import Pinch, PinchOutcome, Rest
from hhsim.errors import InputError, check_known
from hhsim.system.progress import Progress, silent
from hhsim.table.table import Column

Row = Mapping[str, Any]

OURS = "coupled"
PINCH = "pinch"
REST = "rest"
"""Cases that engines play too."""
SQUEEZES = (1.05, 1.5, 3.0)
"""Squeezes of the pinches over the least one that bears the weight."""
COLUMNS = (
    Column("case", "what was played"),
    Column("method", "by which method"),
    Column("figure", "what was measured"),
    Column("unit", "of the next four; 1 for shares and truths"),
    Column("exact", "what it should be"),
    Column("measured", "what it is"),
    Column("off", "by how much it is off"),
    Column("allowed", "by how much it may be off; NaN: nothing is promised"),
    Column("holds", "1 where it is off by no more than that, 0 where it is, -1 where nothing is promised"),
)


@dataclass(frozen=True, kw_only=True)
class ManipulationOptions:
    """Options of the suite: names of cases, none for all, and durations of rest and hold [s]."""

    cases: tuple[str, ...] = ()
    rest: float = 600.0
    held: float = 60.0

    def __post_init__(self) -> None:
        """Raise InputError for an unknown case or a duration out of range."""
        check_known("case", self.cases, case_names())
        for name in ("rest", "held"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 1.0):
                raise InputError(f"{name} is {value:g} s: it must be at least 1 s")

    @classmethod
    def quick(cls, **named: Any) -> "ManipulationOptions":
        """Return options with short rests and holds, but for those given."""
        return cls(**{"rest": 10.0, "held": 5.0, **named})


def case_names() -> tuple[str, ...]:
    """Return the names of all cases."""
    return (*CASES, PINCH)


def measure(options: ManipulationOptions, progress: Progress = silent) -> list[Row]:
    """Play the cases and return the rows of the table."""
    rows: list[Row] = []
    chosen = options.cases or case_names()
    for done, name in enumerate(chosen):
        progress(name, done, len(chosen))
        if name == PINCH:
            rows += pinch_rows(options.held)
        else:
            rows += [_row(OURS, answer) for answer in CASES[name](Lengths(rest=options.rest, held=options.held))]
        if name == REST and has_mujoco():
            rows += _engine_rests(Rest(options.rest))
    return rows


def _engine_rests(rest: Rest) -> list[Row]:
    rows = []
    for name, configuration in CONFIGURATIONS.items():
        answers = rest_answers(rest, *mujoco_rest(rest, configuration))
        rows += [_row(name, answer, promised=False) for answer in answers]
    return rows


def pinch_rows(held: float) -> list[Row]:
    """Return the rows of a pinch by our method, and by MuJoCo with its options if it is installed."""
    players: dict[str, Callable[[Pinch], PinchOutcome]] = {OURS: own_outcome}
    if has_mujoco():
        for name, configuration in CONFIGURATIONS.items():
            players[name] = partial(mujoco_pinch, options=configuration)
    rows = []
    for share in SQUEEZES:
        pinch = Pinch(hold=held)
        pinch = replace(pinch, squeeze=share * pinch.threshold)
        for name, play in players.items():
            found = play(pinch)
            case = f"100 g pinched with {share:g} times the least squeeze, μ 0.5"
            promised = name == OURS
            figures = [
                Answer(case, "lifted", "1", 1.0, float(found.lifted), 0.0),
                Answer(case, f"creep in {held - 0.5:g} s", "m", 0.0, found.creep, 1e-6),
                Answer(case, "fingertip in the block, most", "m", 0.0, found.depth, 1e-9),
            ]
            rows += [_row(name, answer, promised=promised) for answer in figures]
    return rows


def has_mujoco() -> bool:
    """Return True if MuJoCo is installed."""
    return importlib.util.find_spec("mujoco") is not None


def missed(rows: Sequence[Row]) -> list[Row]:
    """Return the rows whose figure is off by more than allowed."""
    return [row for row in rows if row["holds"] == 0]


def remarks() -> list[str]:
    """Return remarks on the table."""
    note = "MuJoCo is not installed, so pinch and rest have our rows alone: pip install 'hhsim[mujoco]'"
    return [] if has_mujoco() else [note]


def _row(method: str, answer: Answer, *, promised: bool = True) -> Row:
    return {
        "case": answer.case,
        "method": method,
        "figure": answer.what,
        "unit": answer.unit,
        "exact": answer.exact,
        "measured": answer.measured,
        "off": answer.off,
        "allowed": answer.allowed if promised else math.nan,
        "holds": int(answer.holds) if promised else -1,
    }

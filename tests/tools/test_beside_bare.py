"""The loop beside a bare one: what is counted, and which limit is missed."""

import numpy as np
import pytest

from hhsim.result.miss_cause import MissCause
from tools.beside_bare import Beside, Turns


def beside(loop: int, bare: int, computed: int = 0) -> Beside:
    late = [np.arange(1000) * 1000]
    both = Beside(1000.0, {"sim": Turns(100_000, loop, woke=late)}, Turns(100_000, bare, woke=late))
    both.gloves["sim"].causes |= {MissCause.COMPUTED: computed, MissCause.HOST: loop - computed}
    return both


@pytest.mark.parametrize(
    ("loop", "computed", "interrupted", "missed"),
    [
        (120, 0, 0, []),
        (121, 0, 0, ["sim: the loop missed 0.1210 % of its periods, the bare loop 0.1000 %"]),
        (1, 1, 0, ["sim: 1 periods were missed by the loop's own computing"]),
        (3, 3, 2, ["sim: 1 periods were missed by the loop's own computing"]),
    ],
    ids=["a fifth more than bare", "more than that", "its own computing", "what interrupts took is not"],
)
def test_a_limit_that_is_missed_is_told(loop: int, computed: int, interrupted: int, missed: list[str]) -> None:
    both = beside(loop, 100, computed)
    both.gloves["sim"].interrupted = interrupted
    assert both.missed_limits() == missed

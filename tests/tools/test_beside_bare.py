"""The loop beside a bare one: what is counted, and which limit is missed."""

import numpy as np

from hhsim.result.miss_cause import MissCause
from tools.beside_bare import Beside, Turns, table


def beside(loop: int, bare: int, computed: int = 0) -> Beside:
    late = [np.arange(1000) * 1000]
    both = Beside(1000.0, Turns(100_000, loop, woke=late), Turns(100_000, bare, woke=late))
    both.loop.causes[MissCause.COMPUTED] = computed
    return both


def test_a_loop_that_misses_a_fifth_more_than_the_bare_one_is_let_pass() -> None:
    assert beside(120, 100).missed_limits() == []
    assert beside(121, 100).missed_limits() == ["the loop missed 121 periods, the bare loop 100"]


def test_a_period_of_its_own_making_is_none_too_few() -> None:
    assert beside(1, 100, computed=1).missed_limits() == ["1 periods were missed by the loop's own computing"]


def test_a_recording_that_is_not_whole_is_told() -> None:
    both = beside(1, 1)
    both.lost, both.differing = 3, 1
    assert len(both.missed_limits()) == 2


def test_the_table_has_both_in_microseconds() -> None:
    lines = table(beside(120, 100)).splitlines()
    (wakeup,) = (line for line in lines if line.startswith("wake-up p50"))
    assert wakeup.split()[-2:] == ["500", "500"]

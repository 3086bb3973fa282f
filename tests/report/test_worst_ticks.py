"""The worst ticks of a report: what is said of them agrees with the table."""

from pathlib import Path

import numpy as np
from sealed_change import changed
from short_grasp import short_result

from hhsim.report.worst_ticks import worst_ticks
from hhsim.result.reader import load_result


def test_the_slowest_tick_is_compared_with_the_median_of_the_table(tmp_path: Path) -> None:
    path = short_result(tmp_path / "run.h5").path
    with changed(path) as file:
        contact = file["tick/contacts/candidates"][...] > 0
        assert contact.any() and not contact.all()
        # Free space is ten times as quick as contact, and the slowest tick takes 450 µs.
        cpu = np.where(contact, 10_000, 1_000)
        cpu[-1] = 450_000
        file["tick/duration/total_cpu"][...] = cpu
    slowest = next(worst for worst in worst_ticks(load_result(path)) if worst.kind == "slowest")
    assert "took 450.0 µs of CPU time, 45.0 times the median of ticks in contact" in slowest.sentence

"""The system's accounts of who had the processor, from its files and from ones that are broken or not there."""

import os
from pathlib import Path

import pytest

from hhsim.live.cpu_accounts import UNKNOWN, CpuAccounts

STAT = """cpu  30 0 20 900 1 0 0 {both} 0 0
cpu0 10 0 10 400 1 0 0 {first} 0 0
cpu1 20 0 10 500 0 0 0 {second} 0 0
intr 5 4 3
"""


def planted(folder: Path, first: int = 4, second: int = 7, schedule: str = "11 222 3\n") -> Path:
    (folder / "thread-self").mkdir(exist_ok=True)
    (folder / "stat").write_text(STAT.format(first=first, second=second, both=first + second))
    (folder / "thread-self" / "schedstat").write_text(schedule)
    return folder


def test_steal_is_that_of_the_processors_meant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    step = 1_000_000_000 // os.sysconf("SC_CLK_TCK")
    for cpu, steps in ((0, 4), (1, 7), (None, 11)):
        accounts = CpuAccounts(cpu, planted(tmp_path))
        assert (accounts.steal_ns(), accounts.run_delay_ns()) == (steps * step, 222)
        accounts.close()


def test_a_reading_is_of_now(tmp_path: Path) -> None:
    accounts = CpuAccounts(1, planted(tmp_path))
    before = accounts.steal_ns(), accounts.run_delay_ns()
    planted(tmp_path, second=9, schedule="12 5000222 4\n")
    assert accounts.steal_ns() - before[0] == 2 * accounts.steal_step_ns
    assert accounts.run_delay_ns() - before[1] == 5_000_000
    accounts.close()
    accounts.close()


@pytest.mark.parametrize("stat", [None, "", "cpu  1 2 3\ncpu1 20 0 10 500\n", "intr 1\n"])
@pytest.mark.parametrize("schedule", [None, "", "0\n", "a b c\n"])
def test_what_nobody_counts_is_unknown(tmp_path: Path, stat: str | None, schedule: str | None) -> None:
    planted(tmp_path)
    for path, text in ((tmp_path / "stat", stat), (tmp_path / "thread-self" / "schedstat", schedule)):
        path.unlink()
        if text is not None:
            path.write_text(text)
    accounts = CpuAccounts(1, tmp_path)
    assert (accounts.steal_ns(), accounts.run_delay_ns()) == (UNKNOWN, UNKNOWN)

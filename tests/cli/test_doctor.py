"""`hhsim doctor`: the verdict, why, and the exit code by the stated limits."""

import json
import re

import numpy as np
import pytest
from conftest import Run

from hhsim.live import doctor
from hhsim.live.doctor import Wakeups
from hhsim.live.real_time import RealTimeWishes
from hhsim.live.session.settings import RATE_RANGE
from hhsim.result.miss_cause import CAUSES, MissCause


@pytest.fixture
def missed(monkeypatch: pytest.MonkeyPatch) -> dict[MissCause, int]:
    """Missed periods of a measurement that is planted; to be filled."""
    causes = dict.fromkeys(CAUSES, 0)

    def measure(rate: float, seconds: float, wishes: RealTimeWishes) -> Wakeups:
        count = sum(causes.values())
        late = np.full(round(rate * seconds) - count, 31_000, np.int64)
        late[:count] = 1_400_000
        mode = {"fifo": 0, "memory_locked": False, "timer_slack_ns": 1, "cpu": -1, "gc_frozen": False, "refused": []}
        return Wakeups(rate, late, count, 1 if count else 0, causes, None, 10_000_000 * causes[MissCause.HOST], mode)

    monkeypatch.setattr(doctor, "measure_wakeups", measure)
    return causes


def test_a_machine_that_keeps_the_rate(run: Run, missed: dict[MissCause, int]) -> None:
    answer = run("doctor")
    assert answer.code == 0
    assert "this machine keeps 1,000 Hz: none of 10,000 periods was missed" in answer.out
    assert re.search(r"run delay +not told", answer.out)
    document = json.loads(run("doctor", "--rate", "500", "--duration", "2", "--json").out)
    assert (document["good"], document["periods"], document["advice"]) == (True, 1000, [])


@pytest.mark.parametrize("rate", RATE_RANGE)
def test_any_rate_of_a_session_can_be_asked_for(run: Run, missed: dict[MissCause, int], rate: float) -> None:
    assert json.loads(run("doctor", "--rate", str(rate), "--json").out)["rate"] == rate
    refused = run("doctor", "--rate", str(2.0 * rate if rate > 100.0 else 0.5 * rate))
    assert (refused.code, refused.out) == (2, "")


def test_a_machine_that_does_not(run: Run, missed: dict[MissCause, int]) -> None:
    missed[MissCause.HOST], missed[MissCause.WOKEN_LATE] = 30, 4
    answer = run("doctor")
    assert answer.code == 1
    assert "34 of 10,000 periods were missed" in answer.out
    assert "(woken late 4, taken by the host 30)" in answer.out
    assert f"  - {doctor.HOST_ADVICE}\n" in answer.out
    document = json.loads(run("doctor", "--json").out)
    assert document["missed_by"] == {"computed": 0, "woken_late": 4, "host": 30, "device": 0}
    assert (document["good"], round(1e3 * document["steal"])) == (False, 300)
    quiet = run("doctor", "--quiet")
    assert (quiet.code, quiet.out) == (1, "")


def test_a_real_measurement_names_every_missed_period(run: Run) -> None:
    answer = run("doctor", "--no-realtime", "--duration", "0.2", "--json")
    document = json.loads(answer.out)
    assert answer.code == (0 if document["good"] else 1)
    assert document["periods"] >= 200
    assert sum(document["missed_by"].values()) == document["missed"]
    assert document["real_time"]["fifo"] == 0

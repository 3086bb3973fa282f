"""The memory and the setup of a live session, as other processes see them."""

import subprocess
import sys

import pytest
from live_scripted import make_setup

from hhsim.errors import HhsimError, InputError
from hhsim.live.gloves import configure
from hhsim.live.session.memory import FACT_BYTES, SessionMemory
from hhsim.live.session.settings import LiveSetup, OutputLimits, SafetyLimits

CHILD = """
from hhsim.live.session.memory import session_process
from hhsim.live.session.memory import TickReader
setup, memory = session_process("child")
first, (ticks,) = TickReader(memory).read_hands(10)
heartbeat, bodies = int(memory.status["heartbeat_ns"]), ticks["turn"].shape[1]
print(first, ticks["tick"].tolist(), heartbeat, memory.facts.read(), setup.rate, setup.worn[0].device.kind, bodies)
memory.status["recorder_ticks"] = 77
"""


@pytest.fixture(scope="module")
def setup() -> LiveSetup:
    return make_setup(device=configure("sim"), rate=500.0)


@pytest.mark.parametrize("bodies", [0, 1, 3])
@pytest.mark.quick("3")
def test_a_child_sees_the_memory_and_the_setup(setup: LiveSetup, bodies: int) -> None:
    memory = SessionMemory.create(bodies=bodies)
    descriptor = memory.with_setup(setup)
    memory.status["heartbeat_ns"] = 123
    memory.facts.write({"real_time": {"fifo": True}})
    for tick in (4, 5, 9):
        memory.ticks.slot()["tick"] = tick
        memory.ticks.publish()
    for _ in range(2):
        # Twice: a reader must not take the setup away from the next one.
        child = subprocess.run(
            [sys.executable, "-c", CHILD, "--setup", str(descriptor)],
            pass_fds=(descriptor, *memory.descriptors),
            capture_output=True,
            text=True,
            check=False,
        )
        assert child.returncode == 0, child.stderr
        assert child.stdout == f"0 [4, 5, 9] 123 {{'real_time': {{'fifo': True}}}} 500.0 sim {bodies}\n"
    assert memory.status["recorder_ticks"] == 77
    assert (memory.status["battery"], memory.status["sample_ns"]) == (-1, -1), "nobody knows them yet"


def test_a_system_without_such_memory_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr("os.memfd_create")
    with pytest.raises(HhsimError, match="need Linux"):
        SessionMemory.create()


def test_facts_are_replaced_whole_and_bounded() -> None:
    memory = SessionMemory.create()
    assert memory.facts.read() == {}
    memory.facts.write({"long": "x" * 1000})
    memory.facts.write({"short": 1})
    assert memory.facts.read() == {"short": 1}
    with pytest.raises(ValueError, match="fit"):
        memory.facts.write({"too": "x" * FACT_BYTES})
    assert memory.facts.read() == {"short": 1}


@pytest.mark.parametrize(
    ("kind", "wrong", "word"),
    [
        (OutputLimits, {"stiffness": (0.5,) * 4}, "stiffness = .* five numbers"),
        (OutputLimits, {"stiffness": (1.1,) * 5}, "stiffness.1. = 1.1; expected a number from 0 to 1"),
        (OutputLimits, {"stiffness": (float("nan"),) * 5}, "stiffness.1. = nan"),
        (OutputLimits, {"stiffness_rise": 0.0}, "stiffness_rise = 0.0; .* above 0"),
        (OutputLimits, {"bend_speed": float("inf")}, "bend_speed = inf; .* above 0"),
        (OutputLimits, {"ramp": -1.0}, "ramp = -1.0; .* from 0 on"),
        (SafetyLimits, {"stale": 0.0}, "stale = 0.0; .* above 0"),
        (SafetyLimits, {"overruns": 0}, "overruns = 0; .* from 1"),
        (SafetyLimits, {"after_stall": "pray"}, "after_stall: unknown after_stall 'pray': known: ease, hold, release"),
    ],
)
def test_limits_that_are_none_are_refused(kind: type, wrong: dict[str, object], word: str) -> None:
    with pytest.raises(InputError, match=word):
        kind(**wrong)

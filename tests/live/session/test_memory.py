"""The memory and the setup of a live session, as other processes see them."""

import pytest

from hhsim.errors import HhsimError, InputError
from hhsim.live.session.memory import FACT_BYTES, SessionMemory
from hhsim.live.session.setup import OutputLimits, SafetyLimits


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

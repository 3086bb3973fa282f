"""The target of the kernels: the named one if the processor can run it, or its own where that is asked for."""

import pytest
from llvmlite import binding

from hhsim.kernels import target
from hhsim.kernels.target import CHOICE, NATIVE, TargetWarning, chosen_target, named_target

V3 = "x86-64-v3"


@pytest.fixture(autouse=True)
def unset(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.machine", lambda: "x86_64")
    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: dict.fromkeys(target.NEEDED[V3], True))


def test_the_named_target_is_taken_where_the_processor_can_run_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CHOICE, raising=False)
    assert chosen_target() == named_target() == V3
    monkeypatch.setenv(CHOICE, "x86-64-v9")
    with pytest.warns(TargetWarning, match="x86-64-v9.*expected nothing or native"):
        assert chosen_target() == V3


def test_the_environment_decides_before_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CHOICE, NATIVE)
    assert chosen_target() == NATIVE


def test_an_older_processor_compiles_for_what_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CHOICE, raising=False)
    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: {"avx2": True, "fma": False})
    assert chosen_target() == NATIVE
    assert named_target() is None

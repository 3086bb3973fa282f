"""The target of the kernels: the fastest named one that the processor and the wheel have, or what is asked for."""

import os
from pathlib import Path

import numba
import pytest

from hhsim.kernels import target
from hhsim.kernels.target import NAMED, NATIVE, TargetWarning, chosen_target, is_named, known_targets

V4, V3 = "x86-64-v4", "x86-64-v3"


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A processor that runs both targets, and the folder of a wheel without kernels."""
    monkeypatch.delenv(NAMED, raising=False)
    monkeypatch.setattr(target, "known_targets", lambda: (V4, V3))
    monkeypatch.setattr(target, "COMPILED", tmp_path)
    return tmp_path


def test_the_kernels_of_this_process_are_for_what_this_processor_runs() -> None:
    if NAMED in os.environ:
        pytest.skip(f"{NAMED} is set")
    assert is_named() == bool(known_targets())
    assert numba.config.CPU_NAME in target.TARGET


def test_a_checkout_takes_the_target_that_compiles_soonest(both: Path) -> None:
    assert chosen_target() == V3


def test_of_a_wheel_the_fastest_target_is_taken(both: Path) -> None:
    lines = [f"x86_64 0.68.1 {name}  0 3 1 0\n" for name in (V3, V4)]
    (both / target.BUILT_FOR).write_text("".join(lines))
    assert chosen_target() == V4
    (both / target.BUILT_FOR).write_text(lines[0])
    assert chosen_target() == V3
    (both / target.BUILT_FOR).write_text("aarch64 0.68.1 generic  0 3 1 0\n")
    assert chosen_target() == V3


@pytest.mark.parametrize("name", [V3, V4, NATIVE])
def test_the_environment_decides_before_all(both: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setenv(NAMED, name)
    assert chosen_target() == name


def test_an_unknown_or_too_new_target_is_told_and_not_used(both: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(target, "known_targets", lambda: (V3,))
    monkeypatch.setenv(NAMED, V4)
    with pytest.warns(TargetWarning, match=V3):
        assert chosen_target() == V3


def test_an_older_processor_compiles_for_what_it_has(both: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(target, "known_targets", lambda: ())
    assert chosen_target() == NATIVE

"""The ablation of the tick: every safeguard exists, and one of another time is refused."""

import sys

import pytest

from hhsim.kernels.kernel_cache import kernel_closure
from tools.ablation import SAFEGUARDS, Safeguard, switch_off


@pytest.mark.parametrize("safeguard", SAFEGUARDS, ids=lambda safeguard: safeguard.name)
def test_what_is_switched_off_is_there(safeguard: Safeguard) -> None:
    kernels = [module for name, module in sys.modules.items() if name.startswith("hhsim.kernels.")]
    for name in safeguard.changes:
        assert any(name.partition(":")[0] in vars(module) for module in kernels), name


def test_a_safeguard_of_another_time_is_refused() -> None:
    with pytest.raises(SystemExit, match="no kernel has the name GONE"):
        switch_off([Safeguard("gone", "what was", {"GONE": 1})])


def test_a_kernel_depends_on_what_it_imports_and_on_what_implements_its_generics() -> None:
    closure = kernel_closure("hhsim.kernels.tick.tick")
    assert {"hhsim.kernels.qp.active_set", "hhsim.kernels.tick.progressive"} <= closure
    assert "hhsim.kernels.live.plausibility" not in closure

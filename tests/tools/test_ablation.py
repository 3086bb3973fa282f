"""The ablation of the tick: every safeguard exists, and the table tells what changes without it."""

import sys

import pytest

from hhsim.kernels.kernel_cache import kernel_closure
from tools.ablation import SAFEGUARDS, Safeguard, switch_off, table


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


def test_the_table_has_a_row_for_each_suite_that_changes() -> None:
    run = {"digest": "a", "depth": 0.0, "stuck": 0, "lagging": 2, "lag": 1e-3, "energy": 2.0, "force_step": 1.0}
    work = {"units_mean": 10.0, "units_p50": 8.0, "units_p99": 20.0}
    base = {
        "scene cube grasp coupled mesh": {**run, **work},
        "hard swipe coupled mesh": {"digest": "b", "passed": True},
    }
    without = {
        "scene cube grasp coupled mesh": {**run, **work, "digest": "c", "units_p99": 30.0, "energy": 4.0},
        "hard swipe coupled mesh": {"digest": "b", "passed": True},
    }
    rows = [line for line in table({"base": base, "damping": without}).splitlines() if line.startswith("| damping")]
    assert len(rows) == 1
    cells = [cell.strip() for cell in rows[0].split("|")]
    assert cells[2:4] == ["scene", "1 of 1"]
    assert cells[9] == "2.000" and cells[-2] == "1.50"

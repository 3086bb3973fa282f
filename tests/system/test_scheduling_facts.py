"""What the system is set to, read from planted files: each fact alone, and a system that tells nothing."""

import gzip
import os
import platform
import resource
from pathlib import Path

import pytest

from hhsim.system.scheduling_facts import NOT_TOLD, SchedulingFact, scheduling_facts

CPU = "sys__devices__system__cpu__"


def planted(root: Path, **files: str) -> dict[str, SchedulingFact]:
    for name, text in files.items():
        path = root / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return {fact.name: fact for fact in scheduling_facts(51, root)}


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 3})
    monkeypatch.setattr(platform, "version", lambda: "#1 SMP PREEMPT_DYNAMIC")
    return tmp_path


def test_a_system_that_tells_nothing_is_told_of(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda which: (0, 0))
    facts = planted(root)
    silent = ("processors set aside", "NUMA nodes", "frequency governor", "container's quota", "virtual machine")
    assert {facts[name].value for name in silent} == {NOT_TOLD}
    assert not any(facts[name].advice for name in silent)
    assert "rtprio 99" in facts["limit rtprio"].advice
    assert "memlock unlimited" in facts["limit memlock"].advice


@pytest.mark.parametrize(
    ("file", "text", "name", "value", "advised"),
    [
        ("sys__kernel__realtime", "1\n", "kernel", f"{platform.release()}, PREEMPT_RT", ""),
        ("sys__kernel__realtime", "0\n", "kernel", f"{platform.release()}, no PREEMPT_RT", "PREEMPT_RT"),
        ("proc__cmdline", "a preempt=none b\n", "kernel interrupts its own work", "none (preempt=)", "preempt=full"),
        ("sys__kernel__realtime", "1\n", "kernel interrupts its own work", "always (PREEMPT_RT)", ""),
        (f"{CPU}isolated", "\n", "processors set aside", "none", "isolcpus=3"),
        (f"{CPU}isolated", "3\n", "processors set aside", "3", ""),
        (f"{CPU}cpu3__cpufreq__scaling_governor", "powersave\n", "frequency governor", "powersave", "performance"),
        ("sys__devices__system__node__online", "0-1\n", "NUMA nodes", "0-1", ""),
        ("sys__fs__cgroup__cpu.max", "50000 100000\n", "container's quota", "50 ms in 100 ms", "cpu.max"),
        ("proc__cpuinfo", "flags\t\t: fpu hypervisor lahf\n", "virtual machine", "yes", "the host"),
        ("proc__self__status", "CapEff:\t0000000000804000\n", "limit rtprio", "any, by CAP_SYS_NICE", ""),
    ],
)
def test_a_fact_is_told_with_what_would_be_better(
    root: Path, file: str, text: str, name: str, value: str, advised: str
) -> None:
    fact = planted(root, **{file: text})[name]
    assert fact.value == value
    assert (advised in fact.advice) if advised else fact.advice == ""


@pytest.mark.parametrize(
    ("built", "value", "advised"),
    [
        ("CONFIG_PREEMPT_NONE=y\n# CONFIG_PREEMPT is not set\nCONFIG_PREEMPT_DYNAMIC=y\n", "none (preempt=)", True),
        ("CONFIG_PREEMPT_VOLUNTARY=y\n", "voluntary (preempt=)", True),
        ("CONFIG_PREEMPT_BUILD=y\nCONFIG_PREEMPT_LAZY=y\n", "lazy (preempt=)", False),
        ("# CONFIG_PREEMPT_NONE is not set\nCONFIG_PREEMPT=y\n", "full (preempt=)", False),
        ("CONFIG_HZ=250\n", NOT_TOLD, False),
    ],
)
def test_what_the_kernel_was_built_with(root: Path, built: str, value: str, advised: bool) -> None:
    name = f"boot__config-{platform.release()}"
    assert planted(root, **{name: built})["kernel interrupts its own work"].value == value
    (root / "proc").mkdir()
    (root / "proc/config.gz").write_bytes(gzip.compress(built.encode()))
    fact = planted(root, **{name: "CONFIG_PREEMPT_NONE=y\n"})["kernel interrupts its own work"]
    assert (fact.value, bool(fact.advice)) == (value, advised)
    assert planted(root, proc__cmdline="preempt=full\n")["kernel interrupts its own work"].value == "full (preempt=)"


def test_a_damaged_configuration_tells_nothing(root: Path) -> None:
    (root / "proc").mkdir()
    for packed in (b"", b"no gzip", gzip.compress(b"CONFIG_PREEMPT=y\n")[:12], gzip.compress(b"\xff\xfe")):
        (root / "proc/config.gz").write_bytes(packed)
        assert planted(root)["kernel interrupts its own work"].value == NOT_TOLD


def test_the_limit_must_reach_the_priority(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for limit, enough in ((50, False), (51, True), (resource.RLIM_INFINITY, True)):
        monkeypatch.setattr(resource, "getrlimit", lambda which, limit=limit: (limit, limit))
        assert (planted(root)["limit rtprio"].advice == "") == enough


@pytest.mark.parametrize(
    ("runtime", "value", "advised"), [(-1, "all of it", 0), (950_000, "95 %", 0), (1_000, "0.1 %", 1)]
)
def test_the_share_of_real_time(root: Path, runtime: int, value: str, advised: int) -> None:
    folder = "proc__sys__kernel__sched_rt_"
    facts = planted(root, **{f"{folder}runtime_us": f"{runtime}\n", f"{folder}period_us": "1000000\n"})
    fact = facts["real-time share of a second"]
    assert (fact.value, bool(fact.advice)) == (value, bool(advised))


def test_a_single_processor_is_shared_with_everything(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {2})
    assert "give it two" in planted(root)["processors that may be used"].advice

"""System settings that decide how punctually it wakes a thread, with advice; not measured, and no verdict alone."""

import gzip
import math
import os
import platform
import re
import resource
from dataclasses import dataclass
from pathlib import Path

NOT_TOLD = "not told"
"""Value of a setting that the system does not report."""
CAP_IPC_LOCK, CAP_SYS_NICE = 14, 23
"""Bits of the capabilities that override the limits (capabilities(7))."""
LIMITS_FILE = "in /etc/security/limits.d/90-hhsim.conf, then log in anew"
PREEMPTION = {"PREEMPT_NONE": "none", "PREEMPT_VOLUNTARY": "voluntary", "PREEMPT_LAZY": "lazy", "PREEMPT": "full"}
"""Options of the kernel's configuration, and their names in `preempt=`."""


@dataclass(frozen=True)
class SchedulingFact:
    """One setting; `advice` is "" if nothing should be changed."""

    name: str
    value: str
    advice: str = ""


def scheduling_facts(priority: int, root: Path = Path("/")) -> list[SchedulingFact]:
    """Return settings of kernel, processors, governor, limits, host and container.

    `priority` is the highest under SCHED_FIFO that the loop asks for, `root` the folder of /proc and /sys.
    """

    def text(name: str) -> str:
        return _text(root / name)

    allowed, cpus = sorted(os.sched_getaffinity(0)), "sys/devices/system/cpu"
    is_real_time = text("sys/kernel/realtime") == "1" or "PREEMPT_RT" in platform.version()
    real_time = "" if is_real_time else "a kernel with PREEMPT_RT (in Linux since 6.12) has shorter worst cases"
    shared = "with one processor the loop shares it with everything else: give it two" if len(allowed) == 1 else ""
    isolated = text(f"{cpus}/isolated")
    set_aside = f"isolcpus={allowed[-1]} on the kernel's command line, and --cpu {allowed[-1]}"
    governors = sorted({text(f"{cpus}/cpu{number}/cpufreq/scaling_governor") for number in allowed} - {NOT_TOLD})
    slow = "cpupower frequency-set -g performance: a clock that has to be raised first wakes late"
    flags = text("proc/cpuinfo")
    is_virtual = re.search(r"^flags\s*:.*\bhypervisor\b", flags, re.MULTILINE) is not None
    host = "a machine of one's own: no setting in here keeps the host from taking the processor"
    found = re.search(r"^CapEff:\s*([0-9a-f]+)$", text("proc/self/status"), re.MULTILINE)
    capabilities = int(found[1], 16) if found else 0
    lock, nice = capabilities >> CAP_IPC_LOCK & 1, capabilities >> CAP_SYS_NICE & 1
    return [
        SchedulingFact("kernel", f"{platform.release()}, {'' if is_real_time else 'no '}PREEMPT_RT", real_time),
        _preemption(root, is_real_time=is_real_time),
        SchedulingFact("processors that may be used", ", ".join(map(str, allowed)), shared),
        SchedulingFact("processors set aside", isolated or "none", "" if isolated or shared else set_aside),
        SchedulingFact("NUMA nodes", text("sys/devices/system/node/online")),
        SchedulingFact(
            "frequency governor", ", ".join(governors) or NOT_TOLD, slow if set(governors) - {"performance"} else ""
        ),
        _limit("rtprio", resource.RLIMIT_RTPRIO, "CAP_SYS_NICE" if nice else "", priority, "rtprio 99"),
        _limit("memlock", resource.RLIMIT_MEMLOCK, "CAP_IPC_LOCK" if lock else "", math.inf, "memlock unlimited"),
        _throttle(*(text(f"proc/sys/kernel/sched_rt_{what}_us") for what in ("runtime", "period"))),
        _quota(text("sys/fs/cgroup/cpu.max")),
        SchedulingFact(
            "virtual machine",
            NOT_TOLD if flags == NOT_TOLD else "yes" if is_virtual else "no",
            host if is_virtual else "",
        ),
    ]


def _preemption(root: Path, *, is_real_time: bool) -> SchedulingFact:
    """Return whether a ready thread interrupts the kernel's own work; the command line overrides the configuration."""
    name = "kernel interrupts its own work"
    asked = re.findall(r"(?:^|\s)preempt=(\w+)", _text(root / "proc/cmdline"))
    built = re.search(rf"^CONFIG_({'|'.join(PREEMPTION)})=y$", _configuration(root), re.MULTILINE)
    if is_real_time:
        return SchedulingFact(name, "always (PREEMPT_RT)")
    if not asked and built is None:
        return SchedulingFact(name, NOT_TOLD)
    value = asked[-1] if asked else PREEMPTION[built[1]] if built else NOT_TOLD
    late = value in ("none", "voluntary")
    advice = (
        "preempt=full on the kernel's command line: else a thread that is due waits until a kernel thread on its "
        "processor, such as one that reclaims memory, pauses by itself"
    )
    return SchedulingFact(name, f"{value} (preempt=)", advice if late else "")


def _configuration(root: Path) -> str:
    """Return the configuration of the kernel; "" if it is not reported."""
    packed, plain = root / "proc/config.gz", root / f"boot/config-{platform.release()}"
    try:
        return gzip.decompress(packed.read_bytes()).decode() if packed.exists() else plain.read_text(encoding="utf-8")
    except (OSError, EOFError, UnicodeDecodeError):
        return ""


def _limit(name: str, which: int, above: str, wanted: float, remedy: str) -> SchedulingFact:
    """Return a limit of the process, which a capability, `above`, overrides."""
    limit = resource.getrlimit(which)[0]
    amount = math.inf if limit == resource.RLIM_INFINITY else limit
    divisor, unit = (1, "") if which == resource.RLIMIT_RTPRIO else (1024, " kB")
    shown = "unlimited" if amount == math.inf else f"{limit // divisor:,}{unit}"
    user = os.environ.get("USER") or str(os.getuid())
    advice = "" if above or amount >= wanted else f"'{user} - {remedy}' {LIMITS_FILE}"
    return SchedulingFact(f"limit {name}", f"any, by {above}" if above else shown, advice)


def _throttle(runtime: str, period: str) -> SchedulingFact:
    """Return the share of time that real-time threads may take together."""
    name = "real-time share of a second"
    try:
        share = 100.0 * int(runtime) / int(period)
    except (ValueError, ZeroDivisionError):
        return SchedulingFact(name, NOT_TOLD)
    if share < 0.0:
        return SchedulingFact(name, "all of it")
    return SchedulingFact(name, f"{share:g} %", "sysctl kernel.sched_rt_runtime_us=950000" if share < 50.0 else "")


def _quota(text: str) -> SchedulingFact:
    """Return the CPU time of all threads of a container."""
    found = re.fullmatch(r"(\d+) (\d+)", text)
    if found is None:
        return SchedulingFact("container's quota", "none" if text.startswith("max") else NOT_TOLD)
    advice = "no quota of CPU time (cpu.max): where it is used up, everything stops until the next period"
    quota, period = (1e-3 * int(part) for part in found.groups())
    return SchedulingFact("container's quota", f"{quota:g} ms in {period:g} ms", advice)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return NOT_TOLD

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
    found = re.search(r"^CapEff:\s*([0-9a-f]+)$", _text(root / "proc/self/status"), re.MULTILINE)
    capabilities = int(found[1], 16) if found else 0
    lock, nice = capabilities >> CAP_IPC_LOCK & 1, capabilities >> CAP_SYS_NICE & 1
    allowed = sorted(os.sched_getaffinity(0))
    alone = "with one processor the loop shares it with everything else: give it two"
    return [
        _kernel(root),
        _preemption(root),
        SchedulingFact("processors that may be used", ", ".join(map(str, allowed)), alone if len(allowed) == 1 else ""),
        _isolated(root, allowed),
        SchedulingFact("NUMA nodes", _text(root / "sys/devices/system/node/online")),
        _governor(root, allowed),
        _limit("rtprio", resource.RLIMIT_RTPRIO, "CAP_SYS_NICE" if nice else "", priority, "rtprio 99"),
        _limit("memlock", resource.RLIMIT_MEMLOCK, "CAP_IPC_LOCK" if lock else "", math.inf, "memlock unlimited"),
        _throttle(root),
        _quota(root),
        _virtual(root),
    ]


def _kernel(root: Path) -> SchedulingFact:
    if _has_real_time(root):
        return SchedulingFact("kernel", f"{platform.release()}, PREEMPT_RT")
    advice = "a kernel with PREEMPT_RT (in Linux since 6.12) has shorter worst cases"
    return SchedulingFact("kernel", f"{platform.release()}, no PREEMPT_RT", advice)


def _has_real_time(root: Path) -> bool:
    return _text(root / "sys/kernel/realtime") == "1" or "PREEMPT_RT" in platform.version()


def _preemption(root: Path) -> SchedulingFact:
    """Return whether a ready thread interrupts the kernel's own work; the command line overrides the configuration."""
    name = "kernel interrupts its own work"
    asked = re.findall(r"(?:^|\s)preempt=(\w+)", _text(root / "proc/cmdline"))
    built = re.search(rf"^CONFIG_({'|'.join(PREEMPTION)})=y$", _configuration(root), re.MULTILINE)
    if _has_real_time(root):
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


def _isolated(root: Path, allowed: list[int]) -> SchedulingFact:
    value = _text(root / "sys/devices/system/cpu/isolated")
    if value == NOT_TOLD:
        return SchedulingFact("processors set aside", value)
    advice = "" if value else f"isolcpus={allowed[-1]} on the kernel's command line, and --cpu {allowed[-1]}"
    return SchedulingFact("processors set aside", value or "none", advice if len(allowed) > 1 else "")


def _governor(root: Path, allowed: list[int]) -> SchedulingFact:
    files = [root / f"sys/devices/system/cpu/cpu{number}/cpufreq/scaling_governor" for number in allowed]
    found = sorted({_text(file) for file in files} - {NOT_TOLD})
    slow = bool(set(found) - {"performance"})
    advice = "cpupower frequency-set -g performance: a clock that has to be raised first wakes late" if slow else ""
    return SchedulingFact("frequency governor", ", ".join(found) or NOT_TOLD, advice)


def _limit(name: str, which: int, above: str, wanted: float, remedy: str) -> SchedulingFact:
    """Return a limit of the process, which a capability, `above`, overrides."""
    limit = resource.getrlimit(which)[0]
    amount = math.inf if limit == resource.RLIM_INFINITY else limit
    divisor, unit = (1, "") if which == resource.RLIMIT_RTPRIO else (1024, " kB")
    shown = "unlimited" if amount == math.inf else f"{limit // divisor:,}{unit}"
    user = os.environ.get("USER") or str(os.getuid())
    advice = "" if above or amount >= wanted else f"'{user} - {remedy}' {LIMITS_FILE}"
    return SchedulingFact(f"limit {name}", f"any, by {above}" if above else shown, advice)


def _throttle(root: Path) -> SchedulingFact:
    """Return the share of time that real-time threads may take together."""
    name = "real-time share of a second"
    try:
        used, period = (int(_text(root / f"proc/sys/kernel/sched_rt_{what}_us")) for what in ("runtime", "period"))
        share = 100.0 * used / period
    except (ValueError, ZeroDivisionError):
        return SchedulingFact(name, NOT_TOLD)
    if used < 0:
        return SchedulingFact(name, "all of it")
    advice = "sysctl kernel.sched_rt_runtime_us=950000" if share < 50.0 else ""
    return SchedulingFact(name, f"{share:g} %", advice)


def _quota(root: Path) -> SchedulingFact:
    """Return the CPU time of all threads of a container."""
    text = _text(root / "sys/fs/cgroup/cpu.max")
    found = re.fullmatch(r"(\d+) (\d+)", text)
    if found is None:
        return SchedulingFact("container's quota", "none" if text.startswith("max") else NOT_TOLD)
    quota, period = int(found[1]), int(found[2])
    advice = "no quota of CPU time (cpu.max): where it is used up, everything stops until the next period"
    return SchedulingFact("container's quota", f"{1e-3 * quota:g} ms in {1e-3 * period:g} ms", advice)


def _virtual(root: Path) -> SchedulingFact:
    flags = _text(root / "proc/cpuinfo")
    if flags == NOT_TOLD:
        return SchedulingFact("virtual machine", NOT_TOLD)
    virtual = re.search(r"^flags\s*:.*\bhypervisor\b", flags, re.MULTILINE) is not None
    advice = "a machine of one's own: no setting in here keeps the host from taking the processor" if virtual else ""
    return SchedulingFact("virtual machine", "yes" if virtual else "no", advice)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return NOT_TOLD

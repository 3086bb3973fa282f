"""Environment of hhsim: versions, machine, clock, compiled kernels, source revision.

Every result states it, and `hhsim info` prints it. Nothing here names the user or the host.
"""

import importlib.metadata
import itertools
import json
import os
import platform
import re
import subprocess
import time
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from hhsim import __version__

UNKNOWN = "unknown"
DEVELOPMENT_EXTRAS = frozenset({"test", "lint"})


@dataclass(frozen=True)
class Machine:
    """Properties of the computer that decide how fast a tick is; `cores` are those that this process may use."""

    cpu: str
    cores: int
    system: str
    python: str


@dataclass(frozen=True)
class Clock:
    """Clock that times a tick.

    Attributes:
        resolution: Resolution that the system states [s].
        step: Smallest measured step between two readings [s].
        source: Clock source of the kernel, such as tsc or kvm-clock.
    """

    function: str
    resolution: float
    step: float
    source: str


@dataclass(frozen=True)
class Kernels:
    """Folder of the compiled kernels, and whether those of exactly these sources are there already."""

    folder: str
    compiled: bool
    jit: bool


@dataclass(frozen=True)
class Revision:
    """Checkout that hhsim runs from; both fields are "unknown" for an installed package."""

    commit: str
    dirty: bool | str


@dataclass(frozen=True)
class Info:
    """Everything that `hhsim info` prints; `missing` are optional packages, by the extra that brings them."""

    hhsim: str
    revision: Revision
    machine: Machine
    clock: Clock
    kernels: Kernels
    packages: dict[str, str]
    missing: dict[str, list[str]]

    def to_json(self) -> dict[str, Any]:
        """Return it as plain dictionaries."""
        return asdict(self)


def collect() -> Info:
    """Describe this process and the machine."""
    missing = _missing_packages()
    return Info(__version__, revision(), machine(), _clock(), _kernels(), package_versions(), missing)


def file_attributes() -> dict[str, str | bool]:
    """Return version, revision, time, machine and packages (as JSON), for every file of figures."""
    source = revision()
    return {
        "hhsim_version": __version__,
        "git_revision": source.commit,
        "git_dirty": source.dirty,
        "created_utc": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}",
        "machine": json.dumps(asdict(machine())),
        "packages": json.dumps(package_versions()),
    }


def machine() -> Machine:
    """Describe the computer without naming it."""
    # Of the process: one of its threads may be kept on a core of its own (`hhsim.system.own_core`).
    cores = len(os.sched_getaffinity(os.getpid())) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    system = f"{platform.system()} {platform.release()} {platform.machine()}"
    return Machine(_cpu_name(), cores, system, platform.python_version())


def package_versions() -> dict[str, str]:
    """Return the versions of the installed packages that hhsim depends on, by name."""
    installed = {name: _version(name) for name, _ in _requirements()}
    return {name: version for name, version in installed.items() if version is not None}


def revision() -> Revision:
    """Return the commit of the checkout of this module, and whether its files are modified."""
    root = Path(__file__).resolve().parents[2]
    if not ((root / ".git").exists() and (root / "pyproject.toml").is_file()):
        return Revision(UNKNOWN, UNKNOWN)
    # Asked again for every file: what is imported from now on is that of the checkout as it is now.
    command = ["git", "-C", str(root), "status", "--porcelain=v2", "--branch", "--untracked-files=no"]
    given = os.environ | {"GIT_OPTIONAL_LOCKS": "0", "LC_ALL": "C"}
    try:
        status = subprocess.run(
            command, capture_output=True, text=True, timeout=10, check=True, env=given, stdin=subprocess.DEVNULL
        ).stdout
    except (OSError, subprocess.SubprocessError):
        return Revision(UNKNOWN, UNKNOWN)
    commit = re.search(r"^# branch\.oid ([0-9a-f]+)$", status, re.MULTILINE)
    if commit is None:
        return Revision(UNKNOWN, UNKNOWN)
    return Revision(commit.group(1), any(not line.startswith("#") for line in status.strip().splitlines()))


def _cpu_name() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        text = ""
    found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return found.group(1).strip() if found else platform.processor() or platform.machine() or UNKNOWN


def _clock() -> Clock:
    stated = time.get_clock_info("perf_counter")
    readings = [time.perf_counter_ns() for _ in range(2_000)]
    steps = [later - earlier for earlier, later in itertools.pairwise(readings) if later > earlier]
    try:
        source = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource").read_text().strip()
    except OSError:
        source = UNKNOWN
    step = min(steps, default=0) * 1e-9 or stated.resolution
    return Clock(stated.implementation, stated.resolution, step, source)


def _kernels() -> Kernels:
    from hhsim.kernels.jit import JIT_ENABLED
    from hhsim.kernels.kernel_cache import KERNEL_CACHE, is_cached

    return Kernels(folder=str(KERNEL_CACHE), compiled=is_cached(), jit=JIT_ENABLED)


def _requirements() -> list[tuple[str, str]]:
    """Return the name of each declared dependency for users, with its extra ("" for none)."""
    try:
        declared = importlib.metadata.requires("hhsim") or []
    except importlib.metadata.PackageNotFoundError:
        return []
    rows = []
    for requirement in declared:
        name = re.match(r"[\w.-]+", requirement)
        extra = re.search(r"extra == ['\"]([\w-]+)['\"]", requirement)
        group = extra.group(1) if extra else ""
        if name and group not in DEVELOPMENT_EXTRAS:
            rows.append((name.group(), group))
    return rows


@cache
def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _missing_packages() -> dict[str, list[str]]:
    missing: dict[str, list[str]] = {}
    for name, extra in _requirements():
        if _version(name) is None:
            missing.setdefault(extra or "required", []).append(name)
    return missing

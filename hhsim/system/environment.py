"""What hhsim runs on and from: versions, machine, clock, compiled kernels, source revision.

Every result carries it, and `hhsim info` prints it. Nothing here names the user or the host.
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
    """The computer, as far as it decides how fast a tick is."""

    cpu: str
    cores: int
    """Cores that this process may use."""
    system: str
    python: str


@dataclass(frozen=True)
class Clock:
    """The clock that times a tick."""

    function: str
    resolution: float
    """What the system states [s]."""
    step: float
    """Smallest step between two readings that was seen just now [s]."""
    source: str
    """The kernel's clock source, such as tsc or kvm-clock."""


@dataclass(frozen=True)
class Kernels:
    """Where compiled kernels are kept."""

    folder: str
    compiled: bool
    """Whether the kernels of exactly these sources lie there already; if not, the first run compiles them."""
    jit: bool


@dataclass(frozen=True)
class Revision:
    """The checkout that hhsim runs from; both fields are "unknown" for an installed package."""

    commit: str
    dirty: bool | str


@dataclass(frozen=True)
class Info:
    """Everything that `hhsim info` prints."""

    hhsim: str
    revision: Revision
    machine: Machine
    clock: Clock
    kernels: Kernels
    packages: dict[str, str]
    missing: dict[str, list[str]]
    """Optional packages that are not installed, by the extra that brings them."""

    def to_json(self) -> dict[str, Any]:
        """The same as plain dictionaries, for `json.dumps`."""
        return asdict(self)


def collect() -> Info:
    """Look at this process and the machine under it."""
    return Info(
        hhsim=__version__,
        revision=revision(),
        machine=machine(),
        clock=_clock(),
        kernels=_kernels(),
        packages=package_versions(),
        missing=_missing_packages(),
    )


def file_attributes() -> dict[str, str | bool]:
    """What every file of figures says of its origin: version, revision, time, machine and packages (as JSON)."""
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
    return Machine(
        cpu=_cpu_name(),
        cores=cores,
        system=f"{platform.system()} {platform.release()} {platform.machine()}",
        python=platform.python_version(),
    )


def package_versions() -> dict[str, str]:
    """Versions of the packages that hhsim depends on, by name; without the optional ones that are missing."""
    versions = {}
    for name, _ in _requirements():
        version = _version(name)
        if version is not None:
            versions[name] = version
    return versions


def revision() -> Revision:
    """Commit of the checkout that this module lies in, and whether files in it have changed since."""
    root = Path(__file__).resolve().parents[2]
    if not ((root / ".git").exists() and (root / "pyproject.toml").is_file()):
        return Revision(UNKNOWN, UNKNOWN)
    # Asked again for every file: what is imported from now on is that of the checkout as it is now.
    status = _git(root, "status", "--porcelain=v2", "--branch", "--untracked-files=no")
    commit = re.search(r"^# branch\.oid ([0-9a-f]+)$", status or "", re.MULTILINE)
    if status is None or commit is None:
        return Revision(UNKNOWN, UNKNOWN)
    return Revision(commit.group(1), any(not line.startswith("#") for line in status.splitlines()))


def _git(root: Path, *arguments: str) -> str | None:
    environment = os.environ | {"GIT_OPTIONAL_LOCKS": "0", "LC_ALL": "C"}
    try:
        answer = subprocess.run(
            ["git", "-C", str(root), *arguments],
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
            env=environment,
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip()


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
    return Clock(
        function=stated.implementation,
        resolution=stated.resolution,
        step=min(steps, default=0) * 1e-9 or stated.resolution,
        source=source,
    )


def _kernels() -> Kernels:
    from hhsim.kernels.jit import JIT_ENABLED
    from hhsim.kernels.kernel_cache import KERNEL_CACHE, is_cached

    return Kernels(folder=str(KERNEL_CACHE), compiled=is_cached(), jit=JIT_ENABLED)


def _requirements() -> list[tuple[str, str]]:
    """Name of each declared dependency that a run can use, with the extra that it belongs to ("" for none)."""
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

"""Environment of hhsim: versions, machine, compiled kernels, source revision.

Every result states it, and `hhsim info` prints it. Nothing here names the user or the host.
"""

import importlib.metadata
import json
import os
import platform
import re
import subprocess
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from hhsim import __version__
from hhsim.system.posix import own_processors

UNKNOWN = "unknown"
DEVELOPMENT_EXTRAS = frozenset({"test", "lint", "release"})


def collect() -> dict[str, Any]:
    """Describe this process and the machine, as `hhsim info` prints it.

    `kernels` has the folder of the compiled ones, and whether those of exactly these sources are there; `missing` are
    packages by their extra.
    """
    from hhsim.kernels.kernel_cache import KERNEL_CACHE, is_cached

    missing: dict[str, list[str]] = {}
    for name, extra in _requirements():
        if package_version(name) is None:
            missing.setdefault(extra or "required", []).append(name)
    return {
        "hhsim": __version__,
        "revision": revision(),
        "machine": machine(),
        "kernels": {"folder": str(KERNEL_CACHE), "compiled": is_cached()},
        "packages": package_versions(),
        "missing": missing,
    }


def file_attributes() -> dict[str, str | bool]:
    """Return version, revision, time, machine and packages (as JSON), for every file of figures."""
    source = revision()
    return {
        "hhsim_version": __version__,
        "git_revision": source["commit"],
        "git_dirty": source["dirty"],
        "created_utc": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}",
        "machine": json.dumps(machine()),
        "packages": json.dumps(package_versions()),
    }


def machine() -> dict[str, str | int]:
    """Describe what decides how fast a tick is, without naming the computer; `cores` are those of this process."""
    # Affinity of the process: a thread may be pinned to one core (`hhsim.system.thread_pool`).
    cores = len(own_processors())
    system = f"{platform.system()} {platform.release()} {platform.machine()}"
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        text = ""
    found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    cpu = found[1].strip() if found else platform.processor() or platform.machine() or UNKNOWN
    return {"cpu": cpu, "cores": cores, "system": system, "python": platform.python_version()}


def package_versions() -> dict[str, str]:
    """Return the versions of the installed packages that hhsim depends on, by name."""
    installed = {name: package_version(name) for name, _ in _requirements()}
    return {name: version for name, version in installed.items() if version is not None}


def revision() -> dict[str, Any]:
    """Return the commit of the checkout of this module, and whether it is dirty; "unknown" for an installed package."""
    unknown = {"commit": UNKNOWN, "dirty": UNKNOWN}
    root = Path(__file__).resolve().parents[2]
    if not ((root / ".git").exists() and (root / "pyproject.toml").is_file()):
        return unknown
    # Asked again for every file: what is imported from now on is that of the checkout as it is now.
    command = ["git", "-C", str(root), "status", "--porcelain=v2", "--branch", "--untracked-files=no"]
    given = os.environ | {"GIT_OPTIONAL_LOCKS": "0", "LC_ALL": "C"}
    try:
        status = subprocess.run(
            command, capture_output=True, text=True, timeout=10, check=True, env=given, stdin=subprocess.DEVNULL
        ).stdout
    except (OSError, subprocess.SubprocessError):
        return unknown
    commit = re.search(r"^# branch\.oid ([0-9a-f]+)$", status, re.MULTILINE)
    if commit is None:
        return unknown
    dirty = any(not line.startswith("#") for line in status.strip().splitlines())
    return {"commit": commit.group(1), "dirty": dirty}


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
def package_version(package: str) -> str | None:
    """Return the installed version of a package; None for one that is not installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None

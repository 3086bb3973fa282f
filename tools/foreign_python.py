"""Set up a Python of another kind of machine, or with another C library, in a folder, without root or a container.

    python -m tools.foreign_python aarch64 FOLDER          # under qemu-aarch64-static, with hhsim and its dependencies
    python -m tools.foreign_python libc FOLDER --release trixie   # this Python, with that Debian release's C library

Packages come from the Debian mirror that apt knows and from the index that pip knows. The program to run is
FOLDER/python; `python -m tools.same_bits --python FOLDER/python` compares its runs with this machine's.
"""

import argparse
import platform
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

from tools.import_graph import REPOSITORY

EMULATOR = "qemu-aarch64-static"
LIBC = ("libc6", "libgcc-s1", "libstdc++6")
PYTHON = (
    *("python3.11-minimal", "libpython3.11-minimal", "libpython3.11-stdlib", "zlib1g", "libexpat1", "libffi8"),
    *("libssl3", "libbz2-1.0", "liblzma5", "libuuid1", "libsqlite3-0", "libcrypt1", "libgomp1"),
)
"""Debian's packages of an interpreter, with what its standard library loads."""
PYTHON_RELEASE = "bookworm"
"""Debian release that has this Python."""
WHEELS = ("manylinux_2_17_aarch64", "manylinux2014_aarch64", "manylinux_2_27_aarch64", "manylinux_2_28_aarch64")
SHOWN_ONLY = ("rerun-sdk", "matplotlib")
"""Dependencies that no replay imports."""
INSTALLED_AS = {"hhsim": "hhsim", "cli": "hhsim/cli", "objects": "hhsim/objects", "trajectories": "hhsim/trajectories"}


def fetch_packages(names: Sequence[str], architecture: str, release: str, folder: Path) -> None:
    """Unpack Debian packages into a folder, by an apt whose lists and settings lie there too."""
    state, lists = folder / "apt", folder / "apt" / "lists" / "partial"
    lists.mkdir(parents=True, exist_ok=True)
    targets = ["apt-get", "indextargets", "--format", "$(REPO_URI)", "Created-By: Packages"]
    mirrors = subprocess.run(targets, check=True, capture_output=True, text=True).stdout.split()
    if not mirrors:
        sys.exit("apt knows no mirror: run apt-get update")
    (state / "sources.list").write_text(f"deb {mirrors[0]} {release} main\n", encoding="utf-8")
    options = {
        "APT::Architecture": architecture,
        "APT::Architectures": architecture,
        "Dir::Etc::SourceList": state / "sources.list",
        "Dir::Etc::SourceParts": "-",
        "Dir::State::Lists": state / "lists",
        "Dir::State::Status": "/dev/null",
        "Dir::Cache": state,
        "APT::Sandbox::User": "root",
    }
    command = ["apt-get", "-qq", *(word for name, value in options.items() for word in ("-o", f"{name}={value}"))]
    subprocess.run([*command, "update"], check=True)
    subprocess.run([*command, "download", *names], check=True, cwd=state)
    for package in sorted(state.glob("*.deb")):
        subprocess.run(["dpkg", "-x", str(package), str(folder / "root")], check=True)


def fetch_dependencies(site: Path) -> None:
    """Install what hhsim needs for aarch64, and these sources, into a folder."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = [line for line in project["dependencies"] if not line.startswith(SHOWN_ONLY)]
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-compile", "--target", str(site)]
    wheels = [word for kind in WHEELS for word in ("--platform", kind)]
    only = ["--only-binary=:all:", "--python-version", "3.11", "-c", str(REPOSITORY / "constraints.txt")]
    subprocess.run([*pip, *wheels, *only, *needed], check=True)
    for source, place in INSTALLED_AS.items():
        shutil.copytree(REPOSITORY / source, site / place, ignore=shutil.ignore_patterns("__pycache__"))


def write_program(path: Path, words: Sequence[str], **environment: str) -> None:
    """Write a program that runs words with its own arguments behind."""
    known = [f"export {name}={shlex.quote(value)}" for name, value in environment.items()]
    path.write_text("\n".join(["#!/bin/sh", *known, f'exec {shlex.join(words)} "$@"', ""]), encoding="utf-8")
    path.chmod(0o755)


def set_up_aarch64(folder: Path) -> None:
    """Make FOLDER/python an aarch64 Python under qemu."""
    emulator = shutil.which(EMULATOR)
    if emulator is None:
        sys.exit(f"{EMULATOR} is not installed: it is part of Debian's qemu-user-static")
    fetch_packages([*LIBC, *PYTHON], "arm64", PYTHON_RELEASE, folder)
    fetch_dependencies(folder / "site")
    root = folder / "root"
    words = [emulator, "-L", str(root), str(root / "usr/bin/python3.11")]
    write_program(folder / "python", words, PYTHONPATH=str(folder / "site"), PYTHONHOME=str(root / "usr"))


def set_up_libc(folder: Path, release: str) -> None:
    """Make FOLDER/python this Python with the C library of another Debian release."""
    machine = platform.machine()
    fetch_packages(LIBC, {"x86_64": "amd64", "aarch64": "arm64"}[machine], release, folder)
    libraries = [path for path in (folder / "root").rglob(f"{machine}-linux-gnu") if (path / "libc.so.6").exists()]
    (loader,) = {path.resolve() for path in (folder / "root").rglob("ld-linux-*.so.*") if path.is_file()}
    places = {str(path) for path in libraries} | {str(folder / "root" / "usr" / "lib" / f"{machine}-linux-gnu")}
    host = f"/lib/{machine}-linux-gnu:/usr/lib/{machine}-linux-gnu"
    search = ":".join([*sorted(places), host])
    write_program(folder / "python", [str(loader), "--library-path", search, sys.executable])


def main() -> None:
    """Set it up, and say what runs there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=["aarch64", "libc"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--release", default="trixie", help="Debian release of the C library")
    words = parser.parse_args()
    folder: Path = words.folder.resolve()
    if folder.exists():
        sys.exit(f"{folder} exists: name a new folder")
    folder.mkdir(parents=True)
    if words.kind == "aarch64":
        set_up_aarch64(folder)
    else:
        set_up_libc(folder, words.release)
    says = "import platform; print(platform.machine(), platform.python_version(), *platform.libc_ver())"
    subprocess.run([str(folder / "python"), "-c", says], check=True)


if __name__ == "__main__":
    main()

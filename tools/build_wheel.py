"""Build a wheel that holds all kernels as machine code, for this Python and the named target of this machine.

    python -m tools.build_wheel [FOLDER]

compiles them into an empty cache, runs the commands of the README by it, and packs what Python calls. FOLDER is dist/
where none is named. The wheel's tag names Python, system and processor.
"""

import argparse
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from hhsim.cli.console import progress  # type: ignore[import-not-found]
from hhsim.kernels.callee import CALLEE_PREFIX
from hhsim.kernels.kernel_cache import SHIPPED
from hhsim.kernels.target import CHOICE, named_target
from hhsim.system.progress import Progress, silent
from tools.import_graph import REPOSITORY

PLATFORM = "manylinux_2_17"
"""Oldest C library whose functions the kernels call, in the words of a wheel's tag: that of numba's own wheels."""
LEFT_OUT = (".git", ".venv", "build", "dist", "*.egg-info", "__pycache__", "results", ".*_cache", ".hypothesis")
MAIN = "import sys; from hhsim.cli.main import main; sys.argv[0] = 'hhsim'; main()"
BUILD = "import sys; from setuptools.build_meta import build_wheel; print(build_wheel(sys.argv[1], eval(sys.argv[2])))"
COMMANDS = (
    "replay bunny grasp --method coupled",
    "replay cube pinch --method progressive --surface mesh",
    "replay cube touch --method paper --level 3",
    "replay cube grasp --method penalty",
    "replay cube lift --free --mass 0.1 --friction 0.6 --self-contact on",
    "replay cube lift --free --surface mesh --mass 0.1 --friction 0.6",
    "replay bunny whole-hand --self-contact on",
    "replay bunny whole-hand --self-contact on --surface mesh",
    "replay cylinder grasp --hands both",
    "replay cube lift-both --hands both --free",
    "replay laptop close",
    "replay laptop close --hands both --surface mesh",
    "replay rock carry --tremor 0.1,0.2",
    "replay examples/mug.stl grasp --unit mm",
    "replay examples/mug.stl whole-hand --unit mm",
)
"""Runs that scenes and measures take kernels for, which no list of ticks has."""
RATE = "--rate 250"
"""Of these runs: a quarter of the ticks goes through the same kernels."""
JUDGED = (0, COMMANDS.index("replay cube lift-both --hands both --free"))
"""Numbers of the runs that are verified and reported, too: the others' checks call no further kernel."""

TWO_GLOVES = "--device left=sim,right=sim"
"""Options of a session with a simulated glove on each hand."""


def compile_all(cache: Path, report: Progress = silent) -> None:
    """Compile every kernel that ships into a cache, and report the commands that are done."""
    known = {name: value for name, value in os.environ.items() if name not in ("NUMBA_BOUNDSCHECK", CHOICE)}
    environment = known | {"HHSIM_CACHE_DIR": str(cache)}

    def run(*arguments: str) -> None:
        subprocess.run([sys.executable, *arguments], cwd=REPOSITORY, env=environment, check=True, capture_output=True)

    def in_turn(*commands: str) -> None:
        for command in commands:
            run("-c", MAIN, *shlex.split(command))

    report("kernels of the tests", 0, 1)
    run("tests/compile_kernels.py")
    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(len(os.sched_getaffinity(0))) as side_by_side:
        chains: list[tuple[str, ...]] = []
        for n, command in enumerate(COMMANDS):
            result = f"{place}/{n}.h5"
            judged = f"verify {result} --every 1000", f"report {result} --out {place}/{n}.html"
            chains.append((f"{command} {RATE} --out {result}", *(judged if n in JUDGED else ())))
        for n, scene in enumerate(("", "cube --free --mass 0.1", f"cube {TWO_GLOVES}", f"cube --free {TWO_GLOVES}")):
            chains.append((f"live glove {scene} --duration 1 --out {place}/session-{n}.h5",))
        submission = f"{place}/scene/example-submission.csv"
        chains.append((f"scene cube pinch --out {place}/scene", f"score {submission} --out {place}/score.h5"))
        chains.append((f"repair examples/grab.csv --object rock --max-correction 20 --out {place}/repaired.csv",))
        chains.append((f"build-tree examples/mug.stl --unit mm --level 3 --out {place}/mug.h5",))
        for done, _ in enumerate(side_by_side.map(lambda chain: in_turn(*chain), chains)):
            report("kernels of the commands", done + 1, len(chains))
        in_turn(f"compare {place}/0.h5 {place}/1.h5")


def pack(cache: Path, folder: Path) -> None:
    """Copy the kernels that Python calls, each with the digest of its code before it."""
    shutil.copytree(cache / "kernels", folder, ignore=shutil.ignore_patterns(f"{CALLEE_PREFIX}*"))


def build(folder: Path, report: Progress = silent) -> Path:
    """Build the wheel into a folder, and report what is compiled; return its path."""
    with tempfile.TemporaryDirectory() as name:
        source, cache = Path(name) / "source", Path(name) / "cache"
        cache.mkdir(mode=0o700)
        if named_target() is None:
            raise SystemExit("kernels can be shipped from a machine whose processor runs the named target alone")
        compile_all(cache, report)
        shutil.copytree(REPOSITORY, source, ignore=shutil.ignore_patterns(*LEFT_OUT))
        pack(cache, source / SHIPPED.relative_to(REPOSITORY))
        tags = {"--build-option": [f"--python-tag=cp{sys.version_info.major}{sys.version_info.minor}"]}
        tags["--build-option"].append(f"--plat-name={PLATFORM}_{platform.machine()}")
        call = [sys.executable, "-c", BUILD, str(folder.resolve()), repr(tags)]
        done = subprocess.run(call, cwd=source, check=True, capture_output=True, text=True)
    return folder / done.stdout.split()[-1]


def main() -> None:
    """Build it and print name and size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=REPOSITORY / "dist")
    folder: Path = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    with progress(quiet=False) as report:
        path = build(folder, report)
    print(f"{path.name}: {1e-6 * path.stat().st_size:.1f} MB")


if __name__ == "__main__":
    main()

"""Whether runs have the same bits whatever the processor, the mathematical library and the BLAS.

    python -m tools.same_bits [--scene NAME ...] [--environment NAME ...] [--python PATH ...]

runs the named scenes (all, where none is named) as this machine has it, then with each library told to take the code
of another processor, and with each other Python that has hhsim. The table says, for
each environment, which scenes have other bytes; every dataset counts, but times and what names the machine.
"""

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np

from hhsim.kernels.cache_folder import cache_root
from hhsim.system.hdf5_input import open_hdf5

OF_THE_MACHINE = ("timing/", "duration", "time", "seal")
"""What the names of datasets contain that a clock or the file itself writes."""
NUMPY_OFF = "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR X86_V4"
ENVIRONMENTS: Mapping[str, Mapping[str, str]] = {
    "as it is": {},
    "numpy without AVX-512": {"NPY_DISABLE_CPU_FEATURES": NUMPY_OFF},
    "BLAS of a Prescott": {"OPENBLAS_CORETYPE": "Prescott"},
    "BLAS of a Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "BLAS of a Zen": {"OPENBLAS_CORETYPE": "Zen"},
    "libm without FMA": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-AVX512F"},
    "kernels for this processor": {"HHSIM_CPU": "native"},
}
"""Environment variables by what they stand for."""
SCENES: Mapping[str, str] = {
    "coupled": "replay bunny grasp",
    "coupled, mesh": "replay teapot slide --surface mesh",
    "progressive": "replay cup slide --method progressive",
    "progressive, mesh": "replay bunny whole-hand --surface mesh --method progressive",
    "paper": "replay cube pinch --method paper",
    "penalty": "replay cylinder grasp --method penalty",
    "free": "replay cube lift --free --mass 0.1 --friction 0.6",
    "free, mesh": "replay bunny lift --free --surface mesh",
    "driven": "replay rock carry --tremor 0.1,0.2",
    "driven, mesh": "replay cup carry --surface mesh --method progressive",
    "recording": "replay bunny finger-tap",
    "tree and script of a mesh": "replay objects/cube.ply grasp --size 100 --level 3",
    "motion of a live session": "replay cube SESSION",
    "live session run again": "replay SESSION",
}
"""Commands by name; SESSION is a live session that was recorded before."""
SESSION = "SESSION"
MAIN = "import sys; from hhsim.cli.main import main; sys.argv[0] = 'hhsim'; main()"
"""What the command `hhsim` runs."""
KIND = "import platform as p; print('Python', p.python_version(), p.machine(), *p.libc_ver())"
"""Program that says what a Python is."""


def digest(path: Path) -> str:
    """Return a digest of all datasets of an HDF5 file but times."""
    found = hashlib.sha256()

    def add(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and not any(word in name for word in OF_THE_MACHINE):
            values = np.asarray(item[()])
            found.update(name.encode())
            found.update(repr(values.tolist()).encode() if values.dtype.kind == "O" else values.tobytes())

    with open_hdf5(path) as file:
        file.visititems(add)
    return found.hexdigest()[:16]


def run(program: Sequence[str], command: Sequence[str], environment: Mapping[str, str], folder: Path) -> str:
    """Run a command in a process of its own; return the digest of its file, or why there is none.

    A result that is run again is compared with itself, and has no file: the number of identical arrays is returned.
    """
    out = folder / "run.h5"
    out.unlink(missing_ok=True)
    again = len(command) == 2
    written = ["--json"] if again else ["--out", str(out)]
    done = subprocess.run([*program, *command, *written], env=os.environ | environment, capture_output=True, text=True)
    if again and done.stdout:
        identical = [array["identical"] for array in json.loads(done.stdout)["arrays"].values()]
        return f"{sum(identical)} of {len(identical)} arrays"
    if not out.exists():
        return f"code {done.returncode}: {(done.stderr.strip().splitlines() or ['no file'])[-1]}"
    return digest(out)


def fresh_cache(folder: Path) -> Path:
    """Return a cache folder with this user's compiled kernels and no tree: each environment builds its own."""
    cache = folder / "cache"
    shutil.rmtree(cache, ignore_errors=True)
    cache.mkdir(mode=0o700)
    kernels = cache_root() / "kernels"
    kernels.mkdir(parents=True, exist_ok=True)
    (cache / "kernels").symlink_to(kernels)
    return cache


def programs(pythons: Sequence[str]) -> Mapping[str, tuple[Sequence[str], Mapping[str, str]]]:
    """Return command and environment variables of each column of the table."""
    own = [sys.executable, "-P", "-c", MAIN]
    found: dict[str, tuple[Sequence[str], Mapping[str, str]]] = {
        name: (own, more) for name, more in ENVIRONMENTS.items()
    }
    for python in pythons:
        said = subprocess.run([python, "-c", KIND], capture_output=True, text=True, check=True).stdout.strip()
        found[said] = ([python, "-P", "-c", MAIN], {})
    return found


def main() -> None:
    """Run the commands and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", action="append", choices=list(SCENES), help="default: all")
    parser.add_argument("--environment", action="append", choices=list(ENVIRONMENTS), help="default: all")
    parser.add_argument("--python", action="append", default=[], help="another Python that has hhsim")
    given = parser.parse_args()
    columns = programs(given.python)
    if given.environment:
        columns = {
            name: column for name, column in columns.items() if name not in ENVIRONMENTS or name in given.environment
        }
    wrong = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        session = folder / "session.h5"
        record = ["live", "glove", "cube", "--device", "sim", "--duration", "2", "--out", str(session)]
        subprocess.run([sys.executable, "-P", "-c", MAIN, *record], check=True, capture_output=True)
        print(f"| scene | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|", sep="\n", flush=True)
        for scene in given.scene or SCENES:
            command = [str(session) if word == SESSION else word for word in SCENES[scene].split()]
            found = []
            for program, more in columns.values():
                found.append(run(program, command, {**more, "HHSIM_CACHE_DIR": str(fresh_cache(folder))}, folder))
            shown = [found[0], *("same" if value == found[0] else value for value in found[1:])]
            wrong += sum(value != "same" for value in shown[1:])
            print(f"| {scene} | {' | '.join(shown)} |", flush=True)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()

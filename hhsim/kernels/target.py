"""Processor that the kernels are compiled for: a named one, whose machine code serves every machine of its kind.

The results do not depend on it: all arithmetic of the kernels is rounded as IEEE 754 says, in an order that the source
fixes. The named target makes the machine code itself the same, so that it can be kept, copied and shipped. Code for
AVX-512 has the same results sooner, and takes twice as long to compile: a wheel brings it, a checkout has it on demand.
"""

import os
import platform
import warnings
from pathlib import Path

import numba
from llvmlite import binding

NAMED = "HHSIM_CPU"
"""Environment variable: a named target, or `native` to compile for the processor of this machine."""
NATIVE = "native"
X86, ARM = ("x86-64-v4", "x86-64-v3"), ("generic",)
TARGETS = {"x86_64": X86, "AMD64": X86, "aarch64": ARM, "arm64": ARM}
"""LLVM's names of the targets for each kind of machine, fastest first."""
AVX2 = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
NEEDED = {"x86-64-v3": AVX2, "x86-64-v4": (*AVX2, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")}
"""Features that a processor must have to run code for a target."""
COMPILED = Path(__file__).parent / "compiled"
"""Folder of a wheel's kernels; there is none in the sources."""
BUILT_FOR = "TARGET"
"""File there with the texts of the targets that they were compiled for, a line each."""

OPTIMISATION = {"OPT": 3, "LOOP_VECTORIZE": 1, "SLP_VECTORIZE": 0}
"""Settings of numba that change the machine code; only kernels with checked bounds take them from the environment."""


class TargetWarning(UserWarning):
    """The kernels are compiled for another processor than `HHSIM_CPU` names."""


def known_targets() -> tuple[str, ...]:
    """Return the named targets that the processor of this machine can run, fastest first."""
    has = binding.get_host_cpu_features()
    named = TARGETS.get(platform.machine(), ())
    return tuple(name for name in named if all(has.get(feature) for feature in NEEDED.get(name, ())))


def is_named() -> bool:
    """Return True if the kernels are compiled for a named target of this kind of machine."""
    return str(numba.config.CPU_NAME) in TARGETS.get(platform.machine(), ())


def shipped_targets() -> list[str]:
    """Return the texts of the targets that a wheel brings kernels for; none in the sources."""
    try:
        return (COMPILED / BUILT_FOR).read_text(encoding="utf-8").splitlines()
    except OSError:
        return []


def chosen_target() -> str:
    """Return the target that `HHSIM_CPU` names, else the fastest that a wheel brings, else the soonest to compile."""
    known, wanted = known_targets(), os.environ.get(NAMED, "")
    if wanted in (*known, NATIVE):
        return wanted
    if wanted:
        expected = ", ".join([*known, NATIVE])
        warnings.warn(f"{NAMED}={wanted!r}: expected nothing or one of {expected}", TargetWarning, stacklevel=3)
    brought = {word for line in shipped_targets() for word in line.split()}
    return next((name for name in known if name in brought), known[-1] if known else NATIVE)


def set_target() -> str:
    """Set numba's target and its settings that change machine code, before anything is compiled; return their text."""
    config = numba.config
    config.CPU_NAME, config.CPU_FEATURES = chosen_target(), ""
    if config.CPU_NAME == NATIVE:
        config.CPU_NAME = binding.get_host_cpu_name()
        config.CPU_FEATURES = binding.get_host_cpu_features().flatten()
    if not config.BOUNDSCHECK:
        for name, value in OPTIMISATION.items():
            setattr(config, name, type(getattr(config, name))(value))
    settings = [str(getattr(config, name)) for name in ("CPU_NAME", "CPU_FEATURES", "BOUNDSCHECK", *OPTIMISATION)]
    return " ".join([platform.machine(), numba.__version__, *settings])


TARGET = set_target()
"""Text of all that the machine code depends on besides the sources."""

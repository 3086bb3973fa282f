"""Processor that the kernels are compiled for: a named one, whose machine code serves every machine of its kind.

The results do not depend on it: all arithmetic of the kernels is rounded as IEEE 754 says, in an order that the source
fixes. The named target makes the machine code itself the same, so that it can be kept, copied and shipped.
"""

import os
import platform
import warnings

import numba
from llvmlite import binding

CHOICE = "HHSIM_CPU"
"""Environment variable: `native` to compile for the processor of this machine."""
NATIVE = "native"
TARGETS = {"x86_64": "x86-64-v3", "aarch64": "generic", "arm64": "generic"}
"""LLVM's name of the target for each kind of machine."""
NEEDED = {"x86-64-v3": ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")}
"""Features that a processor must have to run code for a target."""
OPTIMISATION = {"OPT": 3, "LOOP_VECTORIZE": 1, "SLP_VECTORIZE": 0}
"""Settings of numba that change the machine code; only kernels with checked bounds take them from the environment."""


class TargetWarning(UserWarning):
    """The kernels are compiled for another processor than `HHSIM_CPU` says."""


def named_target() -> str | None:
    """Return the named target of this kind of machine; None if there is none or the processor lacks a feature."""
    target, has = TARGETS.get(platform.machine()), binding.get_host_cpu_features()
    return target if target and all(has.get(feature) for feature in NEEDED.get(target, ())) else None


def chosen_target() -> str:
    """Return the named target, or `native` where the processor is older or `HHSIM_CPU` says so."""
    wanted = os.environ.get(CHOICE, "")
    if wanted not in ("", NATIVE):
        warnings.warn(f"{CHOICE}={wanted!r}: expected nothing or {NATIVE}", TargetWarning, stacklevel=3)
    return NATIVE if wanted == NATIVE else named_target() or NATIVE


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

"""Recorded baselines: figures of a suite's scenes, as a JSON file that a project commits."""

import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec
from msgspec import structs

from hhsim import __version__
from hhsim.errors import InputError
from hhsim.gate.input_hash import RunInputs
from hhsim.gate.metrics import COUNTERS, RunFigures
from hhsim.kernels.machine_calibration import REFERENCE_VERSION
from hhsim.metrics.run.registry import judged_metrics
from hhsim.system import environment as info
from hhsim.system.atomic_write import write_atomically
from hhsim.system.input_file import read_input_text
from hhsim.system.settings_file import Settings, Version, typed

FORMAT = "hhsim-gate-baseline"
BASELINE_VERSION = 1
DIGITS = 15
"""Significant digits of sums in the file; the tolerance of a comparison is far above."""


class RecordedScene(Settings, frozen=True, kw_only=True, forbid_unknown_fields=False, omit_defaults=True):
    """One scene of a baseline."""

    inputs: RunInputs
    digest: str = ""  # of poses and forces
    errors: dict[str, float | None]  # figures that the gate judges; None where undefined
    counters: dict[str, int]
    times: tuple[float, ...] = ()  # median of each timed process [s]; empty where none was timed
    references: tuple[float, ...] = ()  # median of the reference workload before each [s]

    @classmethod
    def of(cls, figures: RunFigures) -> "RecordedScene":
        """Return the scene of a run, without times."""
        errors = {name: value if math.isfinite(value) else None for name, value in figures.errors.items()}
        return cls(inputs=figures.inputs, digest=figures.digest, errors=errors, counters=figures.counters)

    def check(self) -> None:
        """Check that there is a time of the reference workload for each time."""
        if len(self.times) != len(self.references):
            raise InputError(f"{len(self.times)} times beside {len(self.references)} of the reference workload")

    @property
    def figures(self) -> RunFigures:
        """Figures of the run, NaN for those that are undefined or not in the file, `cpu_p50` too."""
        found = {name: self.errors.get(name) for name in judged_metrics()}
        errors = {name: math.nan if value is None else value for name, value in found.items()}
        counters = {name: self.counters[name] for name in COUNTERS if name in self.counters}
        return RunFigures(self.inputs, errors, counters, math.nan, digest=self.digest)


class Baseline(Settings, frozen=True, forbid_unknown_fields=False):
    """Recorded baseline; `source` is for messages, `reference_version` that of the workload beside its times."""

    format: Literal["hhsim-gate-baseline"]
    version: Version
    scenes: dict[str, RecordedScene]
    reference_version: int = 0
    source: str = ""


def write_baseline(path: Path, scenes: Mapping[str, RecordedScene]) -> None:
    """Write a baseline; raise OutputError if the file cannot be written."""
    timed = any(scene.times for scene in scenes.values())
    document = {
        "format": FORMAT,
        "version": BASELINE_VERSION,
        "hhsim": __version__,
        # A file without times is the same from any machine: what it was made on would only make noise in its history.
        **({"machine": info.machine(), "reference_version": REFERENCE_VERSION} if timed else {}),
        "scenes": msgspec.to_builtins(scenes),
    }
    text = json.dumps(_rounded(document), indent=1, ensure_ascii=False)
    # A list of numbers is a line: a changed number is then a changed line, and no page of them.
    text = re.sub(r"\[[-+.,\de\s]+\]", lambda found: " ".join(found[0].split()), text)
    write_atomically(path, f"{text}\n".encode())


def load_baseline(path: Path) -> Baseline:
    """Read a baseline; InputError if there is no such file, no baseline, another version, or a field is missing."""
    try:
        document = json.loads(read_input_text(path))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; record it with hhsim gate SUITE --write-baseline {path}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read the baseline {path}: {getattr(error, 'strerror', None) or error}") from error
    except json.JSONDecodeError as error:
        raise InputError(f"the baseline {path} is no JSON: {error}") from error
    try:
        return structs.replace(typed(document, Baseline, f"the baseline {path}"), source=str(path))
    except InputError as error:
        raise InputError(f"{error}; record it anew with hhsim gate --write-baseline FILE") from None


def _rounded(value: Any) -> Any:
    """Round floating-point numbers to `DIGITS` digits, so that last bits make no differences in a history."""
    if isinstance(value, Mapping):
        return {str(key): _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value

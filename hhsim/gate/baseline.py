"""Recorded baselines: figures of a suite's scenes, as a JSON file that a project commits."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

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


@dataclass(frozen=True)
class RecordedScene:
    """One scene of a baseline."""

    figures: RunFigures  # figures of its run; `cpu_p50` is NaN
    times: tuple[float, ...] = ()  # median of each timed process [s]; empty where none was timed
    references: tuple[float, ...] = ()  # median of the reference workload before each [s]


@dataclass(frozen=True)
class Baseline:
    """Recorded baseline; `source` is for messages, `reference_version` that of the workload beside its times."""

    source: str
    reference_version: int
    scenes: Mapping[str, RecordedScene] = field(default_factory=dict)


def write_baseline(path: Path, scenes: Mapping[str, RecordedScene]) -> None:
    """Write a baseline; raise OutputError if the file cannot be written."""
    timed = any(scene.times for scene in scenes.values())
    document = {
        "format": FORMAT,
        "version": BASELINE_VERSION,
        "hhsim": __version__,
        # A file without times is the same from any machine: what it was made on would only make noise in its history.
        **({"machine": info.machine(), "reference_version": REFERENCE_VERSION} if timed else {}),
        "scenes": {name: _scene_json(scene) for name, scene in scenes.items()},
    }
    text = json.dumps(_rounded(document), indent=1, ensure_ascii=False)
    # A list of numbers is a line: a changed number is then a changed line, and no page of them.
    text = re.sub(r"\[[-+.,\de\s]+\]", lambda found: " ".join(found[0].split()), text)
    write_atomically(path, f"{text}\n".encode())


def load_baseline(path: Path) -> Baseline:
    """Read a baseline.

    Raises:
        InputError: No such file, no baseline, another version, or fields that are missing.
    """
    try:
        document = json.loads(read_input_text(path))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; record it with hhsim gate SUITE --write-baseline {path}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read the baseline {path}: {getattr(error, 'strerror', None) or error}") from error
    except json.JSONDecodeError as error:
        raise InputError(f"the baseline {path} is no JSON: {error}") from error
    try:
        found = typed(document, _BaselineFile, f"the baseline {path}")
    except InputError as error:
        raise InputError(f"{error}; record it anew with hhsim gate --write-baseline FILE") from None
    scenes = {name: scene.recorded() for name, scene in found.scenes.items()}
    return Baseline(str(path), found.reference_version, scenes)


class _SceneTable(Settings, frozen=True, forbid_unknown_fields=False):
    inputs: RunInputs
    errors: dict[str, float | None]
    counters: dict[str, int]
    digest: str = ""
    times: tuple[float, ...] = ()
    references: tuple[float, ...] = ()

    def check(self) -> None:
        if len(self.times) != len(self.references):
            raise InputError(f"{len(self.times)} times beside {len(self.references)} of the reference workload")

    def recorded(self) -> RecordedScene:
        """Return the scene, with NaN for figures that are undefined or not in the file."""
        found = {name: self.errors.get(name) for name in judged_metrics()}
        errors = {name: math.nan if value is None else value for name, value in found.items()}
        counters = {name: self.counters[name] for name in COUNTERS if name in self.counters}
        figures = RunFigures(self.inputs, errors, counters, math.nan, digest=self.digest)
        return RecordedScene(figures, self.times, self.references)


class _BaselineFile(Settings, frozen=True, forbid_unknown_fields=False):
    format: Literal["hhsim-gate-baseline"]
    version: Version
    scenes: dict[str, _SceneTable]
    reference_version: int = 0


def _scene_json(scene: RecordedScene) -> dict[str, Any]:
    timed = {"times": list(scene.times), "references": list(scene.references)} if scene.times else {}
    return {**scene.figures.to_json(), **timed}


def _rounded(value: Any) -> Any:
    """Round floating-point numbers to `DIGITS` digits, so that last bits make no differences in a history."""
    if isinstance(value, Mapping):
        return {str(key): _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value

"""Recorded baselines: what a suite's scenes did once, as a JSON file that a project commits."""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from hhsim import __version__
from hhsim.errors import InputError
from hhsim.gate.input_hash import inputs_from_json
from hhsim.gate.metrics import COUNTERS, RunFigures
from hhsim.kernels.machine_calibration import REFERENCE_VERSION
from hhsim.metrics.run.registry import judged_metrics
from hhsim.system import environment as info
from hhsim.system.atomic_write import write_atomically
from hhsim.system.input_file import read_input_text

FORMAT = "hhsim-gate-baseline"
BASELINE_VERSION = 1
DIGITS = 15
"""Significant digits of sums in the file; the tolerance of a comparison is far above."""


@dataclass(frozen=True)
class RecordedScene:
    """One scene of a baseline.

    Attributes:
        figures: What its run is judged by; `cpu_p50` is NaN.
        times: Median of each timed process [s]; empty where none was timed.
        references: Median of the reference workload before each [s].
    """

    figures: RunFigures
    times: tuple[float, ...] = ()
    references: tuple[float, ...] = ()


@dataclass(frozen=True)
class Baseline:
    """A recorded baseline.

    Attributes:
        source: For messages.
        reference_version: Of the reference workload that its times were taken beside.
        scenes: By name.
    """

    source: str
    reference_version: int
    scenes: Mapping[str, RecordedScene] = field(default_factory=dict)


def write_baseline(path: Path, scenes: Mapping[str, RecordedScene]) -> None:
    """Write a baseline.

    Raises:
        OutputError: The file cannot be written.
    """
    timed = any(scene.times for scene in scenes.values())
    document = {
        "format": FORMAT,
        "version": BASELINE_VERSION,
        "hhsim": __version__,
        # A file without times is the same from any machine: what it was made on would only make noise in its history.
        **({"machine": asdict(info.machine()), "reference_version": REFERENCE_VERSION} if timed else {}),
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
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(f"{path} is no baseline: make one with hhsim gate --write-baseline FILE")
    if document.get("version") != BASELINE_VERSION:
        raise InputError(
            f"the baseline {path} has version {document.get('version')!r}, this hhsim reads {BASELINE_VERSION}: "
            "record it anew with hhsim gate --write-baseline"
        )
    try:
        return Baseline(
            source=str(path),
            reference_version=int(document.get("reference_version", 0)),
            scenes={name: _scene(scene, f"{path}, scene {name}") for name, scene in document["scenes"].items()},
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"the baseline {path} is damaged: {error!r}") from error


def _scene_json(scene: RecordedScene) -> dict[str, Any]:
    timed = {"times": list(scene.times), "references": list(scene.references)} if scene.times else {}
    return {**scene.figures.to_json(), **timed}


def _scene(document: Mapping[str, Any], where: str) -> RecordedScene:
    errors = {name: _number(document["errors"].get(name)) for name in judged_metrics()}
    counters = {name: int(document["counters"][name]) for name in COUNTERS if name in document["counters"]}
    inputs = inputs_from_json(document["inputs"], where)
    times = tuple(float(value) for value in document.get("times", ()))
    references = tuple(float(value) for value in document.get("references", ()))
    if len(times) != len(references):
        raise InputError(f"{where}: {len(times)} times beside {len(references)} of the reference workload")
    return RecordedScene(RunFigures(inputs, errors, counters, float("nan")), times, references)


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _rounded(value: Any) -> Any:
    """The same with floating-point numbers of `DIGITS` digits, so that last bits make no differences in a history."""
    if isinstance(value, Mapping):
        return {str(key): _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value

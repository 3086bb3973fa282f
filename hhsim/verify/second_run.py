"""The scene run again, by the solver itself: all that a run writes is compared with what the file holds.

A replay is made anew from the words of its scene where object and motion are to be had, else from the bodies and the
user's hand in the file; of a session the ticks are run again. Not compared are measured times, and what names the
machine, the versions, the date and the command.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import h5py
import msgspec
import numpy as np

from hhsim.arrays import AnyArray, IntArray
from hhsim.errors import HhsimError, InputError, OutputError
from hhsim.linkage.file import names_a_linkage
from hhsim.mesh.catalogue import names_a_file
from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.repeat import COUNTERS, ROUNDING, TIMINGS, other_makers, run_again
from hhsim.replay.replay import Replay
from hhsim.replay.stored_scene import result_scene, stored_options
from hhsim.result import schema
from hhsim.result.reader import Result
from hhsim.scene.described_scene import SceneWords, load_words
from hhsim.scene.scene import Scene
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import ACTIVE_SET
from hhsim.solver.scene_solver import SceneSolver
from hhsim.system.hdf5_input import open_hdf5
from hhsim.system.progress import Progress
from hhsim.verify.claim import FAILS, NOT_JUDGED, Claim, all_true

NAME, SAYS = "second run", "the scene, run again, gives every dataset, figure and label of the file"
OF_NO_RUN = {
    *("command", "created_utc", "git_dirty", "git_revision", "hhsim_version", "machine", "packages"),
    *("repeated", "score", "complete"),
}
"""Attributes of a file that no second run gives."""
OF_A_MACHINE = {"motion_source"}
"""Labels that may name places of a machine."""
NOT_WORDS = {"object_mesh", "object_repairs", "placement", "level", "tree_options", *OF_A_MACHINE}
"""Labels that a program which calls the library may leave out, besides the words."""
UNITS = {**ROUNDING, "s": 1e-9, "rad,m": 1e-12}
"""Largest difference that counts as rounding on another machine, by unit."""
SAME_FIGURE = 1e-6
"""The same of figures and labels, as a share."""
TOLD = 4
"""Differences that a note tells, of all."""


@dataclass
class Comparison:
    """A file beside that of its second run."""

    elsewhere: bool  # True if another machine or version made the file: rounding is let pass
    compared: int = 0  # number of items: datasets, attributes and labels
    different: dict[str, str] = field(default_factory=dict)  # how items differ
    first_tick: int | None = None  # first tick that differs

    def add(self, item: str, difference: str, tick: int | None = None) -> None:
        """Count an item, and note how it differs; "" for not at all."""
        self.compared += 1
        if not difference:
            return
        self.different[item] = difference
        if tick is not None:
            self.first_tick = tick if self.first_tick is None else min(self.first_tick, tick)

    @property
    def told(self) -> str:
        """The first differences in words."""
        texts = [f"{item} {difference}" for item, difference in list(self.different.items())[:TOLD]]
        rest = len(self.different) - len(texts)
        return "; ".join([*texts, *([f"{rest:,} more"] if rest else [])])

    def claim(self, result: Result, note: str) -> Claim:
        """Return the verdict; none on a run of another version that differs."""
        makers = other_makers(result) if self.elsewhere else []
        of_versions = [text for text in makers if not text.startswith(("cpu", "system"))]
        wrong = np.zeros(max(self.compared, 1), bool)
        wrong[: len(self.different)] = True
        why = "rounding, of another machine or version" if self.elsewhere else "equal bytes"
        notes = "; ".join(filter(None, [self.told, note, *makers]))
        claim = replace(all_true(NAME, SAYS, wrong, note=notes, why=why), tick=self.first_tick)
        return replace(claim, verdict=NOT_JUDGED) if claim.failed and of_versions else claim


def second_run_claim(result: Result, report: Progress, trust: bool = False) -> Claim:
    """Judge a file, of one hand or of two, by a run of its scene; `trust` as of `run_again`.

    Not judged are methods and sessions that cannot be run again, and runs of another version that differ.
    """
    first = next(iter(result.hands.values()))
    if first.live is not None:
        return _session(first, report, trust)
    try:
        options = stored_options(first, trust)
        scene, note = _scene(result, options, report)
        with TemporaryDirectory(prefix="hhsim-") as folder:
            path = Path(folder) / "again.h5"
            with SceneSolver(scene, options) as solver:
                run = Replay(solver)
                with run.writer(path, ()):
                    run.go(report)
                    run.finish()
            with open_hdf5(first.path) as stored, open_hdf5(path) as made:
                found = _compared(first, stored, made)
    except HhsimError as error:
        # hhsim would not have made such a file by a method and a QP solver of its own.
        own = first.method in METHODS and first.scene["solver"].get("qp") == ACTIVE_SET
        verdict = FAILS if own and not isinstance(error, OutputError) else NOT_JUDGED
        return Claim(NAME, SAYS, verdict, 1.0, 0.0, "", checked=1, note=f"it cannot be run again: {error}")
    return found.claim(first, note)


def _session(first: Result, report: Progress, trust: bool) -> Claim:
    """Judge the ticks of a session, as its hands and bodies were at them."""
    whole = replace(first, name="") if len(first.hands) > 1 else first
    try:
        again = run_again(whole, trust=trust, progress=report)
    except HhsimError as error:
        return Claim(NAME, SAYS, NOT_JUDGED, note=f"it cannot be run again: {error}")
    found = Comparison(again.made_elsewhere)
    for array in again.arrays:
        begun = array.first_beyond if again.made_elsewhere else array.first_tick
        found.add(array.name, f"differs from tick {begun:,} on" if begun >= 0 else "", begun)
    return found.claim(first, "; ".join(again.notes))


def _scene(result: Result, options: SolverOptions, report: Progress) -> tuple[Scene, str]:
    """Make the scene of a replay from its words, else from its file; return it with a note.

    HhsimError for words of the catalogue alone that do not go together: no run has them.
    """
    hands = list(result.hands.values())
    known = _known_words(hands[0], len(hands))
    named = [known[name] for name in ("object", "trajectory") if name in known]
    files = [word for word in (*named, known.get("tree"), known.get("hand_file")) if word and names_a_file(str(word))]
    try:
        if len(named) < 2:
            raise InputError("the file names no object or no motion")
        return _scene_by_words(hands[0], known, options, report), "; ".join(
            f"with {file} as it is now" for file in files
        )
    except HhsimError as error:
        if len(named) == 2 and not files:
            raise
        return result_scene(
            hands
        ), f"from the bodies and the user's hand in the file, which nothing else shows: {error}"


def _known_words(result: Result, hands: int) -> dict[str, Any]:
    """Return the words of the file's scene; none of a repaired recording, or of what a program put together."""
    stated = result.scene
    known = {name: stated[name] for name in SceneWords.__struct_fields__ if stated.get(name) is not None}
    by_words = "free" in stated or names_a_linkage(str(known.get("object"))) or len(result.bodies) > 1
    # A program may describe what it likes, and run a part of it.
    if "place_object" not in stated or "recording" in stated or (result.body.is_free and not by_words):
        return {}
    # Of several parts the scene states the level of the tree over all of them.
    grown = max(int(body.static["tree/level"].max(initial=1)) for body in result.bodies.values())
    known["level"] = (stated.get("tree_options") or {}).get("level", grown)
    if known.get("tree") or known.get("max_error"):
        del known["level"]
    known["hand"] = "both" if hands > 1 else result.side
    if (stated.get("placement") or {}).get("by_itself"):
        known.pop("place_object", None)
    return known


def _scene_by_words(result: Result, known: Mapping[str, Any], options: SolverOptions, report: Progress) -> Scene:
    """Make the scene anew; HhsimError where its object or its motion are not to be had."""
    try:
        words = msgspec.convert(known, SceneWords)
    except msgspec.ValidationError as error:
        raise InputError(f"the words of its scene cannot be used: {error}") from error
    scene = load_words(words, surface=options.surface).placed(options.fingers, report).scene
    if scene.description["object_mesh"] != result.scene.get("object_mesh") and names_a_file(words.object):
        raise InputError(f"{words.object} is another mesh now")
    return scene


def _compared(result: Result, stored: h5py.File, made: h5py.File) -> Comparison:
    found = Comparison(bool(other_makers(result)))
    for path in sorted({*_paths(stored), *_paths(made)}):
        one, other = stored.get(path), made.get(path)
        if one is None or other is None:
            found.add(path, "is in no run" if other is None else "is not there")
        elif isinstance(one, h5py.Dataset) and isinstance(other, h5py.Dataset):
            found.add(path, *_rows_apart(result, path, one, other, found.elsewhere))
    for path in ("/", *sorted({*_groups(stored)} & {*_groups(made)})):
        for name in sorted({*stored[path].attrs} | {*made[path].attrs}):
            one, other = stored[path].attrs.get(name), made[path].attrs.get(name)
            if path == "/" and name in OF_NO_RUN:
                continue
            if path.startswith(schema.SUMMARY):
                # A run that was stopped has no figures.
                if result.complete and not is_measured(name):
                    found.add(f"{path}@{name}", _figures_apart(one, other, found.elsewhere))
            elif name in ("scene", "properties"):
                _compare_labels(f"{path}@{name}", json.loads(str(one)), json.loads(str(other)), found)
            else:
                found.add(f"{path}@{name}", _figures_apart(one, other, False))
    return found


def _paths(file: h5py.File) -> Iterator[str]:
    """Yield the datasets of a run; a skin is added to its file afterwards."""
    names: list[str] = []
    file.visititems(lambda path, item: names.append(path) if isinstance(item, h5py.Dataset) else None)
    skipped = (f"/{TIMINGS}", f"/{schema.SKIN}/")
    return (path for path in names if not any(part in path for part in skipped))


def _groups(file: h5py.File) -> list[str]:
    """Paths of all groups and datasets, which have attributes."""
    names: list[str] = []
    file.visit(names.append)
    return names


def is_measured(figure: str) -> bool:
    """True for a figure of the summary that no second run gives: a time."""
    known = run_metrics().get(figure)
    return known is not None and known.noise > 0.0


def _rows_apart(
    result: Result, path: str, stored: h5py.Dataset, made: h5py.Dataset, elsewhere: bool
) -> tuple[str, int | None]:
    """Return how two datasets differ, and the first tick; "" for not at all."""
    one, other = np.asarray(stored[...]), np.asarray(made[...])
    if not result.complete and len(one) < len(other):
        other = other[: len(one)]
    if one.shape != other.shape or one.dtype != other.dtype:
        return f"has shape {one.shape} and type {one.dtype}, not {other.shape} and {other.dtype}", None
    units = str(made.attrs.get("units", ""))
    bound = 0.0
    if elsewhere:
        counts = f"/{schema.TICK}/{COUNTERS}" in path
        bound = np.inf if counts else UNITS.get(units, 0.0) if one.dtype.kind == "f" else 0.0
    rows = _differing(one, other, bound)
    if not len(rows):
        return "", None
    of_ticks = f"{schema.TICK}/" in path
    place = f"tick {rows[0]:,}" if of_ticks else f"row {rows[0]:,}"
    return f"differs in {len(rows):,} rows, first in {place}", int(rows[0]) if of_ticks else None


def _differing(one: AnyArray, other: AnyArray, bound: float) -> IntArray:
    """Rows that differ by more than `bound`, by any byte for 0."""
    if one.dtype.kind == "O" or not one.size:
        return np.flatnonzero(one != other)
    one, other = (np.ascontiguousarray(values).reshape(len(values), -1) for values in (one, other))
    rows = np.flatnonzero((one.view(np.uint8) != other.view(np.uint8)).any(axis=1))
    if bound == 0.0:
        return rows
    a, b = one[rows].astype(np.float64), other[rows].astype(np.float64)
    near = (a == b) | (np.isnan(a) & np.isnan(b)) | (np.abs(a - b) <= bound)
    return np.asarray(rows[~near.all(axis=1)])


def _figures_apart(stored: Any, made: Any, elsewhere: bool) -> str:
    """Return how two attributes differ; "" for not at all."""
    if stored is None or made is None:
        return "is in no run" if made is None else "is not there"
    one, other = np.asarray(stored), np.asarray(made)
    numbers = one.dtype.kind in "fiu" and other.dtype.kind in "fiu" and one.shape == other.shape
    if numbers and np.array_equal(one, other, equal_nan=True):
        return ""
    if numbers and elsewhere and np.allclose(one, other, rtol=SAME_FIGURE, atol=SAME_FIGURE, equal_nan=True):
        return ""
    return "" if not numbers and np.array_equal(one, other) else f"is {stored}, and {made} of a second run"


def _compare_labels(path: str, stored: Mapping[str, Any], made: Mapping[str, Any], found: Comparison) -> None:
    """Compare JSON documents label by label; words that a program leaves out, or adds, are not the run's."""
    one, other = dict(_labels(stored)), dict(_labels(made))
    for label in sorted(one.keys() | other.keys()):
        first = label.partition(".")[0]
        if first in OF_A_MACHINE or (label not in other and first not in made):
            continue
        if label not in one and first not in stored and first in {*SceneWords.__struct_fields__, *NOT_WORDS}:
            continue
        same = label in one and label in other and _alike(one[label], other[label], found.elsewhere)
        told = f"is {one.get(label, 'not there')}, and {other.get(label, 'not there')} of a second run"
        found.add(f"{path}.{label}", "" if same else told)


def _alike(one: Any, other: Any, elsewhere: bool) -> bool:
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(_alike(a, b, elsewhere) for a, b in zip(one, other))
    if elsewhere and isinstance(one, float) and isinstance(other, float):
        return abs(one - other) <= SAME_FIGURE * (1.0 + abs(one))
    return bool(one == other) and isinstance(one, bool) == isinstance(other, bool)


def _labels(stated: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in stated.items():
        if isinstance(value, Mapping) and value:
            yield from _labels(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value

"""The scene run again, by the solver itself: all that a run writes is compared with what the file holds.

A replay is made anew from the words of its scene where object and motion are to be had, else from the bodies and the
user's hand in the file; of a session the ticks are run again. Not compared are measured times, and what names the
machine, the versions, the date and the command.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import h5py
import msgspec
import numpy as np

from hhsim.errors import HhsimError, InputError, OutputError
from hhsim.linkage.file import names_a_linkage
from hhsim.mesh.catalogue import names_a_file
from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.repeat import TIMINGS, ArrayComparison, other_makers, run_again
from hhsim.replay.replay import Replay
from hhsim.replay.stored_scene import result_scene, stored_options
from hhsim.result import schema
from hhsim.result.reader import Result
from hhsim.scene.described_scene import SceneWords, load_words
from hhsim.scene.scene import Scene
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import ACTIVE_SET
from hhsim.solver.solver import SceneSolver
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
SAME_FIGURE = 1e-6
"""The same of figures and labels, as a share."""
NOT_RUN = (f"/{TIMINGS}", f"/{schema.SKIN}/")
"""Parts of the paths of datasets that no second run gives: times, and a skin, which is added to its file afterwards."""
MISSING = object()
TOLD = 4
"""Differences that a note tells, of all."""


Item = tuple[str, str, int | None]
"""A dataset, attribute or label, how it differs ("" for not at all), and the first tick."""


def second_run_claim(result: Result, report: Progress, trust: bool = False) -> Claim:
    """Judge a file, of one hand or of two, by a run of its scene; `trust` as of `run_again`.

    Not judged are methods and sessions that cannot be run again, and runs of another version that differ.
    """
    first = next(iter(result.hands.values()))
    live = first.live is not None
    try:
        items, note = (_ticks_again if live else _run_again)(result, first, report, trust)
    except HhsimError as error:
        # hhsim would not have made such a file by a method and a QP solver of its own.
        own = first.method in METHODS and first.scene["solver"].get("qp") == ACTIVE_SET
        verdict = FAILS if own and not live and not isinstance(error, OutputError) else NOT_JUDGED
        return Claim(NAME, SAYS, verdict, 1.0, 0.0, "", checked=1, note=f"it cannot be run again: {error}")
    different = [(f"{item} {difference}", tick) for item, difference, tick in items if difference]
    texts = [text for text, _ in different[:TOLD]]
    texts += [f"{len(different) - TOLD:,} more"] if len(different) > TOLD else []
    makers = other_makers(first)
    why = "rounding, of another machine or version" if makers else "equal bytes"
    wrong = np.arange(max(len(items), 1)) < len(different)
    claim = all_true(NAME, SAYS, wrong, note="; ".join(filter(None, ["; ".join(texts), note, *makers])), why=why)
    claim = replace(claim, tick=min((tick for _, tick in different if tick is not None), default=None))
    of_versions = [text for text in makers if not text.startswith(("cpu", "system"))]
    return replace(claim, verdict=NOT_JUDGED) if claim.failed and of_versions else claim


def _ticks_again(result: Result, first: Result, report: Progress, trust: bool) -> tuple[list[Item], str]:
    """Compare the ticks of a session, as its hands and bodies were at them."""
    whole = replace(first, name="") if len(first.hands) > 1 else first
    again = run_again(whole, trust=trust, progress=report)
    begun = {array.name: array.first_beyond if again.made_elsewhere else array.first_tick for array in again.arrays}
    items = [(name, f"differs from tick {tick:,} on" if tick >= 0 else "", tick) for name, tick in begun.items()]
    return [*items], "; ".join(again.notes)


def _run_again(result: Result, first: Result, report: Progress, trust: bool) -> tuple[list[Item], str]:
    """Compare a replay with the file of its second run."""
    options = stored_options(first, trust)
    scene, note = _scene(list(result.hands.values()), options, report)
    with TemporaryDirectory(prefix="hhsim-") as folder:
        path = Path(folder) / "again.h5"
        Replay(SceneSolver(scene, options)).into(path, progress=report)
        with open_hdf5(first.path) as stored, open_hdf5(path) as made:
            return [*_compared(first, stored, made)], note


def _scene(hands: Sequence[Result], options: SolverOptions, report: Progress) -> tuple[Scene, str]:
    """Make the scene of a replay from its words, else from its file; return it with a note.

    HhsimError for words of the catalogue alone that do not go together: no run has them.
    """
    result, stated = hands[0], hands[0].scene
    known = {name: stated[name] for name in SceneWords.__struct_fields__ if stated.get(name) is not None}
    by_words = "free" in stated or names_a_linkage(str(known.get("object"))) or len(result.bodies) > 1
    # A program may describe what it likes.
    if "place_object" not in stated or "recording" in stated or (result.body.is_free and not by_words):
        known = {}
    else:
        # Of several parts the scene states the level of the tree over all of them.
        grown = max(int(body.static["tree/level"].max(initial=1)) for body in result.bodies.values())
        known["level"] = _options(stated, "tree_options").get("level", grown)
        known["hand"] = "both" if len(hands) > 1 else result.side
        gone = ["level"] if known.get("tree") or known.get("max_error") else []
        gone += ["place_object"] if _options(stated, "placement").get("by_itself") else []
        known = {name: word for name, word in known.items() if name not in gone}
    named = [known[name] for name in ("object", "trajectory") if name in known]
    files = [word for word in (*named, known.get("tree"), known.get("hand_file")) if word and names_a_file(str(word))]
    try:
        if len(named) < 2:
            raise InputError("the file names no object or no motion")
        words = msgspec.convert(known, SceneWords)
        scene = load_words(words, surface=options.surface).placed(options.fingers, report).scene
        if scene.description["object_mesh"] != stated.get("object_mesh") and names_a_file(words.object):
            raise InputError(f"{words.object} is another mesh now")
    except (HhsimError, msgspec.ValidationError) as error:
        if len(named) == 2 and not files:
            raise InputError(f"the words of its scene cannot be used: {error}") from error
        return result_scene(hands), f"from the bodies and hand in the file, which nothing else shows: {error}"
    # A program may have run a part of the motion.
    part = result.complete and result.ticks < scene.ticks.tick_count
    return scene.first(result.ticks) if part else scene, "; ".join(f"with {file} as it is now" for file in files)


def _options(stated: Mapping[str, Any], label: str) -> dict[str, Any]:
    try:
        return msgspec.convert(stated.get(label) or {}, dict[str, Any])
    except msgspec.ValidationError as error:
        raise InputError(f"{label} of its scene cannot be used: {error}") from error


def is_measured(figure: str) -> bool:
    """True for a figure of the summary that no second run gives: a time."""
    known = run_metrics().get(figure)
    return known is not None and known.noise > 0.0


def _compared(result: Result, stored: h5py.File, made: h5py.File) -> Iterator[Item]:
    share = SAME_FIGURE if other_makers(result) else 0.0
    paths = [_paths(file) for file in (stored, made)]
    for path, item in sorted({**paths[0], **paths[1]}.items()):
        one, other = (of.get(path) for of in paths)
        if isinstance(item, h5py.Dataset) and not any(part in path for part in NOT_RUN):
            absent = one is None or other is None
            yield (path, _word(one, other), None) if absent else (path, *_rows_apart(result, one, other, share > 0.0))
    for path in sorted(paths[0].keys() & paths[1].keys()):
        attributes = [dict(of[path].attrs) for of in paths]
        for name in sorted({**attributes[0], **attributes[1]}):
            one, other = (of.get(name, MISSING) for of in attributes)
            if name in ("scene", "properties"):
                yield from _labels_apart(f"{path}@{name}", json.loads(str(one)), json.loads(str(other)), share)
            elif path.startswith(schema.SUMMARY):
                # A run that was stopped has no figures.
                if result.complete and not is_measured(name):
                    yield f"{path}@{name}", _apart(one, other, share), None
            elif path != "/" or name not in OF_NO_RUN:
                yield f"{path}@{name}", _apart(one, other, 0.0), None


def _paths(file: h5py.File) -> dict[str, Any]:
    """All groups and datasets of a file by their paths."""
    found: dict[str, Any] = {"/": file}
    file.visititems(lambda path, item: found.update({path: item}))
    return found


def _rows_apart(result: Result, stored: h5py.Dataset, made: h5py.Dataset, elsewhere: bool) -> tuple[str, int | None]:
    """Return how two datasets differ, and the first tick; "" for not at all."""
    one, other, path = np.asarray(stored[...]), np.asarray(made[...]), str(made.name)
    if not result.complete and len(one) < len(other):
        other = other[: len(one)]
    if one.shape != other.shape or one.dtype != other.dtype:
        return f"has shape {one.shape} and type {one.dtype}, not {other.shape} and {other.dtype}", None
    if one.dtype.kind == "O":
        return _apart(one, other, 0.0), None
    _, of_ticks, name = path.rpartition(f"/{schema.TICK}/")
    array = ArrayComparison(schema.Column(name, one.shape[1:], one.dtype.str, str(made.attrs["units"]), ""))
    array.add(one, other)
    rows, first = (array.beyond, array.first_beyond) if elsewhere else (array.ticks, array.first_tick)
    if not rows:
        return "", None
    return f"differs in {rows:,} rows, first in {'tick' if of_ticks else 'row'} {first:,}", first if of_ticks else None


def _labels_apart(path: str, stored: Mapping[str, Any], made: Mapping[str, Any], share: float) -> Iterator[Item]:
    """Compare JSON documents label by label; words that a program leaves out, or adds, are not the run's."""
    one, other = dict(_labels(stored)), dict(_labels(made))
    for label in sorted(one.keys() | other.keys()):
        first = label.partition(".")[0]
        added = label not in other and first not in made
        omitted = label not in one and first not in stored and first in {*SceneWords.__struct_fields__, *NOT_WORDS}
        if not (first in OF_A_MACHINE or added or omitted):
            yield f"{path}.{label}", _apart(one.get(label, MISSING), other.get(label, MISSING), share), None


def _labels(stated: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in stated.items():
        if isinstance(value, Mapping) and value:
            yield from _labels(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def _word(stored: Any, made: Any) -> str:
    """Return how an item is other than of a second run, or is in one of both alone."""
    if stored is None or stored is MISSING:
        return "is not there"
    return "is in no run" if made is None or made is MISSING else f"is {stored}, and {made} of a second run"


def _apart(stored: Any, made: Any, share: float) -> str:
    """Return how two attributes or labels differ, numbers by more than a share of them; "" for not at all."""
    one, other = (of.tolist() if isinstance(of, np.ndarray | np.generic) else of for of in (stored, made))
    return "" if _alike(one, other, share) else _word(stored, made)


def _alike(one: Any, other: Any, share: float) -> bool:
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(_alike(a, b, share) for a, b in zip(one, other))
    if isinstance(one, float) and isinstance(other, float):
        return one == other or (one != one and other != other) or abs(one - other) <= share * (1.0 + abs(one))
    return bool(one == other) and isinstance(one, bool) == isinstance(other, bool)

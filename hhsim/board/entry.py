"""Runs on the board: scene, method, machine and figures of each.

They are the rows of sweeps in a folder, and every other result there.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from hhsim.errors import InputError
from hhsim.gate.unusual_options import unusual_options
from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.recorded_verdict import verdict
from hhsim.replay.summary_table import stored_rows
from hhsim.replay.verdict import UNTOUCHED
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import FORMAT, SUFFIXES
from hhsim.result.wording import motion_name, object_name
from hhsim.sweep.folder import CELLS, is_sweep, read_row
from hhsim.sweep.folder import FAILED as FAILED_ENDING
from hhsim.sweep.plan import BOTH
from hhsim.system.counted import counted
from hhsim.system.hdf5_input import hdf5_format
from hhsim.system.progress import Progress, silent


@dataclass(frozen=True)
class Entry:
    """One run."""

    object: str
    motion: str
    method: str
    surface: str
    options: str  # options that are not the usual ones, in words; "" where all are
    machine: str  # processor, cores, system and Python, as JSON: times compare within a machine
    hhsim: str = ""  # version and commit
    created: str = ""  # time, UTC
    own_core: bool = False  # True if its ticks had a core of their own: else its times say little
    verdict: str = ""  # word of the verdict; "failed" where there is no result
    # SI or %, by the names of `hhsim.metrics.run.registry.run_metrics`; times are means over the runs.
    figures: Mapping[str, float] = field(default_factory=dict)
    # Standard deviation of times over several runs, by the same names.
    deviations: Mapping[str, float] = field(default_factory=dict)
    option_set: str = ""  # name of a sweep's set of options; "" of any other result
    runs: int = 1  # number of runs of the same cell, or by `hhsim replay --repeat`
    source: str = ""
    reason: str = ""  # why it failed, or ""

    @property
    def scene(self) -> tuple[str, str]:
        """Object and motion."""
        return self.object, self.motion

    @property
    def key(self) -> tuple[str, str, str, str, str]:
        """Identity of a run, apart from its machine."""
        return self.object, self.motion, self.method, self.surface, self.options

    @property
    def option_sets(self) -> list[str]:
        """Names of its set of options."""
        return self.option_set.split(BOTH) if self.option_set else []


FAILED = "failed"


def shown_options(name: str, options: str) -> str:
    """Return the name of a set of options, and what is not usual in it."""
    return ": ".join(part for part in (name, options) if part) or "usual"


def entry_of_row(row: Mapping[str, Any], source: Path) -> Entry:
    """Return the entry of a sweep's cell, done or failed."""
    cell = row["cell"]
    common = {name: cell[name] for name in ("object", "motion", "method", "surface")}
    common |= {"machine": json.dumps(row.get("machine", {}), sort_keys=True), "source": str(source)}
    if "summary" not in row:
        options = "" if cell["options"] == "usual" else str(cell["options"])
        return Entry(**common, options=options, verdict=FAILED, reason=str(row.get("reason", "")))
    return Entry(
        **common,
        options=option_words(row["scene"]),
        option_set=str(cell["options"]),
        hhsim=_hhsim(row.get("hhsim_version"), row.get("git_revision"), row.get("git_dirty")),
        created=str(row.get("created_utc", "")),
        own_core=bool(row.get("own_core")),
        verdict=str(row.get("verdict", "")),
        **_figures(row["summary"], row.get("repeated", {})),
    )


def entry_of_result(result: Result) -> Entry:
    """Return the entry of a single replay, a session, or a submission, by the name that it has."""
    submitter = result.scene.get("submission")
    if isinstance(submitter, Mapping):
        submitter = submitter.get("name") or submitter.get("method") or result.path.stem
    return Entry(
        object=object_name(result),
        motion=motion_name(result),
        method=str(submitter or result.method),
        surface=result.surface,
        options=option_words(result.scene),
        machine=json.dumps(result.machine, sort_keys=True),
        hhsim=_hhsim(result.hhsim_version, result.git_revision, result.git_dirty),
        created=result.created_utc,
        verdict=verdict(result, stored_rows(result.summary)).word,
        **_figures(result.summary, result.repeated),
        source=str(result.path),
    )


def option_words(scene: Mapping[str, Any]) -> str:
    """Return the options of a scene that are not usual for its method and surface, as `name=value`, in order."""
    return ", ".join(f"{name}={_spelled(value)}" for name, value in unusual_options(scene).items())


def _figures(summary: Mapping[str, Any], repeated: Mapping[str, Any]) -> dict[str, Any]:
    """Return an entry's figures: those of the last run, but the mean of times over several."""
    times = repeated.get("times", {})
    found = {**summary, **{name: time["mean"] for name, time in times.items()}}
    return {
        "figures": {
            name: float(found[name])
            for name in run_metrics()
            if name in found and found[name] is not None and found[name] == found[name]
        },
        "deviations": {name: float(time["std"]) for name, time in times.items()},
        "runs": int(repeated.get("runs", 1)),
    }


def _hhsim(version: Any, commit: Any, dirty: Any) -> str:
    short = str(commit or "")[:8]
    known = short if short and short != "unknown" else ""
    return " ".join(part for part in (str(version or ""), known + ("+" if known and dirty is True else "")) if part)


def _spelled(value: Any) -> str:
    if isinstance(value, list | tuple):
        return "/".join(_spelled(item) for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class Board:
    """Runs side by side."""

    entries: tuple[Entry, ...]  # last run of each object, motion, method, surface, options and machine
    failed: tuple[Entry, ...]  # failed runs that did not work elsewhere on the same machine
    machines: dict[str, str]  # label by machine, in the order of the entries
    notes: tuple[str, ...]  # sentences for the reader


def collect(folders: Sequence[Path], progress: Progress = silent) -> Board:
    """Read folders of sweeps or of results, and single results; InputError without such a folder or result."""
    paths = [path for folder in folders for path in _files(folder)]
    entries: list[Entry] = []
    notes: list[str] = []
    for number, path in enumerate(paths):
        progress("results", number, len(paths))
        try:
            if path.suffix == ".json":
                try:
                    entries.append(entry_of_row(read_row(path), path))
                except (KeyError, TypeError, ValueError) as error:
                    raise InputError(f"a row that lacks {error}") from None
                continue
            for result in load_result(path).hands.values():
                if result.complete:
                    entries.append(entry_of_result(result))
                else:
                    notes.append(f"{path} is of a run that was stopped: left out")
        except InputError as error:
            notes.append(f"{path} is left out: {error}")
    if not entries:
        what = ", ".join(map(str, folders))
        raise InputError("; ".join([f"no result in {what}", *notes[:3]]))
    return merged(entries, notes)


def merged(entries: Iterable[Entry], notes: Sequence[str] = ()) -> Board:
    """Keep the last of each run on each machine."""
    last: dict[tuple[str, ...], Entry] = {}
    failed: dict[tuple[str, ...], Entry] = {}
    replaced: list[Entry] = []
    for entry in sorted(entries, key=lambda entry: entry.created):
        place = (*entry.key, entry.machine)
        if entry.verdict == FAILED:
            failed[place] = entry
            continue
        if place in last:
            replaced.append(last[place])
            names = BOTH.join(dict.fromkeys((*last[place].option_sets, *entry.option_sets)))
            entry = replace(entry, option_set=names)
        last[place] = entry
    kept = sorted(last.values(), key=lambda entry: (*entry.key, entry.machine))
    found = list(notes)
    if replaced:
        found.append(
            f"{counted(len(replaced), 'result')} left out: of the same object, motion, method, surface, options and "
            f"machine as a later one, first: {replaced[0].source}"
        )
    found += _differences(kept)
    runs = [entry.runs for entry in kept if entry.runs > 1]
    if runs:
        many = f"{min(runs):,}" if min(runs) == max(runs) else f"{min(runs):,} to {max(runs):,}"
        found.append(
            f"times of {len(runs):,} of {counted(len(kept), 'result')} are means over {many} runs; ± is the standard "
            "deviation of a run, where all scenes that a figure is of have one"
        )
    still = [entry for place, entry in sorted(failed.items()) if place not in last]
    if still:
        first = ", ".join(part for part in still[0].key if part)
        found.append(f"cells that failed, and count in no figure: {len(still):,}, first: {first}: {still[0].reason}")
    bare = sum(entry.verdict == UNTOUCHED for entry in kept)
    if bare:
        found.append(f"nothing touched in {counted(bare, 'run')}, of which depth, contacts and forces say nothing")
    machines = dict.fromkeys(entry.machine for entry in kept)
    labels = {machine: chr(ord("A") + i) if i < 26 else f"M{i}" for i, machine in enumerate(machines)}
    return Board(tuple(kept), tuple(still), labels, tuple(found))


def _files(folder: Path) -> list[Path]:
    if folder.is_file():
        return [folder]
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected one of a sweep, or of results (.h5)")
    found = []
    if is_sweep(folder):
        found += sorted((folder / CELLS).glob("*.json"))
    rows = {path.name.removesuffix(FAILED_ENDING).removesuffix(".json") for path in found}
    # A row says all that its result does; results beside a sweep's are others'.
    for path in sorted(folder.iterdir()):
        others = path.suffix.lower() in SUFFIXES and path.stem not in rows and not path.name.startswith(".")
        if others and _may_be_a_result(path):
            found.append(path)
    return found


def _may_be_a_result(path: Path) -> bool:
    """Return True for a result, and for a file that is being written, which `load_result` names."""
    try:
        return hdf5_format(path) == FORMAT
    except BlockingIOError:
        return True


SAME = 1e-6
"""Relative difference up to which errors of two machines are the same."""
COMPARED = ("penetration_max", "contact_error_max", "tracking_excess", "force_hold_mean", "stuck_ticks", "lag_ticks")


def _differences(entries: Iterable[Entry]) -> list[str]:
    """Return a sentence where machines do not agree about an error, which does not depend on them."""
    groups: dict[tuple[str, ...], list[Entry]] = {}
    for entry in entries:
        groups.setdefault(entry.key, []).append(entry)
    several = [group for group in groups.values() if len(group) > 1]
    apart = []
    for group in several:
        for name in COMPARED:
            values = [entry.figures[name] for entry in group if name in entry.figures]
            if values and max(values) - min(values) > SAME * max(map(abs, values)):
                apart.append(f"{', '.join(part for part in group[0].key if part)} ({name})")
                break
    runs = f"{len(apart):,} of {len(several):,} runs that several did"
    return [f"machines differ in an error in {runs}, first: {apart[0]}"] if apart else []

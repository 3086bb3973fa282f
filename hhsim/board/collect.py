"""Runs of folders: the rows of sweeps, and every other result there."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from hhsim.board.entry import FAILED, Entry, entry_of_result, entry_of_row
from hhsim.errors import InputError
from hhsim.replay.verdict import UNTOUCHED
from hhsim.result.reader import hand_paths, load_result
from hhsim.result.schema import FORMAT, SUFFIXES
from hhsim.sweep.folder import CELLS, is_sweep, read_row
from hhsim.sweep.folder import FAILED as FAILED_ENDING
from hhsim.sweep.plan import BOTH
from hhsim.system.counted import counted
from hhsim.system.hdf5_input import hdf5_format
from hhsim.system.progress import Progress, silent


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
            for result in map(load_result, hand_paths(path)):
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

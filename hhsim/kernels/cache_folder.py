"""Folder of what hhsim may delete and make again, machine code included: only its user can write it."""

import grp
import os
import pwd
import stat
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

NAMED = "HHSIM_CACHE_DIR"
TRUSTED = (0,)
"""Users that may own the folder besides the one who runs hhsim: root can change programs anyway."""


class CacheFolderWarning(UserWarning):
    """A cache folder is used in place of the named one."""


def cache_root() -> Path:
    """Return the first usable of `HHSIM_CACHE_DIR`, `XDG_CACHE_HOME`/hhsim or ~/.cache/hhsim, and a temporary folder.

    One that cannot be written, or that others can write, is passed over with a warning; this process and its children
    then keep to the one that is used instead.
    """
    refused = ""
    for root in _candidates():
        fault = _fault(root)
        if not fault:
            break
        refused = refused or f"the cache folder {root} is not used: {fault}"
    else:
        root = Path(tempfile.mkdtemp(prefix="hhsim-"))
    if refused:
        warnings.warn(f"{refused}; {NAMED} names another; used instead: {root}", CacheFolderWarning, stacklevel=2)
        os.environ[NAMED] = str(root)
    return root


def _candidates() -> Iterator[Path]:
    named, base = os.environ.get(NAMED), os.environ.get("XDG_CACHE_HOME")
    if named:
        yield Path(named)
    yield (Path(base) if base else Path("~/.cache").expanduser()) / "hhsim"
    yield Path(tempfile.gettempdir()) / f"hhsim-{os.getuid()}"


def _fault(root: Path) -> str:
    """Return why a folder cannot be the cache, "" if it can. A missing one is made."""
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not os.access(root, os.W_OK | os.X_OK):
            return "it cannot be written"
        for folder in (root, *(entry for entry in root.iterdir() if entry.is_dir())):
            state = folder.stat()
            if state.st_uid not in (*TRUSTED, os.getuid()):
                return f"{folder} belongs to another user"
            if _others_write(state):
                return f"others can write {folder} (chmod go-w), from which machine code is loaded"
        above = root.resolve().parent
        if above.stat().st_mode & (stat.S_IWOTH | stat.S_ISVTX) == stat.S_IWOTH:
            return f"others can replace it in {above}"
    except OSError as error:
        return (error.strerror or str(error)).lower()
    return ""


def _others_write(state: os.stat_result) -> bool:
    """Return True if others than the owner can write a folder; a group of the owner alone does not count."""
    if not state.st_mode & stat.S_IWGRP or state.st_mode & stat.S_IWOTH:
        return bool(state.st_mode & stat.S_IWOTH)
    try:
        group, owner = grp.getgrgid(state.st_gid), pwd.getpwuid(state.st_uid)
    except KeyError:
        return True
    return group.gr_name != owner.pw_name or bool({*group.gr_mem} - {owner.pw_name})

"""Which folder keeps what hhsim may delete and make again: one that nobody else can write.

Machine code is run as it is found there.
"""

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
"""Users that may own the folder besides the one who runs hhsim: root can change the programs too."""


class CacheFolderWarning(UserWarning):
    """Another folder than the one that was named is used."""


def cache_root() -> Path:
    """Folder for everything hhsim may delete and make again.

    `HHSIM_CACHE_DIR` wins, then `XDG_CACHE_HOME`/hhsim, then ~/.cache/hhsim, then a folder of the user's in the
    system's temporary directory. One that cannot be written, or that others can write, is passed over with a warning,
    and this process and its children keep to the one that is used instead.
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
    """Why a folder cannot be the cache, in words; "" where it can. It is made where it is missing."""
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
    """Whether others than the owner can write a folder; a group of the owner's alone is no others."""
    if not state.st_mode & stat.S_IWGRP or state.st_mode & stat.S_IWOTH:
        return bool(state.st_mode & stat.S_IWOTH)
    try:
        group, owner = grp.getgrgid(state.st_gid), pwd.getpwuid(state.st_uid)
    except KeyError:
        return True
    return group.gr_name != owner.pw_name or bool({*group.gr_mem} - {owner.pw_name})

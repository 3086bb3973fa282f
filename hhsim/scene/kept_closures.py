"""Closures that a search has found: shipped for the catalogue's objects and scripts, or kept in the cache.

A search takes about a second and finds the same for the same script, hand and object.
"""

import functools
import hashlib
import json
from collections.abc import Callable
from dataclasses import fields
from importlib.resources import files
from typing import Any

import numpy as np

from hhsim.errors import OutputError
from hhsim.hand.model import HandModel
from hhsim.kernels.cache_folder import cache_root
from hhsim.kernels.hand import finger_closure as kernel
from hhsim.kernels.kernel_cache import module_digest
from hhsim.scene.finger_closure import FingerClosure
from hhsim.scene.script import Script
from hhsim.system.atomic_write import write_atomically
from hhsim.trees.sphere_tree import SphereTree

SEARCH_VERSION = 1
"""Raised when the search finds other closures: `python -m tools.build_closures` then makes anew those that ship."""
SHIPPED = "closures.json"

_SOURCES = ("scene/closure_search.py", "scene/finger_closure.py", "scene/script.py", "reproducible.py")
"""Files of hhsim that a search depends on, beside the kernels: a change of one makes closures in the cache stale."""

Fields = dict[str, Any]
"""A closure as JSON has it: lists of numbers and names by field."""

_found: dict[str, Fields] = {}


def kept_closure(
    script: Script, hand: HandModel, tree: SphereTree, search: Callable[[], FingerClosure]
) -> FingerClosure:
    """Return the closure of a script's hand on an object (`tree`, world frame): shipped, cached, or searched for now.

    A damaged file in the cache is searched for again; a cache that cannot be written is done without.
    """
    key = closure_key(script, hand, tree)
    kept = shipped_closures().get(key) or _found.get(key)
    if kept is not None:
        return decoded(kept)
    path = cache_root() / "closures" / f"{hashlib.sha256(f'{key} {_sources()}'.encode()).hexdigest()[:32]}.json"
    try:
        closure = decoded(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, KeyError, TypeError, ValueError):
        closure = search()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, json.dumps(encoded(closure)).encode())
        except (OSError, OutputError):
            pass
    _found[key] = encoded(closure)
    return closure


def closure_key(script: Script, hand: HandModel, tree: SphereTree) -> str:
    """Return a digest of what a search depends on: the script, and every array of hand and tree."""
    digest = hashlib.blake2b(f"{SEARCH_VERSION} {script!r}".encode(), digest_size=16)
    for values in (*hand.arrays(), *tree.arrays()):
        digest.update(np.asarray(values).tobytes())
    return digest.hexdigest()


@functools.cache
def shipped_closures() -> dict[str, Fields]:
    """Return the closures that ship by their key."""
    file = files("hhsim.objects") / SHIPPED
    kept: dict[str, Fields] = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    return kept


@functools.cache
def _sources() -> str:
    digest = hashlib.sha256(module_digest(kernel.__name__).encode())
    for source in _SOURCES:
        digest.update((files("hhsim") / source).read_bytes())
    return digest.hexdigest()


def encoded(closure: FingerClosure) -> Fields:
    """Return a closure's fields, with every digit of its numbers."""
    return {each.name: np.array(getattr(closure, each.name)).tolist() for each in fields(FingerClosure)}


def decoded(kept: Fields) -> FingerClosure:
    """Return the closure of such fields; KeyError, TypeError or ValueError if they are none of a closure."""
    names = ("reached", "missed")
    parts: dict[str, Any] = {name: np.array(values, np.float64) for name, values in kept.items() if name not in names}
    return FingerClosure(**parts | {name: tuple(kept[name]) for name in names})

"""Data in pickles, read without running what is in them: arrays and a few known classes; any other is refused."""

import io
import pickle
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import DamagedFileError, InputError, TrajectoryError
from hhsim.system.child_reader import read_in_child

MOST_VALUES, MOST_DEPTH = 20_000_000, 50
"""Largest number of values in a pickle's lists and dictionaries, and of an array, and of those within one another."""


class _State:
    """Object of a class that is not imported: its state, as data."""

    state: Any = None

    def __init__(self, *arguments: Any) -> None:
        """Take any arguments, and leave them."""

    def __setstate__(self, state: Any) -> None:
        self.state = state

    def __reduce__(self) -> tuple[Any, ...]:
        return _State, (), self.state


class _Unpickler(pickle.Unpickler):
    """Unpickler that makes arrays; of sparse matrices and of chumpy's arrays only their state."""

    def find_class(self, module: str, name: str) -> Any:
        """Return one of a few classes; nothing else can be reached from the file."""
        if module in ("numpy.core.multiarray", "numpy._core.multiarray") and name in ("_reconstruct", "scalar"):
            from numpy._core import multiarray

            return getattr(multiarray, name)
        if module in ("numpy.core.numeric", "numpy._core.numeric") and name == "_frombuffer":
            return getattr(np._core.numeric, name)
        if module == "numpy" and name in ("ndarray", "dtype"):
            return getattr(np, name)
        if (module, name) == ("_codecs", "encode"):
            return lambda text, encoding="latin1": text.encode("latin1")
        if module.split(".")[0] == "chumpy" or module.startswith("scipy.sparse"):
            return _State
        if (module, name) in (("copy_reg", "_reconstructor"), ("copyreg", "_reconstructor")):
            return _reconstructed
        if (module, name) in (("__builtin__", "object"), ("builtins", "object")):
            return object
        raise TrajectoryError(f"holds {module}.{name}, which is not data, so it is not loaded")


def _reconstructed(kind: Any, base: Any, state: Any) -> Any:
    if kind is not _State:
        raise TrajectoryError("holds an object that is not data, so it is not loaded")
    return _State()


def unpickled(data: bytes, what: str) -> dict[str, Any]:
    """Return the dictionary in a pickle, also in one that an array of objects wraps; messages name it as `what`.

    Raises TrajectoryError for a damaged pickle, one of something else or of more values than a recording has, or one
    that holds more than data.
    """
    try:
        return read_in_child(lambda: _read(data, what), "no pickle, or a damaged one", len(data))
    except DamagedFileError as error:
        raise TrajectoryError(f"{error}; expected {what}") from None


def _read(data: bytes, what: str) -> dict[str, Any]:
    try:
        fields = _Unpickler(io.BytesIO(data), encoding="latin1").load()
    except TrajectoryError:
        raise
    except Exception as error:
        # A damaged pickle raises whatever its bytes happen to ask for.
        raise TrajectoryError(f"no pickle, or a damaged one ({type(error).__name__}); expected {what}") from None
    if isinstance(fields, np.ndarray) and fields.shape == ():
        fields = fields.item()
    if not isinstance(fields, dict):
        raise TrajectoryError(f"a pickle of something else; expected the dictionary of {what}")
    _require_few(fields, what)
    return {str(key): value for key, value in fields.items()}


def _require_few(fields: Any, what: str) -> None:
    """Raise TrajectoryError for nested lists and dictionaries of too many values: a pickle may hold one many times."""
    left, nested = MOST_VALUES, [(fields, 0)]
    while nested:
        item, depth = nested.pop()
        inner = item.values() if isinstance(item, dict) else item if isinstance(item, (list, tuple)) else ()
        if isinstance(item, _State):
            inner = (item.state,)
        elif isinstance(item, np.ndarray) and item.dtype == object:
            inner = item.ravel().tolist()
        left -= len(inner)
        if left < 0 or depth > MOST_DEPTH:
            raise TrajectoryError(
                f"a pickle of more than {MOST_VALUES:,} values, or {MOST_DEPTH} levels; expected {what}"
            )
        nested += [(value, depth + 1) for value in inner if isinstance(value, (dict, list, tuple, _State, np.ndarray))]


def plain(value: Any, depth: int = 0) -> Any:
    """Return the array in the state of an object; None if there is none."""
    if not isinstance(value, _State) or depth > 4:
        return value
    state = value.state
    if isinstance(state, tuple):
        state = next((part for part in state if isinstance(part, dict)), None)
    if not isinstance(state, dict):
        return None
    if {"data", "indices", "indptr"} <= set(state):
        from scipy.sparse import csc_matrix

        shape = state.get("_shape", state.get("shape"))
        matrix = csc_matrix((state["data"], state["indices"], state["indptr"]), shape=shape)
        if matrix.shape[0] * matrix.shape[1] > MOST_VALUES:
            raise ValueError(f"a sparse matrix of shape {matrix.shape}")
        return matrix.toarray()
    if {"a", "idxs"} <= set(state):
        inner = plain(state["a"], depth + 1)
        return np.asarray(inner).ravel()[np.asarray(state["idxs"])].reshape(state.get("preferred_shape", (-1,)))
    return plain(state["x"], depth + 1) if "x" in state else None


def npy_dictionary(data: bytes, what: str) -> dict[str, Any]:
    """Return the dictionary in an `.npy` file of one object; errors as of `unpickled`."""
    # The header's length takes two bytes in version 1, four in later ones.
    width = 2 if data[6:7] == b"\x01" else 4
    return unpickled(data[8 + width + int.from_bytes(data[8 : 8 + width], "little") :], what)


def flat(node: Mapping[str, Any], above: str = "") -> list[tuple[str, Any]]:
    """Return the values of nested dictionaries by their keys with slashes between."""
    found: list[tuple[str, Any]] = []
    for key, value in node.items():
        name = f"{above}/{key}" if above else str(key)
        found += flat(value, name) if isinstance(value, dict) else [(name, value)]
    return found


def replaced(node: Mapping[str, Any], new: Mapping[str, FloatArray], above: str = "") -> dict[str, Any]:
    """Return nested dictionaries with other numbers, of the same shape, type and order, under the names of `flat`.

    Raises InputError for other numbers in place of whole ones.
    """
    made = {}
    for key, value in node.items():
        name = f"{above}/{key}" if above else str(key)
        made[key] = replaced(value, new, name) if isinstance(value, dict) else value
        if name in new:
            old = np.asarray(value)
            given, is_float = new[name].reshape(old.shape), old.dtype.kind == "f"
            if is_float:
                made[key] = given.astype(old.dtype, "F" if np.isfortran(old) else "C")
            elif not np.array_equal(old, given):
                what = f"'{name}' is of {old.dtype}, which does not hold a correction"
                raise InputError(f"{what}; expected floating-point numbers")
    return made


def pickled_arrays(data: bytes) -> dict[str, Any]:
    """Return the arrays and texts in a pickled dictionary by the names of `flat`; errors as of `unpickled`."""
    arrays = {}
    for name, value in flat(unpickled(data, "a recording")):
        with suppress(ValueError, TypeError):
            array = np.asarray(plain(value))
            if array.dtype.kind in "fiubUS":
                arrays[name] = array
    return arrays


def pickled_with(data: bytes, new: Mapping[str, Any]) -> bytes:
    """Return a pickled dictionary with other numbers under the names of `flat`; all else in it stays.

    Raises InputError for whole numbers, or an object of a class that is not loaded.
    """
    fields = unpickled(data, "a recording")
    if any(isinstance(value, _State) for _, value in flat(fields)):
        raise InputError("a pickle of objects is not written; save its arrays: np.savez(FILE, NAME=…)")
    return pickle.dumps(replaced(fields, new), protocol=data[1])

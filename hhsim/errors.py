"""Errors that hhsim raises on purpose.

Every message is one line: what is wrong, where, and what would be right. The command line prints it without a
traceback and exits with `exit_code`.
"""

from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from difflib import SequenceMatcher, get_close_matches


class HhsimError(Exception):
    """Any fault of the user's input, or of the place for results."""

    exit_code = 2


class InputError(HhsimError):
    """A file, an option or a value that cannot be used."""


class MeshError(InputError):
    """A mesh that is empty, broken, or has no inside."""


class TrajectoryError(InputError):
    """A trajectory whose arrays, stamps or orientations cannot be replayed."""


class DamagedFileError(InputError):
    """A file whose bytes have changed; its reader adds the file's name to the message."""


class UnknownNameError(InputError):
    """A name that no catalogue holds; the message lists similar names."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        names = sorted(known)
        near = get_close_matches(name, names, n=3, cutoff=0.5)
        # Beside a name that is meant for sure, one that is only a little alike would be odd.
        near = [other for other in near if _alike(name, other) > _alike(name, near[0]) - 0.2]
        hint = f"did you mean {' or '.join(near)}?" if near else f"known: {', '.join(names)}"
        super().__init__(f"unknown {kind} '{name}': {hint}")


def _alike(one: str, other: str) -> float:
    return SequenceMatcher(a=other, b=one).ratio()


def check_known(kind: str, names: Iterable[str], known: Collection[str]) -> None:
    """Raise UnknownNameError unless all `names` of a kind are `known`."""
    for name in names:
        if name not in known:
            raise UnknownNameError(kind, name, known)


@contextmanager
def named(file: object) -> Iterator[None]:
    """Put the name of a file, or of what else is at fault, before the message of an InputError that lacks it."""
    try:
        yield
    except InputError as error:
        kind = TrajectoryError if isinstance(error, TrajectoryError) else InputError
        raise kind(f"{file}: {str(error).removeprefix(f'{file}: ')}") from None


class OutputError(HhsimError):
    """A result that cannot be written: no permission, a full disk, a folder of that name."""

"""The OBJECT argument: a name of the catalogue or a mesh file."""

from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from hhsim.mesh import Mesh


def complete_object(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the names of the catalogue, and files where what is typed looks like one."""
    from hhsim.object_catalogue import object_names

    names = [CompletionItem(name) for name in object_names() if name.startswith(incomplete)]
    return names or [CompletionItem(incomplete, type="file")]


def is_file_argument(text: str) -> bool:
    """Whether an argument that is a name or a file means a file: a suffix or a folder in it says so."""
    return bool(Path(text).suffix) or "/" in text or "\\" in text


def read_object(
    text: str, unit: str | None, size: float | None, thickness: float | None = None
) -> tuple["Mesh", int | None]:
    """Load what OBJECT names.

    Args:
        text: a name of the catalogue, or a mesh file.
        unit: of a mesh file; None is metres.
        size: longest extent that a mesh file gets [mm]; replaces `unit`.
        thickness: of the sheets that the open parts of a mesh file become [mm]; None closes them.

    Returns:
        The mesh [m], and for an object of the catalogue the level of tree that suits it.

    Raises:
        HhsimError: an unknown name, or a mesh that cannot be used.
        UsageError: a unit, a size or a thickness for an object that has its own.
    """
    from hhsim.mesh import load_mesh
    from hhsim.object_catalogue import load_object

    if is_file_argument(text):
        if unit is not None and size is not None:
            raise click.UsageError("--unit and --size exclude each other: --size scales whatever the unit is")
        metres = [None if length is None else 1e-3 * length for length in (size, thickness)]
        return load_mesh(Path(text), unit or "m", metres[0], thickness=metres[1]), None
    if unit is not None or size is not None:
        raise click.UsageError(f"--unit and --size are for mesh files; '{text}' is an object that has its size")
    if thickness is not None:
        raise click.UsageError(f"--thickness is for mesh files; '{text}' is a closed object")
    item = load_object(text)
    return item.mesh, item.level

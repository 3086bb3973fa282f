"""The OBJECT argument: a name of the catalogue or a mesh file."""

from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from hhsim.mesh.mesh import Mesh


def complete_object(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the names of the catalogue, and files where what is typed looks like one."""
    from hhsim.mesh.catalogue import object_names

    names = [CompletionItem(name) for name in object_names() if name.startswith(incomplete)]
    return names or [CompletionItem(incomplete, type="file")]


def read_object(text: str, unit: str | None, size: float | None, thickness: float | None = None) -> tuple["Mesh", int]:
    """Load what OBJECT names, a name of the catalogue or a mesh file.

    Args:
        text: The argument.
        unit: Of a mesh file; None is metres.
        size: Longest extent that a mesh file gets [mm]; replaces `unit`.
        thickness: Of the sheets that the open parts of a mesh file become [mm]; None closes them.

    Returns:
        The mesh [m], and the level of tree that suits it.

    Raises:
        HhsimError: As `hhsim.mesh.catalogue.resolve_object`.
    """
    from hhsim.mesh.catalogue import resolve_object

    metres = [None if length is None else 1e-3 * length for length in (size, thickness)]
    return resolve_object(text, unit, *metres)

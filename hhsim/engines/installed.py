"""Optional engines: what is missing of one, and loading one silently."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from hhsim.errors import InputError
from hhsim.mesh.mesh import Mesh
from hhsim.solver.outside_method import MethodScene
from hhsim.system.posix import flush_c_output


def lack_of(extra: str, *modules: str) -> str:
    """Return a line about the first module that is not installed, with the extra of hhsim that brings it; else ""."""
    for module in modules:
        if find_spec(module) is None:
            return f"needs {module}, which is not installed: pip install 'hhsim[{extra}]'"
    return ""


def object_mesh(method: str, scene: MethodScene) -> Mesh:
    """Return the mesh of a scene's object.

    Raises:
        InputError: The object is spheres alone.
    """
    if scene.mesh is None:
        raise InputError(f"method {method} needs the object's mesh, and it is spheres alone")
    return scene.mesh


@contextmanager
def silent() -> Iterator[None]:
    """Keep what compiled code prints off the terminal until the block ends."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
        # The C library's own buffer would be written out later.
        flush_c_output()
    finally:
        for place, was in zip((1, 2), kept):
            os.dup2(was, place)
            os.close(was)
        os.close(nowhere)

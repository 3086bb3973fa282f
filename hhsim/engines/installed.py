"""Optional engines: what is missing of one, and the mesh that one needs."""

from importlib.util import find_spec

from hhsim.errors import InputError
from hhsim.mesh.mesh import Mesh
from hhsim.solver.outside_method import MethodScene


def lack_of(extra: str, *modules: str) -> str:
    """Return a line about the first module that is not installed, with the extra of hhsim that brings it; else ""."""
    for module in modules:
        if find_spec(module) is None:
            return f"needs {module}, which is not installed: pip install 'hhsim[{extra}]'"
    return ""


def object_mesh(method: str, scene: MethodScene) -> Mesh:
    """Return the mesh of a scene's object; InputError if it is spheres alone."""
    if scene.mesh is None:
        raise InputError(f"method {method} needs the object's mesh, and it is spheres alone")
    return scene.mesh

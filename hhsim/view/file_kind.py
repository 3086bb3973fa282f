"""Kind of a file that is to be looked at, by its content."""

from pathlib import Path
from typing import Literal, TypeAlias

from hhsim.errors import InputError
from hhsim.system.hdf5_input import hdf5_format
from hhsim.system.input_file import open_input
from hhsim.system.media_kind import media_kind_of

Kind: TypeAlias = Literal["result", "motion", "tree", "mesh"]

HDF5_START = b"\x89HDF\r\n\x1a\n"
"""First bytes of every HDF5 file."""
FORMATS: dict[str, Kind] = {"hhsim-result": "result", "hhsim-trajectory": "motion", "hhsim-tree": "tree"}
"""Kinds by the format that an HDF5 file states."""
MESHES = (".stl", ".ply", ".obj", ".off", ".glb", ".gltf")
"""Suffixes of mesh files, some of which are text without a mark of its own."""
EXPECTED = (
    f"a result, a trajectory, a sphere tree (.h5) or a mesh ({', '.join(MESHES)}); "
    "hhsim import makes a trajectory of a recording"
)


def file_kind(path: Path) -> Kind:
    """Return whether a file is a result, a motion, a sphere tree or a mesh; raise InputError for any other."""
    if path.is_dir():
        raise InputError(f"{path} is a folder: expected {EXPECTED}")
    if not path.exists():
        raise InputError(f"{path}: no such file; expected {EXPECTED}")
    try:
        with open_input(path) as file:
            start = file.read(len(HDF5_START))
        if start != HDF5_START:
            return _by_name(path)
        name = hdf5_format(path)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from error
    if name not in FORMATS:
        what = f"its format is {name!r}" if name else "it is damaged, or does not say what it holds"
        raise InputError(f"{path} cannot be looked at: {what}; expected {EXPECTED}")
    return FORMATS[name]


def _by_name(path: Path) -> Kind:
    suffix = path.suffix.lower()
    if suffix in MESHES:
        return "mesh"
    if suffix == ".csv":
        return "motion"
    media = media_kind_of(path)
    what = f"{path} is {media}" if media else f"{path} cannot be looked at"
    raise InputError(f"{what}: expected {EXPECTED}")

"""`hhsim examples`."""

import os
import shutil
from importlib.resources import as_file, files

from .arguments.command import argument, make_command
from .arguments.options import JSON, OutPath, show


@make_command
def command(*, folder: OutPath = argument(), as_json: bool = JSON) -> None:
    """Copy the examples that come with hhsim to a folder.

    FOLDER is made. In it are a mesh, recordings, a plan of a sweep, methods and bridges of gloves to begin with;
    README.md among them says what each shows.

    \b
    Examples:
      hhsim examples examples
    """
    from hhsim.errors import OutputError
    from hhsim.system.atomic_write import new_files

    if os.path.lexists(folder):
        raise OutputError(f"{folder} exists, so nothing is written there: name a new folder")
    target = folder.absolute()
    with new_files(target) as partial, as_file(files("hhsim.examples")) as source:
        shutil.copytree(source, partial / target.name, ignore=shutil.ignore_patterns("__init__.py", "__pycache__"))
    show(
        {"folder": str(folder), "files": sorted(path.name for path in folder.iterdir())},
        f"the examples are in {folder}; {folder / 'README.md'} says what each shows",
        as_json=as_json,
    )

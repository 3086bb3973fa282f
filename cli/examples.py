"""`hhsim examples`."""

from pathlib import Path

import click

from .arguments import options
from .console import print_json, print_line


@click.command(cls=options.Command)
@click.argument("folder", type=options.OUTPUT)
@options.json
def command(folder: Path, as_json: bool) -> None:
    """Copy the examples that come with hhsim to a folder.

    FOLDER is made. In it are a mesh, recordings, a plan of a sweep, methods and bridges of gloves to begin with;
    README.md among them says what each shows.

    \b
    Examples:
      hhsim examples examples
    """
    import os
    import shutil
    from importlib.resources import as_file, files

    from hhsim.errors import OutputError
    from hhsim.system.atomic_write import new_files

    if os.path.lexists(folder):
        raise OutputError(f"{folder} exists, so nothing is written there: name a new folder")
    target = folder.absolute()
    with new_files(target) as partial, as_file(files("hhsim.examples")) as source:
        shutil.copytree(source, partial / target.name, ignore=shutil.ignore_patterns("__init__.py", "__pycache__"))
    if as_json:
        print_json({"folder": str(folder), "files": sorted(path.name for path in folder.iterdir())})
    else:
        print_line(f"the examples are in {folder}; {folder / 'README.md'} says what each shows")

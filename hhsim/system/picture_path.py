"""Output paths of pictures: checks before the work, and the default beside a table."""

from pathlib import Path

from hhsim.errors import InputError, OutputError
from hhsim.system.output_path import check_output_path


def check_picture(path: Path) -> None:
    """Raise OutputError if the picture cannot be written, InputError if matplotlib has no such format."""
    from matplotlib.backend_bases import FigureCanvasBase

    check_output_path(path)
    kinds = sorted(FigureCanvasBase.filetypes)
    if path.suffix.lower().removeprefix(".") not in kinds:
        raise InputError(f"{path} is no picture by its ending: expected .{', .'.join(kinds)}")


def picture_beside(table: Path, named: Path | None) -> Path:
    """Return the path of the picture of a table of `hhsim bench`: as --plot names it, or beside the table, as .png.

    Raises:
        OutputError: As `check_picture`; or a picture is there that belongs to no table.
        InputError: As `check_picture`.
    """
    picture = named or table.with_suffix(".png")
    if named is None and picture.exists() and not table.exists():
        raise OutputError(f"{picture} exists and is not of hhsim bench: name another file with --plot or --out")
    check_picture(picture)
    return picture

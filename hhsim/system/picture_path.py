"""Where a picture goes: the checks that belong before the work, and the usual place beside a table."""

from pathlib import Path

from hhsim.errors import InputError, OutputError
from hhsim.system.output_path import check_output_path


def check_picture(path: Path) -> None:
    """Look, before the work, for what would keep the picture from being written.

    Raises:
        OutputError: As `hhsim.system.output_path.check_output_path`.
        InputError: matplotlib has no such picture format.
    """
    from matplotlib.backend_bases import FigureCanvasBase

    check_output_path(path)
    kinds = sorted(FigureCanvasBase.filetypes)
    if path.suffix.lower().removeprefix(".") not in kinds:
        raise InputError(f"{path} is no picture by its ending: expected .{', .'.join(kinds)}")


def picture_beside(table: Path, named: Path | None) -> Path:
    """Where the picture of a table of `hhsim bench` goes: where it is named to, or else beside the table, as .png.

    Args:
        table: The table's file, not written yet.
        named: By --plot; None where it is not.

    Raises:
        OutputError: As `check_picture`; or a picture is there that belongs to no table.
        InputError: As `check_picture`.
    """
    picture = named or table.with_suffix(".png")
    if named is None and picture.exists() and not table.exists():
        raise OutputError(f"{picture} exists and is not of hhsim bench: name another file with --plot or --out")
    check_picture(picture)
    return picture

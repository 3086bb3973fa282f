"""What every suite's JSON document says of its table."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hhsim.table.table import Column


def table_document(
    path: Path, columns: "Sequence[Column]", options: Mapping[str, Any], **more: object
) -> dict[str, Any]:
    """Where the table is, what was run, and the unit of each column; `more` stands after the paths."""
    from hhsim.bench.table import csv_path
    from hhsim.table.table import stored_unit

    units = {column.name: stored_unit(column.unit) for column in columns}
    return {"table": str(path), "csv": str(csv_path(path)), **more, "options": options, "units": units}

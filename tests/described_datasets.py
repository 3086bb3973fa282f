"""Whether a file says of each dataset what it is."""

from pathlib import Path
from typing import Any

import h5py


def bare_datasets(path: Path) -> list[str]:
    """Names of the datasets of a file that lack `units` or `long_name`; fails where it has hardly any."""
    found: dict[str, bool] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            found[name] = bool(item.attrs.get("units") and item.attrs.get("long_name"))

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    assert len(found) > 40
    return [name for name, told in found.items() if not told]

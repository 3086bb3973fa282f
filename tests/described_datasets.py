"""Whether a file says of each dataset what it is."""

from pathlib import Path
from typing import Any

import h5py


def bare_datasets(path: Path) -> list[str]:
    """Names of the datasets of a file that lack `units` or `long_name`; fails where it has hardly any."""
    bare: list[str] = []
    found = 0

    def visit(name: str, item: Any) -> None:
        nonlocal found
        if isinstance(item, h5py.Dataset):
            found += 1
            if not (item.attrs.get("units") and item.attrs.get("long_name")):
                bare.append(name)

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    assert found > 40
    return bare

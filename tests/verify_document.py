"""The tables of planted faults in docs/verify.md."""

from pathlib import Path


def documented_faults(repository: Path, table: int) -> dict[str, str]:
    """Claims by the names of the faults they find, of the first (0) or the second (1) table."""
    text = (repository / "docs" / "verify.md").read_text(encoding="utf-8")
    rows = text.split("| found by | planted faults |")[1 + table].split("\n\n")[0].splitlines()[2:]
    cells = [[cell.strip() for cell in row.split("|")] for row in rows]
    return {
        fault.split(":")[0].strip().replace(" ", "_"): claim
        for _, claim, faults, _ in cells
        for fault in faults.split(";")
    }

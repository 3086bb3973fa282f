"""The figures of a recorded session, as they stand in its file's summary."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hhsim.errors import InputError
from hhsim.live.session.statistics import LiveTally
from hhsim.result.reader import load_result

Scalar = str | int | float | bool


def session_figures(
    tally: LiveTally, missed: int, penetration_max: float, lost: Mapping[str, int]
) -> dict[str, Scalar]:
    """The summary of a session: of all ticks that were recorded, SI units.

    Args:
        tally: of these ticks.
        missed: periods without a tick since the loop began.
        penetration_max: deepest of all of them [m].
        lost: records that were overwritten before they could be written, by ring.

    Returns:
        What `LiveTally.to_json` names (`wakeup_p999` is the 99.9th percentile [s]), the ticks that were kept free as
        one figure a reason (`kept_free_stale_input`), `missed`, `penetration_max` [m], and `lost_ticks`,
        `lost_samples` and `lost_events`.
    """
    figures = tally.to_json()
    del figures["uncounted_ticks"]
    free: Mapping[str, int] = figures.pop("ticks_kept_free")
    return {
        **{name: value for name, value in figures.items() if isinstance(value, Scalar)},
        "missed": missed,
        **{f"kept_free_{why.lower()}": count for why, count in free.items()},
        "penetration_max": penetration_max,
        **{f"lost_{name}": count for name, count in lost.items()},
    }


def recorded_figures(path: Path | None) -> Mapping[str, Any]:
    """The figures in a session's file; nothing where there is no file, or where the recording was cut short."""
    if path is None:
        return {}
    try:
        result = load_result(path)
    except InputError:
        return {}
    return result.summary if result.complete and result.live is not None else {}


def as_text(value: Any) -> str:
    """Plain values as the JSON text that an attribute of the file holds."""
    return json.dumps(value, sort_keys=True, ensure_ascii=False)

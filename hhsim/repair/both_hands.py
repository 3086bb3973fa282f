"""Repair of both hands of a recording: one after the other, in one file."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.metrics.metrics import distance_of_hands
from hhsim.repair.repair import repair_recording
from hhsim.repair.request import PICTURE, REPORT, RESULT, RepairOutcome, RepairRequest
from hhsim.replay.stored_scene import stored_hand
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import SIDES
from hhsim.result.two_handed_file import BETWEEN_COLUMNS, join_hands
from hhsim.system.output_path import check_output_path
from hhsim.system.progress import Progress, silent


@dataclass(frozen=True)
class BothRepaired:
    """Outcomes of the right and of the left hand, in one recording."""

    hands: tuple[RepairOutcome, RepairOutcome]
    recording: Path  # repaired recording
    result: Path | None  # result of both hands; None where they are not in the same frames, and each has its own
    # Least distance between the repaired hands [m], negative where one is in the other; NaN without `result`.
    nearest: float

    @property
    def text(self) -> str:
        """Sentence on both hands together."""
        if np.isnan(self.nearest):
            return "the hands are not in the same frames, so each has a result of its own"
        near = f"come within {1e3 * self.nearest:.2g} mm of each other"
        if self.nearest < 0.0:
            near = f"enter each other by {-1e3 * self.nearest:.2g} mm, which is not repaired"
        return f"the repaired hands {near}"

    def to_json(self) -> dict[str, Any]:
        """Return plain values, SI."""
        hands = {side: outcome.to_json() for side, outcome in zip(SIDES, self.hands)}
        nearest = None if np.isnan(self.nearest) else self.nearest
        result = None if self.result is None else str(self.result)
        return {"recording": str(self.recording), "result": result, "distance_of_hands": nearest, "hands": hands}


def repair_both_hands(
    request: RepairRequest, *, command: Sequence[str] = (), progress: Progress = silent
) -> BothRepaired:
    """Repair the right hand of a recording, and then the left one of what that wrote; errors as `repair_recording`.

    Report, result and picture of each lie beside `request.out`, with its side in their names; the results are joined
    where the hands are in the same frames. Each hand is kept out of the object, not of the other hand.
    """
    out, given = request.out, request.recording
    check_output_path(out)
    requests = [
        replace(request, hand=side, out=out.with_name(f"{out.stem}-{side}{out.suffix}"), of_both=given)
        for side in SIDES
    ]
    try:
        right = repair_recording(requests[0], command=command, progress=progress)
        second = replace(requests[1], recording=requests[0].out)
        left = repair_recording(second, command=command, progress=progress)
        requests[1].out.replace(out)
    except BaseException:
        for one in requests:
            for path in (one.out, *(one.beside(name) for name in (RESULT, REPORT, PICTURE))):
                path.unlink(missing_ok=True)
        raise
    requests[0].out.unlink()
    results = [load_result(one.paths["result"]) for one in (right, left)]
    joined, nearest = None, np.nan
    if np.array_equal(results[0]["time"], results[1]["time"]):
        distances = [_apart(results, whose) for whose in ("haptic", "graphic")]
        between = dict(zip((column.name for column in BETWEEN_COLUMNS), distances))
        joined = join_hands([one.path for one in results], between, request.beside(RESULT))
        nearest = float(distances[1].min())
    hands = [replace(one, paths=_files(one, out, joined, side)) for side, one in zip(SIDES, (right, left))]
    return BothRepaired((hands[0], hands[1]), out, joined, nearest)


def _apart(results: Sequence[Result], whose: str) -> FloatArray:
    """Compute the distance of the haptic or the graphic hands in each frame [m], shape (T,)."""
    hands = [stored_hand(result) for result in results]
    fields = [[result[f"{whose}/{name}"] for name in HandConfiguration._fields] for result in results]
    return distance_of_hands(hands, [forward_kinematics(hand, *at) for hand, at in zip(hands, fields)])


def _files(outcome: RepairOutcome, recording: Path, joined: Path | None, side: str) -> dict[str, Path]:
    """Return an outcome's files as they are called at last."""
    result = outcome.paths["result"] if joined is None else joined / side
    return {**outcome.paths, "recording": recording, "result": result}

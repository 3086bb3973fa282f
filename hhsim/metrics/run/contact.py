"""Contacts of the shown hand, and depths: of both hands in themselves and in the object, and off the true mesh."""

from collections.abc import Callable

import numpy as np

from hhsim.metrics.run.input_hand import NEEDS, of_input
from hhsim.metrics.run_metric import Judged, RunMetric
from hhsim.metrics.run_ticks import PLACED, RunTicks

JUMPS = (*NEEDS, "force/total")
NO_DEPTH = 1e-6
"""Depth up to which nothing penetrates, or penetrates deeper than before [m]."""


def _in_itself(whose: str) -> Callable[[RunTicks], float]:
    def compute(run: RunTicks) -> float:
        if run.hand is None:
            return np.nan
        # A hand that is not finite has no depth, and hides none.
        return float(np.fmax.reduce(-run.self_clearance(whose), initial=0.0))

    return compute


JUMP = 3e-4
"""Least step of a joint that is a jump [m]: at 1 N/mm a palm's changes the force by what a hand notices of 4 N."""


def _jump(share: float) -> Callable[[RunTicks], float]:
    return lambda run: float(np.quantile(run.jumps, share)) if run.jumps.size else np.nan


METRICS = (
    RunMetric(
        "candidates_max", "candidate pairs, most", less_is_better=False,
        needs=("contacts/candidates",), compute=lambda run: run["contacts/candidates"].max(initial=0),
    ),
    RunMetric(
        "touching_max", "touching pairs, most", less_is_better=False, needs=("contacts/touching",),
        compute=lambda run: run["contacts/touching"].max(initial=0),
    ),
    RunMetric(
        "self_depth_haptic", "input hand in itself, max", digits=2, unit="mm", less_is_better=False,
        needs=("haptic/flexion", "haptic/abduction"), compute=_in_itself("haptic"), unless_zero=True,
    ),
    RunMetric(
        "input_depth_max", "input depth, max", digits=2, unit="mm", less_is_better=False, short="input depth",
        needs=NEEDS, compute=of_input("depth"),
    ),
    RunMetric(
        "penetration_max", "penetration, max", digits=3, unit="µm", paper="≈ 100", needs=("penetration_depth",),
        # A hand that is not finite has no depth, and hides none.
        compute=lambda run: np.fmax.reduce(run["penetration_depth"], initial=0.0), short="depth",
        judged=Judged(rounding=1e-9, limit=NO_DEPTH, growth=NO_DEPTH, promise="never_penetrates"),
    ),
    RunMetric(
        "contact_error_max", "contacts off the mesh, max", digits=3, unit="mm", short="off the mesh", needs=PLACED,
        # Ticks without contact are left out; NaN without any contact.
        compute=lambda run: float(np.fmax.reduce(run.contact_error, initial=np.nan)),
        judged=Judged(rounding=1e-9, limit=1e-3),
    ),
    RunMetric(
        "posture_jump_max", "largest jump of a shown joint in contact", digits=3, unit="mm", needs=JUMPS,
        compute=_jump(1.0), judged=Judged(rounding=1e-9, limit=JUMP), short="jump",
    ),
    RunMetric(
        "posture_jump_p999", "jump of a shown joint in contact, p99.9", digits=3, unit="mm", needs=JUMPS,
        compute=_jump(0.999), judged=Judged(rounding=1e-9),
    ),
    RunMetric(
        "self_depth_graphic", "shown hand in itself, max", digits=2, unit="mm",
        needs=("graphic/flexion", "graphic/abduction"), compute=_in_itself("graphic"), unless_zero=True,
    ),
)  # fmt: skip

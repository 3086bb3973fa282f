"""Claims about figures, computed anew: columns and summary that follow from others, the user's hand and its motion."""

from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.metrics.input_hand import search_deepest
from hhsim.metrics.metrics import force_variation_rate
from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run.registry import known_figures, run_figure, run_metrics, tick_figures
from hhsim.metrics.run_ticks import ticks_alone
from hhsim.result.reader import Result
from hhsim.result.schema import POSE_COLUMNS
from hhsim.solver.method import EVERYTHING
from hhsim.system.counted import counted
from hhsim.verify.claim import NOT_JUDGED, Claim, as_number, difference, figures_apart, judged
from hhsim.verify.contacts import near_pairs
from hhsim.verify.depth_checks import CONTACT_ERROR
from hhsim.verify.file_checks import follows
from hhsim.verify.judged_body import JudgedBody, judged_bodies
from hhsim.verify.kinematics import Posed, turn_between
from hhsim.verify.tick_data import LENGTH, WHY_LENGTH, JudgedTicks

SAME = 1e-9
"""Relative tolerance of figures: the rounding of sums in another order."""
DEPTH = "input_depth_max"
CORRECTION = ("correction_palm_mean", "correction_palm_max", "correction_joint_mean", "correction_joint_max")
JUMPS = ("posture_jump_max", "posture_jump_p999")
INPUT_HAND = (DEPTH, *CORRECTION, *JUMPS)
"""Figures of the user's hand, which have claims of their own in a replay."""
IN_ITSELF = ("self_depth_haptic", "self_depth_graphic")
"""Depths of the hands in themselves, which have a claim of their own in a run with self-contact."""
ELSEWHERE = (CONTACT_ERROR, *INPUT_HAND, "free_off_max", *IN_ITSELF)
"""Figures that need object or hand; most have claims of their own, by the referee's distances."""
ROUNDING = {
    **dict.fromkeys(("force_ripple_hold", "force_variation_hold", "force_variation_hold_std"), 1e-09),
    "force_variation_contact": 1e-9,
    "tracking_palm": 1e-12,
    "object_momentum": 1e-9,
    "energy_gained": 1e-12,
}
"""Absolute tolerances of figures that are differences of large numbers [N, %, m]."""
INPUT_DEPTH = "input depth", "the user's hand is as deep as the summary says, and in no tick deeper"
OFF_THE_USER = (
    "correction",
    "the shown hand is as far from the user's, in the ticks in which it touches, as the summary says",
)
"""Claims of the summary, each a name and a statement."""
SEARCHED = 1e-6
"""Tolerance of the search for the deepest tick [m]."""
BETWEEN = 1e-8
"""Tolerance of the curve between two samples [m, rad]: a stamp belongs to its tick within a nanosecond."""


def metric_claims(result: Result) -> list[Claim]:
    """Judge every figure that follows from the stored ticks."""
    ticks, first = np.arange(result.ticks), ~follows(result)
    says, claims = "the one-tick change of the force's size is that of the stored forces", []
    why = "forces of a hundredth of a newton have a change that is rounded to this"
    for name, column, force in (
        ("force variation", "force_variation_rate", result["force/total"]),
        ("finger variation", "force_variation_finger", result["force/phalanx"].sum(axis=2)),
    ):
        own = force_variation_rate(force)
        own[first] = np.nan
        off = difference(result[column], own) / np.maximum(1.0, np.nan_to_num(np.abs(own)))
        off = off.reshape(result.ticks, -1).max(axis=1)
        claims.append(judged(name, says, off, 1e-7, "%", why, ticks=ticks))
    # The figures of a session cover all its periods: `hhsim.verify.session_checks`.
    if result.complete and result.live is None:
        claims += _summary_claims(result)
    return claims


def _summary_claims(result: Result) -> list[Claim]:
    # Those elsewhere take the hand's kernels, which are not the referee's.
    own = {"ticks": float(result.ticks), **tick_figures(ticks_alone(result), but=ELSEWHERE)}
    stored = {name: as_number(value) for name, value in result.summary.items()}
    known = {name: value for name, value in own.items() if name in stored}
    size = [np.nan_to_num(np.abs(value)) + ROUNDING.get(name, 0.0) / SAME for name, value in known.items()]
    off, wrong = figures_apart(stored, known, size, SAME, "the ticks give")
    gone = sorted(required_figures(result) - stored.keys())
    wrong += [f"{name} is not there" for name in gone]
    metrics = run_metrics()
    judged_apart = (CONTACT_ERROR, *INPUT_HAND, *(IN_ITSELF if result.scene["solver"].get("self_contact") else ()))
    rest = sorted(name for name in stored if name not in own and name not in judged_apart)
    invented = [name for name in rest if name not in metrics]
    wrong += [f"{name} has no definition" for name in invented]
    values = np.append(off, np.full(len(gone) + len(invented), np.inf))
    says = "the figures of the summary are those of the ticks, and no others"
    why = "sums in another order differ by less; 1e-9 N and 1e-9 % where rounding is all there is"
    claims = [judged("summary", says, values, SAME, "1", why, note="; ".join(wrong))]
    rest = [name for name in rest if name not in invented]
    if rest:
        note = "; ".join(f"{name} {metrics[name].own_run or 'is not computed here'}" for name in rest)
        says = "figures that do not follow from the ticks"
        claims.append(Claim("summary, rest", says, NOT_JUDGED, note=note))
    return claims


def required_figures(result: Result) -> set[str]:
    """Figures of a complete replay's summary; of a trembling hand only where a hold stands still."""
    known = known_figures([what for what in EVERYTHING if result.gives(what)])
    metrics = {name: metric for name, metric in run_metrics().items() if name in known}
    names = {"ticks"} | {
        name
        for name, metric in metrics.items()
        if not (metric.own_run or metric.moving_hold_only) and (result.body.is_free or not metric.free_only)
    }
    if result.body.is_free or len(result.bodies) > 1:
        # No further run of the solver is of an object, or parts of it, that move.
        return names
    names.add("tracking_excess")
    hold = next((phase for phase in result.phases if phase.name == "hold"), None)
    if hold is not None and result.gives("forces") and result.gives("runs"):
        rows = slice(hold.first_tick, hold.last_tick + 1)
        haptic = [np.asarray(result[f"haptic/{name}"])[rows] for name in HandConfiguration._fields]
        if all(np.array_equal(values, np.broadcast_to(values[:1], values.shape)) for values in haptic):
            names |= {TREMBLING, f"{TREMBLING}_std"}
    return names


def input_hand_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge the summary's figures of the user's hand; none of a session or a stopped run."""
    result = judge.result
    if result.live is not None or not result.complete:
        return []
    return [_depth(judge), _correction(judge), _jumps(judge)]


def motion_claim(result: Result) -> Claim:
    """Judge that the ticks of one sample lie on one curve, or stand still.

    The curve is a cubic of each number, whose fourth differences are zero, and for a quaternion a steady turn.
    """
    name, says = "motion", "between two samples, the user's hand and the object go as samples are told to be joined"
    if result.live is not None:
        return Claim(name, says, NOT_JUDGED, note="a glove's samples are claims of their own")
    held = result.scene.get("samples") == "hold"
    seq, off = np.asarray(result["input_seq"]), np.full(result.ticks, np.nan)
    names = [f"haptic/{name}" for name in HandConfiguration._fields]
    if result.frame and not result.body.is_free:
        names += [f"{result.frame}/{column.name}" for column in POSE_COLUMNS]
    for column in names:
        rows = np.asarray(result[column]).reshape(result.ticks, -1)
        turns = column.endswith("orientation") and not held
        steps, order = (
            (np.nan_to_num(turn_between(rows[:-1], rows[1:]), nan=np.inf), 1) if turns else (rows, 1 if held else 4)
        )
        bent = np.abs(np.diff(steps, order, axis=0)).max(axis=1, initial=0.0)
        reach = result.ticks - len(bent)
        same = np.flatnonzero(seq[reach:] == seq[: len(bent)])
        off[same + reach] = np.fmax(off[same + reach], bent[same])
    known = np.flatnonzero(~np.isnan(off))
    if known.size == 0:
        note = "no sample has ticks enough to tell; --again makes the motion once more"
        return Claim(name, says, NOT_JUDGED, note=note)
    rest = result.ticks - len(known)
    note = f"not known of {counted(rest, 'tick')}, whose sample has too few" if rest else ""
    return judged(name, says, off[known], BETWEEN, "m, rad", "rounding of stamps", ticks=known, note=note)


def _depth(judge: JudgedTicks) -> Claim:
    if judge.on_mesh:
        return Claim(*INPUT_DEPTH, NOT_JUDGED, unit="m", note="inside a mesh the referee has no depth of its own")
    deepest, every = 0.0, np.arange(judge.result.ticks)
    for body in judged_bodies(judge.result, every):
        posed = body.seen(judge.wanted_posed, every)
        # Travel of the farthest joint or palm sphere to the next tick [m].
        joints = np.linalg.norm(np.diff(posed.joints, axis=0), axis=3).max(axis=(1, 2))
        moved = np.maximum(joints, np.linalg.norm(np.diff(posed.palm, axis=0), axis=2).max(axis=1))

        def depths(ticks: IntArray, posed: Posed = posed, body: JudgedBody = body) -> FloatArray:
            pairs = near_pairs(judge.hand, posed.at(ticks), body.pieces, judge.fingers, 0.0)
            return np.asarray(np.maximum(0.0, -pairs.nearest(len(ticks)).min(axis=1, keepdims=True)))

        deepest = search_deepest(moved[:, None], depths, deepest)
    off = abs(deepest - as_number(judge.result.summary.get(DEPTH)))
    return judged(*INPUT_DEPTH, [off], SEARCHED, "m", "as near as it is searched for")


def _jumps(judge: JudgedTicks) -> Claim:
    name, says = "jumps", "the shown hand goes beyond its user's from tick to tick as the summary says"
    if len(judge.result.bodies) > 1:
        return Claim(
            name, says, NOT_JUDGED, unit="m", note="beside several bodies the referee does not tell which move"
        )
    run = replace(ticks_alone(judge.result), hand=None, user=judge.wanted_posed.joints)
    stated = {name: as_number(value) for name, value in judge.result.summary.items() if name in JUMPS}
    off = difference(np.array([*stated.values()]), np.array([run_figure(name, run) for name in stated]))
    return judged(name, says, off, LENGTH, "m", WHY_LENGTH)


def _correction(judge: JudgedTicks) -> Claim:
    result, shown, wanted = judge.result, judge.shown_posed, judge.wanted_posed
    touch = np.asarray(result["contacts/touching"]) > 0
    for part in ("position", "orientation", "flexion", "abduction"):
        given = np.asarray(result[f"haptic/{part}"])
        touch &= np.isfinite(given).all(axis=tuple(range(1, given.ndim)))
    palm = np.sqrt(((shown.position - wanted.position)[touch] ** 2).sum(axis=1))
    joints = np.sqrt(((shown.joints - wanted.joints)[touch] ** 2).sum(axis=3)).reshape(len(palm), 20)
    found = np.array([palm.mean(), palm.max(), joints.mean(), joints.max()] if len(palm) else [np.nan] * 4)
    stated = np.array([as_number(result.summary.get(name, np.inf)) for name in CORRECTION])
    # Without contact there is no such figure.
    off = np.where(np.isnan(stated) & np.isnan(found), 0.0, np.abs(stated - found))
    return judged(*OFF_THE_USER, off, LENGTH, "m", WHY_LENGTH)

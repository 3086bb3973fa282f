"""Detection as of `evaluate` by the whole thread team: each finger and the palm is one item."""

from typing import Any

from hhsim.kernels.contact.detection import choose_gathers, evaluate_range, follow_motion, part_cost
from hhsim.kernels.contact.surface import Walk
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT, HandArrays
from hhsim.kernels.jit import Record, as_int64, jit, jit_once
from hhsim.kernels.parallel.thread_team import (
    NOTHING,
    PARTS,
    TASK_DISTANCES,
    await_done,
    item_done,
    post,
    sort_parts,
    take_item,
)


@jit_once
def worth_sharing(hand: HandArrays, needed: float, margin: float, skin: float, state: Record) -> bool:
    """Return True if the coming evaluation is long enough to share; its parts are then in order."""
    candidates, thread_team = state.candidates, state.thread_team
    follow_motion(hand, state.pose, candidates)
    choose_gathers(needed, margin, skin, candidates, state.work[:])
    thread_team.parts = 0
    total = 0
    for part in range(PARTS):
        cost = part_cost(part, candidates)
        # Without a pair and with slack to spare there is nothing to compute: `nearest` stays infinite.
        if cost > 0:
            thread_team.part[thread_team.parts] = part
            thread_team.cost[thread_team.parts] = cost
            thread_team.parts += 1
            total += cost
    sort_parts(thread_team, thread_team.parts)
    return total > 0 and total - thread_team.cost[0] >= thread_team.worth


@jit_once
def evaluate_in_parallel(hand: HandArrays, surface: Any, margin: float, skin: float, state: Record) -> int:
    """Evaluate the parts found by `worth_sharing`, bit for bit as `kernels.contact.detection.evaluate` does."""
    candidates, thread_team = state.candidates, state.thread_team
    for i in range(thread_team.parts):
        thread_team.status[i] = 0
        thread_team.work[i, :] = 0
    word = thread_team.word[:]
    post(word, as_int64(TASK_DISTANCES), thread_team.parts)
    walk = Walk(candidates.stack[:], candidates.scratch[:])
    evaluate_items(hand, surface, margin, skin, state, walk)
    await_done(word, thread_team.parts)
    status = 0
    for i in range(thread_team.parts):
        status |= thread_team.status[i]
        for j in range(thread_team.work.shape[1]):
            state.work[j] += thread_team.work[i, j]
    return status


@jit
def evaluate_items(hand: HandArrays, surface: Any, margin: float, skin: float, state: Record, walk: Walk) -> None:
    """Process items of the task TASK_DISTANCES until none is left, with the thread's own `walk`."""
    pose, candidates, thread_team = state.pose, state.candidates, state.thread_team
    word, counted = thread_team.word[:], thread_team.work[:]
    while True:
        item = take_item(word, as_int64(TASK_DISTANCES))
        if item == NOTHING:
            return
        part = thread_team.part[item]
        first = PHALANX_COUNT * part
        last = first + PHALANX_COUNT if part < FINGER_COUNT else first + 1
        thread_team.status[item] = evaluate_range(
            hand, pose, surface, margin, skin, first, last, candidates, walk, counted[item]
        )
        item_done(word)

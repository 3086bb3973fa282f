"""Detection by the whole crew: as `kernels.contact.evaluate`, each finger and the palm by whoever is free."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.contact.detection import evaluate_range, part_cost
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

Indices = NDArray[np.int64]


@jit_once
def worth_sharing(margin: float, skin: float, candidates: Record, crew: Record) -> bool:
    """Whether the coming evaluation is long enough to be shared; if so, its parts are put in order."""
    crew.parts = 0
    total = 0
    for part in range(PARTS):
        cost = part_cost(margin, skin, part, candidates)
        # Without a pair and with slack to spare there is nothing to compute: `nearest` stays infinite.
        if cost > 0:
            crew.part[crew.parts] = part
            crew.cost[crew.parts] = cost
            crew.parts += 1
            total += cost
    sort_parts(crew, crew.parts)
    return total > 0 and total - crew.cost[0] >= crew.worth


@jit_once
def evaluate_together(
    hand: HandArrays,
    pose: Record,
    surface: Any,
    margin: float,
    skin: float,
    candidates: Record,
    crew: Record,
    work: Indices,
) -> int:
    """As `kernels.contact.evaluate`, the same to the bit, of the parts that `worth_sharing` found."""
    for i in range(crew.parts):
        crew.status[i] = 0
        crew.work[i, :] = 0
    word = crew.word[:]
    post(word, as_int64(TASK_DISTANCES), crew.parts)
    evaluate_items(
        hand,
        pose,
        surface,
        margin,
        skin,
        candidates,
        crew,
        Walk(candidates.stack[:], candidates.scratch[:]),
        crew.work[:],
    )
    await_done(word, crew.parts)
    status = 0
    for i in range(crew.parts):
        status |= crew.status[i]
        for j in range(crew.work.shape[1]):
            work[j] += crew.work[i, j]
    return status


@jit
def evaluate_items(
    hand: HandArrays,
    pose: Record,
    surface: Any,
    margin: float,
    skin: float,
    candidates: Record,
    crew: Record,
    walk: Walk,
    counted: Indices,
) -> None:
    """Do items of the task TASK_DISTANCES until none is left; `walk` is the thread's own."""
    word = crew.word[:]
    while True:
        item = take_item(word, as_int64(TASK_DISTANCES))
        if item == NOTHING:
            return
        part = crew.part[item]
        first = PHALANX_COUNT * part
        last = first + PHALANX_COUNT if part < FINGER_COUNT else first + 1
        crew.status[item] = evaluate_range(
            hand, pose, surface, margin, skin, first, last, candidates, walk, counted[item]
        )
        item_done(word)

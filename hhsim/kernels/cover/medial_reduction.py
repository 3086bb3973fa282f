"""Few medial balls instead of many: the reductions of Bradshaw and O'Sullivan (2004), on a table of costs.

The cost of a piece of the surface under a ball with the centre c at the depth d is (distance of its farthest corner
from c) − d: so far the inner ball must be expanded to hold the piece, and no farther does it then stick out of the
solid. A reduction chooses balls and gives each piece to one of them; it is the better, the less the largest cost is.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.cover.inscribed_sphere import far_corner2
from hhsim.kernels.jit import as_int64, jit

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_BISECTIONS = 24
_POLISHES = 12


@jit
def piece_costs(corner: Array, members: Indices, center: Array, depth: Array, cost_out: Array) -> None:
    """Costs [m], shape (k, m), of pieces `members`, shape (m,), of `corner`, (M, 9) [m], under balls, (k, 3), (k,)."""
    for j in range(depth.shape[0]):
        x, y, z = center[j, 0], center[j, 1], center[j, 2]
        for i in range(members.shape[0]):
            cost_out[j, i] = math.sqrt(far_corner2(corner, members[i], x, y, z)) - depth[j]


@jit
def select(cost: Array, weight: Array, standoff: float, most: int, chosen_out: Indices) -> int:
    """Choose balls, expanded by the stand-off, that cover all pieces: again and again the one that covers most anew.

    Args:
        cost: [m], shape (k, m).
        weight: what each piece counts, positive, shape (m,).
        standoff: [m].
        most: balls.
        chosen_out: the balls, shape (most,).

    Returns:
        How many were chosen; most + 1 if that many do not suffice.
    """
    balls, pieces = cost.shape
    waiting = np.ones(pieces, np.bool_)
    gain = np.zeros(balls)
    for j in range(balls):
        for i in range(pieces):
            if cost[j, i] <= standoff:
                gain[j] += weight[i]
    left = pieces
    for count in range(most):
        best = 0
        for j in range(1, balls):
            if gain[j] > gain[best]:
                best = j
        covered = 0
        for i in range(pieces):
            if waiting[i] and cost[best, i] <= standoff:
                waiting[i] = False
                covered += 1
                for j in range(balls):
                    if cost[j, i] <= standoff:
                        gain[j] -= weight[i]
        if covered == 0:
            break
        chosen_out[count] = best
        left -= covered
        if left == 0:
            return count + 1
    return most + 1


@jit
def assign_pieces(cost: Array, chosen: Indices, owner_out: Indices) -> float:
    """Give each piece to the place in `chosen` of the ball under which it costs least; return the largest cost [m]."""
    worst = -np.inf
    for i in range(cost.shape[1]):
        owner_out[i] = 0
        for place in range(1, chosen.shape[0]):
            if cost[chosen[place], i] < cost[chosen[owner_out[i]], i]:
                owner_out[i] = place
        worst = max(worst, cost[chosen[owner_out[i]], i])
    return worst


@jit
def _badness(value: float, weight: float, so_far: float, by_sum: bool) -> float:
    """What pieces cost together with one more: the largest cost [m], or the sum of their weighted squares."""
    if by_sum:
        return so_far + weight * max(value, 0.0) ** 2
    return max(so_far, value)


@jit
def total_badness(cost: Array, weight: Array, chosen: Indices, owner: Indices, by_sum: bool) -> float:
    """What all pieces cost together under their balls."""
    total = 0.0 if by_sum else -np.inf
    for i in range(cost.shape[1]):
        total = _badness(cost[chosen[owner[i]], i], weight[i], total, by_sum)
    return total


@jit
def polish(cost: Array, weight: Array, by_sum: bool, chosen: Indices, owner_out: Indices) -> float:
    """Replace each ball by the best one for its pieces and assign them anew while that helps; `chosen` in place.

    Args:
        cost: [m], shape (k, m).
        weight: what each piece counts, positive, shape (m,).
        by_sum: whether the sum of the weighted squares of the costs is to fall, and not the largest.
        chosen: the balls, shape (n,).
        owner_out: the place in it of the ball of each piece, shape (m,).

    Returns:
        The sum, or the largest cost [m].
    """
    assign_pieces(cost, chosen, owner_out)
    total = total_badness(cost, weight, chosen, owner_out, by_sum)
    trial, trial_owner = chosen.copy(), owner_out.copy()
    for _ in range(_POLISHES):
        for place in range(chosen.shape[0]):
            least = np.inf
            for j in range(cost.shape[0]):
                own = 0.0 if by_sum else -np.inf
                pieces = 0
                for i in range(cost.shape[1]):
                    if owner_out[i] == place:
                        pieces += 1
                        own = _badness(cost[j, i], weight[i], own, by_sum)
                        if own >= least:
                            break
                # A ball without pieces stays where it is.
                if pieces > 0 and own < least:
                    least = own
                    trial[place] = j
        assign_pieces(cost, trial, trial_owner)
        reached = total_badness(cost, weight, trial, trial_owner, by_sum)
        if not reached < total:
            break
        total = reached
        chosen[:] = trial
        owner_out[:] = trial_owner
    return total


@jit
def expand(cost: Array, weight: Array, most: int, chosen_out: Indices) -> int:
    """Expand and select: the least stand-off at which `most` balls suffice; return how many were chosen.

    Args:
        cost: [m], shape (k, m).
        weight: what each piece counts, positive, shape (m,).
        most: balls.
        chosen_out: the balls, shape (most,).
    """
    low, high = np.inf, np.inf
    for i in range(cost.shape[1]):
        least = np.inf
        for j in range(cost.shape[0]):
            least = min(least, cost[j, i])
        low = least if low == np.inf else max(low, least)
    # Some ball alone covers everything at its largest cost.
    for j in range(cost.shape[0]):
        worst = -np.inf
        for i in range(cost.shape[1]):
            worst = max(worst, cost[j, i])
        high = min(high, worst)
    trial = np.empty_like(chosen_out)
    count = select(cost, weight, high, most, chosen_out)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        enough = select(cost, weight, middle, most, trial)
        if enough <= most:
            high, count = middle, enough
            chosen_out[:enough] = trial[:enough]
        else:
            low = middle
    return count


@jit
def merge(cost: Array, start: Indices, most: int, chosen_out: Indices) -> int:
    """Merge balls two by two, those first whose common ball costs least, until `most` are left.

    Args:
        cost: [m], shape (k, m).
        start: the balls to begin with, shape (n,).
        most: balls.
        chosen_out: the balls, shape (most,).

    Returns:
        How many are left.
    """
    balls, pieces = cost.shape
    count = start.shape[0]
    owner = np.empty(pieces, np.int64)
    assign_pieces(cost, start, owner)
    # What each ball would cost with the pieces of a group.
    group = np.full((count, balls), -np.inf)
    for j in range(balls):
        for i in range(pieces):
            group[owner[i], j] = max(group[owner[i], j], cost[j, i])
    price = np.full((count, count), np.inf)
    alive = np.ones(count, np.bool_)
    for p in range(count):
        for q in range(p):
            price[p, q] = _price(group, p, q)
    left = count
    while left > most:
        into, gone = as_int64(1), as_int64(0)
        for p in range(count):
            for q in range(p):
                if alive[p] and alive[q] and (price[p, q] < price[into, gone] or not (alive[into] and alive[gone])):
                    into, gone = p, q
        alive[gone] = False
        left -= 1
        for j in range(balls):
            group[into, j] = max(group[into, j], group[gone, j])
        for p in range(count):
            if alive[p] and p != into:
                price[max(p, into), min(p, into)] = _price(group, p, into)
    place = 0
    for p in range(count):
        if alive[p]:
            chosen_out[place] = np.argmin(group[p])
            place += 1
    return left


@jit
def _price(group: Array, p: int, q: int) -> float:
    """Cost of the best ball for the pieces of two groups [m]."""
    least = np.inf
    for j in range(group.shape[1]):
        least = min(least, max(group[p, j], group[q, j]))
    return float(least)


@jit
def burst(cost: Array, start: Indices, most: int, chosen_out: Indices) -> int:
    """Take away one ball after another, those first whose pieces cost the others least, until `most` are left.

    Arguments and result as of `merge`.
    """
    pieces = cost.shape[1]
    left = start.shape[0]
    chosen = start.copy()
    price = np.empty(left)
    while left > most:
        price[:left] = -np.inf
        for i in range(pieces):
            own, second, owner = np.inf, np.inf, 0
            for place in range(left):
                value = cost[chosen[place], i]
                if value < own:
                    own, second, owner = value, own, place
                elif value < second:
                    second = value
            price[owner] = max(price[owner], second)
        gone = np.argmin(price[:left])
        left -= 1
        for place in range(gone, left):
            chosen[place] = chosen[place + 1]
    chosen_out[:left] = chosen[:left]
    return left


@jit
def fill(cost: Array, weight: Array, chosen: Indices, count: int, owner_out: Indices) -> int:
    """Replace balls without pieces by those that take the most off the costs of all pieces together.

    Where eight balls leave the largest cost as it is, as on a cylinder's rims, they still are eight regions for the
    next level to begin with.

    Args:
        cost: [m], shape (k, m).
        weight: what each piece counts, positive, shape (m,).
        chosen: the balls, room for as many as there may be; in place.
        count: how many there are.
        owner_out: the place in it of the ball of each piece, shape (m,).

    Returns:
        How many there are; each has pieces.
    """
    while True:
        assign_pieces(cost, chosen[:count], owner_out)
        used = np.zeros(count, np.bool_)
        for i in range(cost.shape[1]):
            used[owner_out[i]] = True
        left = 0
        for place in range(count):
            if used[place]:
                chosen[left] = chosen[place]
                left += 1
        count = left
        assign_pieces(cost, chosen[:count], owner_out)
        if count == chosen.shape[0]:
            break
        best, most = -1, 0.0
        for j in range(cost.shape[0]):
            gain = 0.0
            for i in range(cost.shape[1]):
                gain += weight[i] * max(cost[chosen[owner_out[i]], i] - cost[j, i], 0.0)
            if gain > most:
                best, most = j, gain
        if best < 0:
            break
        chosen[count] = best
        count += 1
    return count


@jit
def reduce_balls(
    cost: Array, weight: Array, by_sum: bool, start_most: int, most: int, chosen_out: Indices, owner_out: Indices
) -> int:
    """Choose at most `most` balls for pieces by the best of merging, bursting, and expanding and selecting.

    Args:
        cost: [m], shape (k, m).
        weight: what each piece counts, positive, shape (m,).
        by_sum: which way is best: the one with the least sum of weighted squares of the costs, or the least largest.
        start_most: balls that merging and bursting begin with, more than `most`.
        most: balls.
        chosen_out: the balls, shape (most,).
        owner_out: the place in it of the ball of each piece, shape (m,).

    Returns:
        How many were chosen; some may have no piece.
    """
    trial, owner = np.empty(most, np.int64), np.empty_like(owner_out)
    start = np.empty(start_most, np.int64)
    many = expand(cost, weight, start_most, start)
    count, least = 0, np.inf
    for way in range(3):
        if way == 0:
            got = expand(cost, weight, most, trial)
        elif way == 1:
            got = merge(cost, start[:many], most, trial)
        else:
            got = burst(cost, start[:many], most, trial)
        polish(cost, weight, by_sum, trial[:got], owner)
        got = fill(cost, weight, trial, got, owner)
        reached = polish(cost, weight, by_sum, trial[:got], owner)
        if reached < least:
            least, count = reached, got
            chosen_out[:got] = trial[:got]
            owner_out[:] = owner
    return count


@jit
def assign_to_siblings(
    corner: Array,
    region: Indices,
    first_ball: Indices,
    center: Array,
    depth: Array,
    owner_out: Indices,
    cost_out: Array,
) -> None:
    """Give each piece to the ball of its region under which it costs least.

    Args:
        corner: a, b, c of the pieces [m], shape (M, 9).
        region: of each piece, shape (M,).
        first_ball: the balls of region g are first_ball[g] to first_ball[g + 1] − 1, shape (regions + 1,).
        center: ball centres [m], shape (balls, 3).
        depth: their depths [m], shape (balls,).
        owner_out: ball of each piece, shape (M,).
        cost_out: cost of each piece [m], shape (M,).
    """
    for i in range(region.shape[0]):
        cost_out[i] = np.inf
        for j in range(first_ball[region[i]], first_ball[region[i] + 1]):
            cost = math.sqrt(far_corner2(corner, i, center[j, 0], center[j, 1], center[j, 2])) - depth[j]
            if cost < cost_out[i]:
                cost_out[i], owner_out[i] = cost, j

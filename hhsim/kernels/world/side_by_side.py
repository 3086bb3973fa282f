"""Ticks of two hands beside bodies that stand still or move as recorded.

Each hand first makes its tick alone. If the two motions might have met, both are undone, and one program solves the
tick of both hands (`kernels.world.tick`), whose pairs' states are those of the hands.
"""

from hhsim.kernels.clock import monotonic_ns, thread_cpu_ns
from hhsim.kernels.contact.hand_pairs import CROSS, CROSS_SHARE, EXACT, MEASURE_PAIRS, ask_pairs
from hhsim.kernels.hand.kinematics import coarse_bounds
from hhsim.kernels.hand.pose import copy_configuration, step_between
from hhsim.kernels.jit import as_bool, as_int64, jit, jit_noinline
from hhsim.kernels.machine_code import call_code
from hhsim.kernels.memory import copy_values
from hhsim.kernels.parallel.thread_team import thread_team_cpu_ns
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.tick.block import HapticBlock, TickRecord, record_tick, set_haptic
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, STATUS_INPUT_INVALID, STATUS_NO_PLACE
from hhsim.kernels.world.columns import States
from hhsim.kernels.world.pairs import World
from hhsim.kernels.world.tick import MEASURE, TICK


@jit_noinline
def _may_have_met(method: World) -> bool:
    """Return whether the way of each hand's last tick might have led it nearer than the clearance to the other one.

    They are looked at where their motions may have used up the distance that they had when they were last.
    """
    states, options, pairs = method.states, method.options, method.world[0].hand_pairs
    for h in range(2):
        state = states[h]
        delta, abduction = state.step.delta[:], state.problem.abduction_step[:]
        step_between(state.pose, state.prediction.start, delta, abduction, state.scratch)
        pairs.least[CROSS] -= coarse_bounds(method.movers[h], delta, abduction, pairs.motion[h, CROSS])
    if pairs.least[CROSS] > options.offset:
        return False
    ask_pairs(options.pairs, MEASURE_PAIRS, options.offset, 0.0)
    return as_bool(ask_pairs(options.pairs, CROSS_SHARE, options.offset, 0.0) < 1.0)


@jit_noinline
def _tick_of_both(alone: tuple[World, World], method: World, parts_move: bool, qp: QpWork, code: int) -> None:
    """Make the tick of both hands as one of the world; the status bits are in it."""
    world, states, pairs = method.world[0], method.states, method.options.pairs
    if parts_move:
        world.hand_pairs.kept = 0.0
        ask_pairs(pairs, MEASURE_PAIRS, 0.0, 0.0)
        world.hand_pairs.kept = min(world.hand_pairs.least[CROSS], 0.0)
        ask_pairs(pairs, MEASURE_PAIRS, 0.0, 0.0)
    for h in range(2):
        state = states[h]
        copy_configuration(state.pose, state.prediction.start)
        state.prediction.is_predicted = False
        # Of a sample that is not finite the last good one counts.
        copy_values(state.haptic.position[:], world.palm_position[h])
        copy_values(state.haptic.orientation[:], world.palm_orientation[h])
    call_code(code, (method, qp, as_int64(TICK)))
    if world.hand_pairs.kept < 0.0:
        for h in range(2):
            world.status[h] |= STATUS_NO_PLACE
    near = method.options.margin
    ask_pairs(pairs, MEASURE_PAIRS, near, 0.0)
    world.is_near = world.hand_pairs.least[CROSS] < near
    for h in range(2):
        ask_pairs(alone[h].options.pairs, MEASURE_PAIRS, EXACT, 0.0)


@jit
def _cpu_of_both(states: States) -> int:
    """Compute the CPU time of the calling thread and of both hands' teams [ns]."""
    teams = thread_team_cpu_ns(states[0].thread_team) + thread_team_cpu_ns(states[1].thread_team)
    return as_int64(teams - thread_cpu_ns())


@jit_noinline
def _tick_alone(alone: World, qp: QpWork, code: int, i: int, haptic: HapticBlock, record: TickRecord) -> None:
    """Make a hand's own tick, and write its row of the record."""
    state, wall = alone.states[0], monotonic_ns()
    cpu = thread_team_cpu_ns(state.thread_team)
    status = set_haptic(alone.movers[0], haptic, i, state)
    call_code(code, (alone, qp, as_int64(TICK)))
    wall, cpu = monotonic_ns() - wall, thread_team_cpu_ns(state.thread_team) - cpu
    record_tick(state, status | alone.world[0].status[0], wall, cpu, i, record)


@jit
def run_hands_apart(
    alone: tuple[World, World],
    method: World,
    haptic: tuple[HapticBlock, HapticBlock],
    record: tuple[TickRecord, TickRecord],
    parts_move: bool,
    qp: QpWork,
    code: int,
) -> int:
    """Run one tick of two hands for each row of their haptic inputs, as `kernels.tick.block.run_block` does of one.

    `alone` has the method of each hand alone, `method` is that of both, in which parts that may move stand still. Where
    `parts_move` each hand gives way to them by its own tick first. A hand that they leave no place stays there.
    """
    world, states = method.world[0], method.states
    for i in range(haptic[0].position.shape[0]):
        start, cpu = monotonic_ns(), _cpu_of_both(states)
        by_itself = parts_move or not world.is_near
        for h in range(2):
            if by_itself:
                _tick_alone(alone[h], qp, code, as_int64(i), haptic[h], record[h])
            else:
                record[h].status[i] = set_haptic(method.movers[h], haptic[h], i, states[h])
        said = record[0].status[i] | record[1].status[i]
        looked = monotonic_ns()
        apart = by_itself and (said & STATUS_NO_PLACE != 0 or not _may_have_met(method))
        if apart:
            looked = monotonic_ns() - looked
            for h in range(2):
                record[h].duration_total[i] += looked
                # It waits for nothing, and to read the clock of CPU time takes as long.
                record[h].duration_cpu[i] += looked
            if said & STATUS_CAPACITY_EXCEEDED:
                return i + 1
            continue
        if by_itself:
            for h in range(2):
                copy_configuration(states[h].prediction.start, states[h].pose)
                record[h].status[i] &= STATUS_INPUT_INVALID
            call_code(code, (method, qp, as_int64(MEASURE)))
            world.hand_pairs.count = 0
        _tick_of_both(alone, method, parts_move, qp, code)
        wall, cpu = monotonic_ns() - start, _cpu_of_both(states) - cpu
        for h in range(2):
            record_tick(states[h], record[h].status[i] | world.status[h], wall, cpu, i, record[h])
        if (world.status[0] | world.status[1]) & STATUS_CAPACITY_EXCEEDED:
            return i + 1
    return int(haptic[0].position.shape[0])

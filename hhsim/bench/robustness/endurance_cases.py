"""Closed loops for minutes: a solver that drifts, or that grows, shows it."""

from collections.abc import Sequence

import numpy as np

from hhsim.bench.robustness.case import Figure, HardCase, HardRun, Outcome
from hhsim.bench.robustness.postures import HALF
from hhsim.bench.robustness.sphere_objects import coarse_ball, right_hand
from hhsim.bench.robustness.triangle_objects import coarse_ball_mesh
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.quaternion import quaternion
from hhsim.motion.analytic_motion import still

LOOP = 2000
DRIFT = 1e-9
"""A hand shows the same pose [m] at the same place of every loop."""
GROWTH = 1e6
"""Resident memory may grow by this [B] over the second half of a run: eight bytes lost in each tick of ten minutes,
in two runs, would be 1.2 MB there."""


def endurance_case(ticks: int) -> HardCase:
    """Closed loops for about so many ticks: through air and contact, and never leaving the object."""
    repeats = max(2, ticks // (2 * LOOP))
    return HardCase(
        "endurance",
        f"{2 * repeats * LOOP:,} ticks of closed loops: no drift, no growth",
        lambda seed: _loops(repeats),
        _judge,
    )


def _loops(repeats: int) -> Sequence[HardRun]:
    hand, tree, mesh = right_hand(), coarse_ball(), coarse_ball_mesh()
    above = still((0.0, -0.045, 0.12), flexion=HALF)
    pressed = still((0.0, -0.045, 0.055), flexion=np.full((5, 3), 0.6))
    around = _around(pressed, LOOP - 600)
    through_air = sequence(above.hold(49).line(pressed, 250), around).hold(60).line(above, 220).hold(20)
    contact = _around(pressed, LOOP - 100).hold(100)
    return [
        HardRun(
            "through air and contact",
            hand,
            tree,
            through_air,
            repeats=repeats,
            marks=(LOOP - 242, LOOP - 1),
            mesh=mesh,
        ),
        HardRun(
            "in contact all the time",
            hand,
            tree,
            contact,
            lead=above.line(pressed, 250).hold(50),
            repeats=repeats,
            marks=(LOOP - 1,),
            mesh=mesh,
        ),
    ]


def _around(pressed: HandConfiguration, ticks: int) -> HandConfiguration:
    # The palm goes round and tilts on the ball, and is back where it was.
    time = np.linspace(0.0, 1.0, ticks)[:, None]
    motion = HandConfiguration(*(np.repeat(values, ticks, axis=0) for values in pressed))
    wave = np.sin(2.0 * np.pi * time * [1.0, 2.0, 3.0])
    motion.position[:] += wave * [0.012, 0.01, 0.003]
    motion.orientation[:] = quaternion(wave[:, ::-1] * [0.1, 0.15, 0.2])
    motion.flexion[:] += (
        0.15
        * np.sin(6.0 * np.pi * time[:, :, None] + np.arange(15.0).reshape(5, 3))
        * (np.sin(np.pi * time)[:, :, None])
    )
    return motion


def _judge(outcomes: Sequence[Outcome]) -> Sequence[Figure]:
    figures = []
    for outcome in outcomes:
        # From the second loop on: the first one begins where nothing came before.
        drift = np.linalg.norm(outcome.marked[1:] - outcome.marked[1], axis=-1).max()
        figures.append(Figure(f"drift, {outcome.run.name}", float(drift), DRIFT, "m"))
        # Within a run: the next one has a solver of its own.
        memory = outcome.memory
        figures.append(
            Figure(f"growth of memory, {outcome.run.name}", float(memory[-1] - memory[len(memory) // 2]), GROWTH, "B")
        )
    return figures

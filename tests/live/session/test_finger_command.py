"""What the fingers are told: limits that hold whatever the solver gives, and nothing where it may not push."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.arrays import FloatArray
from hhsim.kernels.live.finger_command import update_command
from hhsim.live.device import FingerCommand
from hhsim.live.session.loop import commander_record
from hhsim.live.session.setup import OutputLimits
from hhsim.recordings.dexmo_regression import DexmoRegression
from hhsim.result.safety import Safety

PERIOD = 1e-3
NOBODY = np.zeros(5, np.int64)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
REGRESSION = DexmoRegression.default()
BEND_LINES = REGRESSION.bend_lines()
ROUNDING = 1e-12

numbers = st.one_of(st.floats(-10.0, 10.0), st.sampled_from([np.nan, np.inf, -np.inf, 1e300]))
limits = st.builds(
    OutputLimits,
    stiffness=st.tuples(*[st.floats(0.0, 1.0)] * 5),
    stiffness_rise=st.floats(0.1, 1000.0),
    bend_speed=st.floats(0.1, 1000.0),
    ramp=st.floats(0.0, 0.02),
    contact_force=st.floats(0.0, 1.0),
)


@dataclass
class Input:
    flexion: float
    force: float
    safety: int
    free: int


inputs = st.builds(
    Input,
    flexion=numbers,
    force=numbers,
    safety=st.one_of(st.just(0), st.just(0), st.sampled_from([int(bit) for bit in Safety])),
    free=st.one_of(st.just(-1), st.integers(0, 4)),
)


def fill(flexion: float, force: float) -> tuple[FloatArray, FloatArray]:
    return np.full((5, 3), flexion), np.full((5, 3, 3), force)


class FingerCommander:
    """Record of the commander with its command."""

    def __init__(self, limits: OutputLimits, lines: tuple[FloatArray, FloatArray] = BEND_LINES, **of: bool) -> None:
        self.at = commander_record(limits, lines, PERIOD, **of)[0]
        self.command = FingerCommand(self.at.bend, self.at.stiffness, self.at.phalanx)
        self.force = self.at.force


@settings(max_examples=200)
@given(limits, st.lists(inputs, min_size=1, max_size=40))
def test_no_input_breaks_the_limits(limits: OutputLimits, steps: list[Input]) -> None:
    stage = FingerCommander(limits)
    command = stage.command
    before, bend_before, begun, since = command.stiffness.copy(), None, False, 0
    for step in steps:
        kept_free = (np.arange(5) == step.free).astype(np.int64)
        safety = update_command(stage.at, *fill(step.flexion, step.force), LEVEL, step.safety, kept_free)
        assert np.isfinite(command.stiffness).all()
        assert np.isfinite(command.bend).all()
        assert ((command.bend >= 0.0) & (command.bend <= 1.0)).all()
        assert (command.stiffness <= np.array(limits.stiffness)).all()
        assert (command.stiffness <= before + limits.stiffness_rise * PERIOD + ROUNDING).all()
        assert safety & step.safety == step.safety
        if safety:
            assert (command.stiffness == 0.0).all()
            since = 0
        else:
            since += 1
            # The ramp, in ticks without a fault.
            most = np.array(limits.stiffness) * min(1.0, since * PERIOD / max(limits.ramp, PERIOD))
            assert (command.stiffness <= most + ROUNDING).all()
        assert (command.stiffness[kept_free == 1] == 0.0).all()
        # Each of three phalanges feels this along three axes. NaN compares false.
        if not 3.0 * np.sqrt(3.0) * abs(step.force) >= limits.contact_force - ROUNDING:
            assert (command.stiffness == 0.0).all()
        if begun and bend_before is not None:
            assert (np.abs(command.bend - bend_before) <= limits.bend_speed * PERIOD + ROUNDING).all()
        before, bend_before = command.stiffness.copy(), command.bend.copy()
        begun = begun or bool(np.isfinite(step.flexion) and abs(step.force) < 1e150)


@pytest.mark.parametrize("bit", list(Safety))
def test_every_safety_bit_frees_the_fingers_in_its_tick_and_the_ramp_follows(bit: Safety) -> None:
    stage = FingerCommander(OutputLimits(ramp=0.1, stiffness_rise=1e6))
    for _ in range(200):
        update_command(stage.at, *fill(0.5, 1.0), LEVEL, 0, NOBODY)
    assert (stage.command.stiffness == 0.3).all()
    assert update_command(stage.at, *fill(0.5, 1.0), LEVEL, int(bit), NOBODY) == bit
    assert (stage.command.stiffness == 0.0).all()
    for tick in range(1, 101):
        update_command(stage.at, *fill(0.5, 1.0), LEVEL, 0, NOBODY)
        np.testing.assert_allclose(stage.command.stiffness, 0.3 * tick / 100)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", ["flexion", "force"])
@pytest.mark.parametrize("finger", [0, 4])
def test_a_solver_that_is_not_finite_has_failed(bad: float, place: str, finger: int) -> None:
    stage = FingerCommander(OutputLimits(ramp=0.0))
    for _ in range(100):
        update_command(stage.at, *fill(0.5, 1.0), LEVEL, 0, NOBODY)
    bend = stage.command.bend.copy()
    flexion, force = fill(0.5, 1.0)
    (flexion if place == "flexion" else force)[finger, 2, ...] = bad
    assert update_command(stage.at, flexion, force, LEVEL, 0, NOBODY) == Safety.SOLVER_FAILED
    assert (stage.command.stiffness == 0.0).all()
    assert np.array_equal(stage.command.bend, bend)


def test_set_points_are_those_of_the_regression() -> None:
    random = np.random.default_rng(1)
    stage = FingerCommander(OutputLimits(bend_speed=1e6))
    for _ in range(100):
        flexion = random.uniform(-0.3, 2.0, (5, 3))
        update_command(stage.at, flexion, np.zeros((5, 3, 3)), LEVEL, 0, NOBODY)
        np.testing.assert_allclose(stage.command.bend, REGRESSION.bends(flexion), atol=1e-12)


def test_a_finger_whose_bend_means_nothing_is_told_zero() -> None:
    slope = REGRESSION.slope.copy()
    slope[3:6] = 0.0
    dead = DexmoRegression(REGRESSION.open, REGRESSION.closed, slope, REGRESSION.offset)
    stage = FingerCommander(OutputLimits(), dead.bend_lines())
    update_command(stage.at, *fill(0.5, 1.0), LEVEL, 0, NOBODY)
    assert stage.command.bend[1] == dead.bends(np.full((5, 3), 0.5))[1] == 0.0


def test_only_a_finger_that_carries_force_is_held() -> None:
    stage = FingerCommander(OutputLimits(ramp=0.0, stiffness_rise=1e6, contact_force=0.1))
    force = np.zeros((5, 3, 3))
    # Forces that are opposed are forces too.
    force[1, 0, 0], force[1, 1, 0] = 0.06, -0.06
    force[3, 2] = 0.05, 0.0, 0.0
    update_command(stage.at, np.zeros((5, 3)), force, LEVEL, 0, NOBODY)
    assert stage.command.stiffness.tolist() == [0.0, 0.3, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(stage.force, [0.0, 0.12, 0.0, 0.05, 0.0])
    update_command(stage.at, np.zeros((5, 3)), np.zeros((5, 3, 3)), LEVEL, 0, NOBODY)
    assert (stage.command.stiffness == 0.0).all(), "it falls at once"


def test_forces_are_in_the_palms_frame_and_come_and_go_with_the_stiffness() -> None:
    limits = OutputLimits(ramp=0.1, stiffness_rise=1e6)
    stage, numb = FingerCommander(limits, feels=True), FingerCommander(limits)
    force, kept_free = np.zeros((5, 3, 3)), (np.arange(5) == 4).astype(np.int64)
    force[0, 2], force[1, 0], force[4, 2] = (0.0, 0.0, 2.0), (1.0, 0.0, 0.0), (0.0, 0.0, 3.0)
    # A palm whose fingers (y) point to the world's -x: turned by 90° about z.
    turn = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    for tick in range(1, 121):
        for each in (stage, numb):
            update_command(each.at, np.zeros((5, 3)), force, turn, 0, kept_free)
        share = min(tick / 100, 1.0)
        np.testing.assert_allclose(stage.command.force[0, 2], [0.0, 0.0, 2.0 * share], atol=1e-12)
        np.testing.assert_allclose(stage.command.force[1, 0], [0.0, -share, 0.0], atol=1e-12)
    assert not stage.command.force[[2, 3, 4]].any(), "a finger that is kept free feels nothing"
    assert numb.command.stiffness.any()
    assert not numb.command.force.any(), "of a glove that takes none it stays 0"
    update_command(stage.at, np.zeros((5, 3)), force, turn, int(Safety.STALE_INPUT), kept_free)
    assert not stage.command.force.any(), "it falls at once"

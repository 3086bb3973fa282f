"""Block of the bench in MuJoCo, between two round fingertips and at rest, by several of MuJoCo's options.

Each fingertip is a ball on three position actuators of 1,000 N/m, critically damped, as a tracked hand is in an engine.
Squeeze, friction, mass and motion are those of the bench. The options are those of MuJoCo's documentation
("Computation", "XML Reference").
"""

from dataclasses import dataclass

import numpy as np

from hhsim.bench.manipulation.stage import QUIET, RATE, Pinch, Rest

TIP_MASS = 0.02
"""Mass of a fingertip [kg]."""


@dataclass(frozen=True)
class EngineOptions:
    """Options of MuJoCo: XML attributes of <option> and of every geom, and the steps of a tick of 1 ms."""

    option: str = ""
    contact: str = ""
    steps: int = 1


CONFIGURATIONS = {
    "mujoco, default": EngineOptions(),
    "mujoco, elliptic": EngineOptions('cone="elliptic" impratio="10"'),
    "mujoco, elliptic and noslip": EngineOptions('cone="elliptic" impratio="10" noslip_iterations="20"'),
    "mujoco, stiff": EngineOptions(
        'cone="elliptic" impratio="100" iterations="200" tolerance="1e-12"',
        'solref="0.0005 1" solimp="0.99 0.999 0.0001"',
        steps=4,
    ),
}
"""Default options, and those that the documentation recommends against slip."""


def mujoco_pinch(pinch: Pinch, options: EngineOptions) -> tuple[bool, float, float]:
    """Pinch, lift and hold in MuJoCo; return `Pinch.outcome` and the fingers' depth [m]; ImportError without it."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(_scene(pinch, options))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    times = np.arange(1, pinch.ticks + 1)
    way, inward = pinch.height_at(times), pinch.gap * pinch.closed_at(times) + pinch.squeeze_at(times) / pinch.stiffness
    height, depth = np.empty(pinch.ticks), 0.0
    for tick in range(pinch.ticks):
        data.ctrl[:] = [inward[tick], 0.0, way[tick], -inward[tick], 0.0, way[tick]]
        for _ in range(options.steps):
            mujoco.mj_step(model, data)
        height[tick] = data.qpos[2]
        touching = data.contact.geom.max(axis=1) > 1 if data.ncon else np.zeros(0, bool)
        if touching.any():
            depth = max(depth, -float(np.asarray(data.contact.dist)[touching].min()))
    return (*pinch.outcome(height - height[0]), depth)


def mujoco_rest(rest: Rest, options: EngineOptions) -> tuple[float, float]:
    """Return the creep of a cube on a table after `QUIET` ticks, and its largest depth [m]; ImportError without it."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(_scene(rest, options))
    data = mujoco.MjData(model)
    ticks = round(RATE * rest.seconds)
    center, orientation, depth = np.empty((ticks, 3)), np.empty((ticks, 4)), 0.0
    for tick in range(ticks):
        mujoco.mj_step(model, data, options.steps)
        center[tick], orientation[tick] = data.qpos[:3], data.qpos[3:7]
        if data.ncon:
            depth = max(depth, -float(data.contact.dist.min()))
    return rest.creep(center[QUIET:], orientation[[QUIET, -1]]), depth


def _scene(task: Pinch | Rest, options: EngineOptions) -> str:
    half = 0.5 * task.side
    fingers = _fingers(task) if isinstance(task, Pinch) else ("", "")
    return f"""
<mujoco>
  <option timestep="{1e-3 / options.steps}" gravity="0 0 -{task.gravity}" {options.option}/>
  <default><geom condim="4" friction="{task.friction} 0.005 0.0001" {options.contact}/></default>
  <worldbody>
    <geom type="plane" size="1 1 0.1"/>
    <body pos="0 0 {half}"><freejoint/><geom type="box" size="{half} {half} {half}" mass="{task.mass}"/></body>
    {fingers[0]}
  </worldbody>
  <actuator>{fingers[1]}</actuator>
</mujoco>"""


def _fingers(pinch: Pinch) -> tuple[str, str]:
    """Bodies of the fingertips, and their actuators."""
    half, radius = 0.5 * pinch.side, pinch.tip_radius
    tips = "".join(
        f'<body pos="{sign * (half + radius + pinch.gap)} 0 {half}">'
        + "".join(
            f'<joint name="{name}{axis}" type="slide" axis="{" ".join(str(int(axis == other)) for other in "xyz")}"/>'
            for axis in "xyz"
        )
        + f'<geom type="sphere" size="{radius}" mass="{TIP_MASS}"/></body>'
        for name, sign in (("left", -1), ("right", 1))
    )
    damping = 2.0 * np.sqrt(pinch.stiffness * TIP_MASS)
    actuators = "".join(
        f'<position joint="{name}{axis}" kp="{pinch.stiffness}" kv="{damping}"/>'
        for name in ("left", "right")
        for axis in "xyz"
    )
    return tips, actuators

"""MuJoCo-Warp: MuJoCo's model and settings, stepped by a recorded graph of kernels; one world on the CPU."""

from typing import Any, ClassVar

import numpy as np

from hhsim.engines.mujoco import Contacts, MuJoCo
from hhsim.engines.rigid_hand import lack_of
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.solver.outside_method import MethodScene
from hhsim.system.silent import silent

CONTACTS = 512
"""Capacity for contacts and candidate pairs; unused capacity costs time too."""
ROWS = 256
"""Capacity for constraints: a row each joint at its limit and each contact."""


class MuJoCoWarp(MuJoCo):
    """MuJoCo-Warp on the CPU, tuned, 4 sub-steps, the object in convex parts, phalanges as capsules."""

    missing: ClassVar[str] = lack_of("mujoco-warp", "mujoco", "warp", "mujoco_warp", "coacd")
    name: ClassVar[str] = "mujoco-warp"

    def __init__(self, scene: MethodScene) -> None:
        """Build the model, compile the kernels if they are not in Warp's cache, and record a tick's steps."""
        super().__init__(scene)
        with silent():
            import warp

            warp.config.log_level = warp.LOG_ERROR
            import mujoco_warp

            with warp.ScopedDevice("cpu"):
                self._record(warp, mujoco_warp)
        self._launch: Any = warp.capture_launch

    def _record(self, warp: Any, engine: Any) -> None:
        model = engine.put_model(self._model)
        model.opt.warn_overflow = 0
        data = engine.make_data(self._model, nconmax=CONTACTS, njmax=ROWS)
        # Kernels that are compiled during the recording would be missing from it.
        engine.step(model, data)
        with warp.ScopedCapture(device="cpu") as capture:
            for _ in range(self.tuning.steps):
                engine.step(model, data)
        self._graph = capture.graph
        # The arrays are the engine's own memory on the CPU, and the graph refers to this model and these data.
        self._kept = model, data
        inputs, state = (
            [(getattr(data, name).numpy()[0], getattr(self._data, name)) for name in names]
            for names in (("ctrl", "mocap_pos", "mocap_quat"), ("qpos", "qvel", "qacc_warmstart"))
        )
        self._inputs, self._state = [(model.body_quat.numpy()[0], self._model.body_quat), *inputs], state
        contact = data.contact
        self._full, self._count = data.overflow.numpy(), data.nacon.numpy()
        self._found = Contacts(
            contact.efc_address.numpy()[:, 0],
            contact.geom.numpy(),
            contact.frame.numpy()[:, 0],
            data.efc.force.numpy()[0],
        )

    def begin(self, pose: HandConfiguration) -> None:
        """Put the hand there, at rest."""
        super().begin(pose)
        for there, here in self._state:
            there[...] = here
        self._full[...] = 0

    def _step(self) -> None:
        for there, here in self._inputs:
            there[...] = here
        self._launch(self._graph)
        for there, here in self._state:
            here[...] = there
        if self._full.any():
            raise InputError(f"method {self.name} has more than {CONTACTS} near pairs or {ROWS} rows of constraints")

    def _contacts(self) -> Contacts:
        row, geom, normal, force = self._found
        count = int(self._count[0])
        return Contacts(row[:count], geom[:count], normal[:count].astype(np.float64), force)

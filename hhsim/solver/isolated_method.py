"""Methods from outside in a process of their own, for untrusted code.

The process imports the method, is given the scene, and answers each tick with plain numbers: nothing from it is
unpickled. Its death is a named error, and a tick that never ends can be interrupted.
"""

import json
import os
import pickle
import signal
import struct
import subprocess
import sys
from contextlib import suppress
from functools import cache
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from time import monotonic, perf_counter_ns
from typing import TYPE_CHECKING, Any
from weakref import finalize

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.solver.method_names import facts_of, outside_class
from hhsim.solver.outside_method import SHAPES, MethodHere, MethodScene, OutsideEngine, TickAnswer, checked_answer
from hhsim.system.deferred_sigint import interrupt_is_noted
from hhsim.system.foreign_call import Timed
from hhsim.system.posix import limit_as_child, process_cpu_ns

if TYPE_CHECKING:
    from hhsim.solver.workspace import TickWorkspace

SCENE, BEGIN, TICK, DONE, ERROR = b"s", b"b", b"t", b"d", b"e"
"""First byte of a message: the request, or the kind of the answer."""
TIMES = struct.Struct("<qqqq")
"""Header of a tick's answer: wall time, CPU time, the engine's own time as stated [ns], and the counted work."""
HAND, FORCES = 27, 48
"""Numbers of a hand, and of a tick's forces on 15 phalanges and the palm."""
LONGEST_MESSAGE = 100_000
"""Largest answer [bytes]."""
LONGEST_TEXT = 2_000
"""Longest error text [letters]."""
PATIENCE = 1.0
"""Time after Ctrl-C until the process of an unfinished tick is killed [s]."""
AT_FIRST, EACH_TICK = 1_000_000_000, 500_000
"""CPU time that the process may take beside twice its ticks [ns]: once, and for each tick."""
MEMORY_SHARE = 0.9
"""Share of the memory available at the start that the process may have."""


class IsolatedMethod:
    """A method, named as for `hhsim.solver.method_names.outside_class`, in a process that ends with this object.

    `facts` are those of its class, see `hhsim.solver.method_names.facts_of`. Raises InputError where it cannot be
    imported; so does each call where the method fails, its process ends, or its answer is no hand. KeyboardInterrupt:
    Ctrl-C was pressed and the method does not come to an end.
    """

    def __init__(self, name: str) -> None:
        self.name, self.ticks, self._counted = name, 0, 0
        self._link, theirs = Pipe()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", f"from {__name__} import serve; serve({theirs.fileno()}, {name!r})"],
            stdin=subprocess.DEVNULL,
            stdout=2,
            pass_fds=[theirs.fileno()],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,
        )
        theirs.close()
        self._end = finalize(self, _end, self._process, self._link)
        facts = json.loads(self._answer("while it was imported"))
        kinds = {"summary": str, "missing": str, "source": str, "forces": bool, "work": bool, "never_penetrates": bool}
        self.facts = {key: kind(facts.get(key, "")) for key, kind in kinds.items()}

    def make(self, scene: MethodScene) -> "IsolatedMethod":
        """Have the method made for a scene; return this object."""
        self._ask(SCENE + pickle.dumps(scene), "while it was made")
        return self

    def begin(self, pose: HandConfiguration) -> None:
        """See `hhsim.solver.outside_method.MethodRunner.begin`."""
        self._ask(BEGIN + _packed(pose), "in begin()")

    def tick(self, haptic: HandConfiguration) -> Timed:
        """See `hhsim.solver.outside_method.MethodRunner.tick`."""
        cpu, wall = self._cpu(), perf_counter_ns()
        answer = self._ask(TICK + _packed(haptic), f"in tick {self.ticks:,}")
        wall, cpu = perf_counter_ns() - wall, self._cpu() - cpu
        forces = self.facts["forces"]
        if len(answer) != TIMES.size + 8 * (HAND + FORCES * forces):
            raise InputError(f"method '{self.name}' answers with {len(answer):,} bytes (tick {self.ticks:,})")
        own_wall, own_cpu, native, work = TIMES.unpack_from(answer)
        self._counted = max(0, self._counted + cpu - 2 * own_cpu - EACH_TICK)
        if not (0 <= own_wall <= wall and 0 <= own_cpu <= cpu and self._counted <= AT_FIRST):
            stated, counted = f"{own_wall:,} ns and {own_cpu:,} ns of CPU time", f"{wall:,} ns and {cpu:,} ns"
            raise InputError(
                f"method '{self.name}' states {stated}, of {counted} that the system counted (tick {self.ticks:,})"
            )
        numbers = np.frombuffer(answer, np.float64, offset=TIMES.size)
        pose, push = _unpacked(numbers), numbers[HAND:]
        found = TickAnswer(pose, native_ns=native, work=work)
        if forces:
            found = found._replace(phalanx_force=push[:-3].reshape(5, 3, 3), palm_force=push[-3:])
        taken = Timed(found, own_wall, own_cpu)
        checked = checked_answer(self.name, self.ticks, taken, forces)
        self.ticks += 1
        return taken._replace(value=checked)

    def _ask(self, message: bytes, where: str) -> bytes:
        # What has ended has left its reason to be read, or none.
        with suppress(OSError):
            self._link.send_bytes(message)
        return self._answer(where)

    def _answer(self, where: str) -> bytes:
        try:
            noted = None
            while not self._link.poll(0.1):
                if interrupt_is_noted():
                    noted = monotonic() if noted is None else noted
                    if monotonic() - noted > PATIENCE:
                        raise KeyboardInterrupt
            message = self._link.recv_bytes(LONGEST_MESSAGE)
        except (EOFError, OSError):
            raise InputError(f"method '{self.name}' {self._how_it_ended()} {where}") from None
        except KeyboardInterrupt:
            self._end()
            raise
        if message[:1] != DONE:
            raise InputError(message[1:].decode("utf-8", "replace")[:LONGEST_TEXT])
        return message[1:]

    def _how_it_ended(self) -> str:
        try:
            code = self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._end()
            return "closed its connection"
        if code >= 0:
            return f"ended its process with exit code {code}"
        return f"died by signal {-code} ({signal.Signals(-code).name})"

    def _cpu(self) -> int:
        """CPU time of the process by the system's count [ns], which no code in it can change."""
        return process_cpu_ns(self._process.pid)


def _end(process: "subprocess.Popen[bytes]", link: Any) -> None:
    link.close()
    process.kill()
    process.wait()


_waiting: dict[str, IsolatedMethod] = {}
"""Processes that have stated their facts, for the first engine of each method."""


@cache
def isolated_facts(name: str) -> dict[str, Any]:
    """Return the facts of a method's class, asked in a process of its own; see `IsolatedMethod.facts`."""
    _waiting[name] = IsolatedMethod(name)
    return _waiting[name].facts


def isolated_engine(name: str, forces: bool, workspace: "TickWorkspace") -> OutsideEngine:
    """Return the engine of a method in a process of its own; errors as for `IsolatedMethod`."""
    process = _waiting.pop(name, None) or IsolatedMethod(name)
    return OutsideEngine(process.make, forces, workspace)


def _packed(pose: HandConfiguration) -> bytes:
    return np.concatenate([np.ravel(values) for values in pose]).tobytes()


def _unpacked(numbers: FloatArray) -> HandConfiguration:
    parts = np.split(numbers[:HAND], np.cumsum([np.prod(shape) for shape in SHAPES.values()])[:-1])
    return HandConfiguration(*(part.reshape(shape).copy() for part, shape in zip(parts, SHAPES.values())))


def serve(descriptor: int, name: str) -> None:
    """Run a method for the process at the other end of a connection, until that is closed."""
    limit_as_child(MEMORY_SHARE)
    link = Connection(descriptor)
    try:
        made = outside_class(name)
        facts = facts_of(made)
        forces = facts["forces"]
        link.send_bytes(DONE + json.dumps(facts).encode())
        scene = pickle.loads(link.recv_bytes()[1:])
        runner = MethodHere(name, made, forces, scene)
        link.send_bytes(DONE)
        while True:
            request = link.recv_bytes()
            pose = _unpacked(np.frombuffer(request, np.float64, offset=1))
            if request[:1] == BEGIN:
                runner.begin(pose)
                link.send_bytes(DONE)
                continue
            answer, wall, cpu = runner.tick(pose)
            push = [answer.phalanx_force.tobytes(), answer.palm_force.tobytes()] if forces else []
            link.send_bytes(
                b"".join([DONE, TIMES.pack(wall, cpu, answer.native_ns, answer.work), _packed(answer.pose), *push])
            )
    except EOFError:
        return
    except InputError as error:
        link.send_bytes(ERROR + str(error).encode()[:LONGEST_TEXT])

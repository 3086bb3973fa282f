"""A method in C++ behind `begin` and `tick`: a shared library, called by ctypes.

It is the method of ../project_out.py, and as poor: that says what it lacks. In this folder:

c++ -std=c++17 -O2 -shared -fPIC -o project_out.so project_out.cpp
hhsim methods check cpp_method:CppMethod
hhsim replay sphere grasp --method cpp_method:CppMethod
"""

import ctypes
import weakref
from pathlib import Path

import numpy as np

import hhsim

LIBRARY = Path(__file__).with_name("project_out.so")
NUMBERS = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
SHAPES = ((3,), (4,), (5, 3), (5,))


class CppMethod:
    """Shifts the whole hand out of the object's spheres, in C++."""

    gives_forces = True
    # While this is not "", hhsim prints it, and does not make the method.
    missing = "" if LIBRARY.exists() else "needs project_out.so: cpp_method.py says above how it is built"

    def __init__(self, scene: hhsim.MethodScene) -> None:
        """Hand over what the method is told before the first tick; C++ keeps a copy."""
        assert scene.tree is not None
        self.library, hand = ctypes.CDLL(str(LIBRARY)), scene.hand
        create, destroy = self.library.method_create, self.library.method_destroy
        create.argtypes = [NUMBERS, NUMBERS, ctypes.c_int, NUMBERS, ctypes.c_int, ctypes.c_double]
        create.restype, destroy.argtypes = ctypes.c_void_p, [ctypes.c_void_p]
        self.library.method_begin.argtypes = [ctypes.c_void_p, NUMBERS]
        self.library.method_joints.argtypes = [ctypes.c_void_p, NUMBERS, NUMBERS]
        self.library.method_tick.argtypes = [ctypes.c_void_p, NUMBERS, NUMBERS, NUMBERS]
        sizes = flat([hand.base, hand.distal, hand.dorsal, hand.length, hand.radius, np.array([hand.abduction_sign])])
        palm, body = (np.column_stack([one.leaf_center, one.leaf_radius]) for one in (hand.palm_tree, scene.tree))
        self.method = create(sizes, palm, len(palm), body, len(body), scene.options.stiffness.translation)
        weakref.finalize(self, destroy, self.method)

    def begin(self, pose: hhsim.HandConfiguration) -> None:
        """Go on from this free hand."""
        self.library.method_begin(self.method, flat(pose))

    def tick(self, haptic: hhsim.HandConfiguration) -> hhsim.TickAnswer:
        """Ask C++ where the shown hand goes."""
        shown, palm_force = np.empty(27), np.empty(3)
        self.library.method_tick(self.method, flat(haptic), shown, palm_force)
        parts = np.split(shown, np.cumsum([np.prod(shape) for shape in SHAPES])[:-1])
        pose = hhsim.HandConfiguration(*(part.reshape(shape) for part, shape in zip(parts, SHAPES)))
        return hhsim.TickAnswer(pose, np.zeros((5, 3, 3)), palm_force)

    def joints(self, pose: hhsim.HandConfiguration) -> np.ndarray:
        """Joint centres as hand_kinematics.hpp has them [m], world, shape (5, 4, 3): to hold against hhsim's."""
        found = np.empty((5, 4, 3))
        self.library.method_joints(self.method, flat(pose), found)
        return found


def flat(arrays) -> np.ndarray:
    """All numbers of some arrays in one."""
    return np.concatenate([np.ravel(array) for array in arrays])

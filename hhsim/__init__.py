"""hhsim: benchmark and trajectory replay for virtual-hand haptics.

Units are SI everywhere (m, rad, s, N, N·m); the world is right-handed with z up.
"""

__version__ = "0.1.0"

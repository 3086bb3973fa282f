"""Catalogue of the hard cases."""

from collections.abc import Sequence

from hhsim.bench.robustness.case import HardCase
from hhsim.bench.robustness.contact_cases import CONTACT_CASES
from hhsim.bench.robustness.input_cases import INPUT_CASES
from hhsim.bench.robustness.invariance_cases import INVARIANCE_CASES, endurance_case
from hhsim.bench.robustness.triangle_cases import TRIANGLE_CASES
from hhsim.errors import InputError, check_known

ENDURANCE_TICKS = 20_000
"""Ticks of the closed loops unless given; ten minutes at 1 kHz are 600,000."""


def hard_cases(
    names: Sequence[str] = (), ticks: int = ENDURANCE_TICKS, surfaces: Sequence[str] = ("spheres",)
) -> tuple[HardCase, ...]:
    """Return the cases of these names in the catalogue's order; without names all that the surfaces allow.

    Args:
        names: In kebab-case.
        ticks: Length of the case `endurance`.
        surfaces: Surfaces that are touched; without `mesh` there are no cases of triangles alone.

    Raises:
        UnknownNameError: No case of that name; the message lists the near ones.
        InputError: A named case needs the surface `mesh`.
    """
    cases = (*INPUT_CASES, *CONTACT_CASES, *INVARIANCE_CASES, endurance_case(ticks), *TRIANGLE_CASES)
    check_known("hard case", names, [case.name for case in cases])
    chosen = [case for case in cases if not names or case.name in names]
    left_out = [case.name for case in chosen if case.mesh_only and "mesh" not in surfaces]
    if names and left_out:
        raise InputError(f"hard case '{left_out[0]}' is made of triangles alone: it takes --surface mesh")
    return tuple(case for case in chosen if case.name not in left_out)

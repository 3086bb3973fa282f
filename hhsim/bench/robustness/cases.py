"""The catalogue of hard cases."""

from collections.abc import Sequence

from hhsim.bench.robustness.case import HardCase
from hhsim.bench.robustness.contact_cases import CONTACT_CASES
from hhsim.bench.robustness.endurance_cases import endurance_case
from hhsim.bench.robustness.input_cases import INPUT_CASES
from hhsim.bench.robustness.invariance_cases import INVARIANCE_CASES
from hhsim.errors import check_known

ENDURANCE_TICKS = 20_000
"""Of the closed loops, where nothing else is said; ten minutes at 1 kHz are 600,000."""


def hard_cases(names: Sequence[str] = (), ticks: int = ENDURANCE_TICKS) -> tuple[HardCase, ...]:
    """The cases of these names in the catalogue's order, all of them for none.

    Args:
        names: Kebab-case.
        ticks: How long the case `endurance` is.

    Raises:
        UnknownNameError: No case of that name; the message lists the near ones.
    """
    cases = (*INPUT_CASES, *CONTACT_CASES, *INVARIANCE_CASES, endurance_case(ticks))
    check_known("hard case", names, [case.name for case in cases])
    return tuple(case for case in cases if not names or case.name in names)

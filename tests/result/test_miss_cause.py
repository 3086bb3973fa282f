"""A missed period is named by what took most of the time, the best measured account first."""

import pytest

from hhsim.result.miss_cause import MissCause, TimeTaken

MS = 1_000_000


@pytest.mark.parametrize(
    ("computed", "kept", "run_delay", "steal", "device", "cause"),
    [
        (5 * MS, 0, 0, 0, 0, MissCause.COMPUTED),
        (5 * MS, MS, 0, 10 * MS, 0, MissCause.COMPUTED),
        (MS // 2, 4 * MS, 4 * MS, 0, 0, MissCause.WOKEN_LATE),
        (MS // 2, 4 * MS, 4 * MS, 10 * MS, 0, MissCause.WOKEN_LATE),
        (MS // 2, 4 * MS, 0, 0, 0, MissCause.WOKEN_LATE),
        (MS // 2, 4 * MS, 0, 10 * MS, 0, MissCause.HOST),
        (MS // 2, 4 * MS, MS, 10 * MS, 4 * MS, MissCause.HOST),
        (MS // 2, 40 * MS, 0, 10 * MS, 40 * MS, MissCause.DEVICE),
        (MS // 2, 4 * MS, 0, 0, 3 * MS, MissCause.DEVICE),
        (MS // 2, 4 * MS, 3 * MS, 0, 4 * MS, MissCause.WOKEN_LATE),
        # A device call that computes is the loop's own time.
        (5 * MS, 0, 0, 0, 5 * MS, MissCause.COMPUTED),
    ],
)
def test_the_cause_is_what_took_most(
    computed: int, kept: int, run_delay: int, steal: int, device: int, cause: MissCause
) -> None:
    assert TimeTaken(computed, kept, run_delay, steal, device).cause() is cause

"""Words of a session: a missed period is named by what took most of the time; reasons of free fingers are counted."""

import pytest

from hhsim.kernels.live.deadlines import cause_of
from hhsim.result.miss_cause import MissCause, TimeTaken
from hhsim.result.safety import Safety, free_counts

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
    assert cause_of(*TimeTaken(computed, kept, run_delay, steal, device)) == cause


def test_every_reason_is_counted_and_the_other_hand_s_only_where_there_was_one() -> None:
    counts = free_counts(lambda why: 7 if why is Safety.STOPPING else 0)
    assert counts.pop("STOPPING") == 7
    assert counts == {why.name: 0 for why in Safety if why not in (Safety.STOPPING, Safety.OTHER_HAND)}
    assert free_counts(lambda why: int(why is Safety.OTHER_HAND))["OTHER_HAND"] == 1

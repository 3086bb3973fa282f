"""Counts of ticks with free fingers, by reason."""

from hhsim.result.safety import Safety, free_counts


def test_every_reason_is_counted_and_the_other_hand_s_only_where_there_was_one() -> None:
    counts = free_counts(lambda why: 7 if why is Safety.STOPPING else 0)
    assert counts.pop("STOPPING") == 7
    assert counts == {why.name: 0 for why in Safety if why not in (Safety.STOPPING, Safety.OTHER_HAND)}
    assert free_counts(lambda why: int(why is Safety.OTHER_HAND))["OTHER_HAND"] == 1

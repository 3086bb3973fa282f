"""Contacts of a result: one table for all pairs, and the bodies of a pair as one hand counts them."""

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import AnyArray, IntArray
from hhsim.hand.fingers import FINGERS, PHALANX_NAMES
from hhsim.result.schema import CONTACT, HAND_BODIES, TABLE

if TYPE_CHECKING:
    from hhsim.result.reader import Result

ON_TABLE = -1
"""Code of the table as a hand counts bodies; -2 - k is the body of number k, touched by the first one."""


def contact_names(hands: Sequence[str], bodies: Sequence[str]) -> list[str]:
    """Names of contacts' bodies by code, as `a` and `b` have it: 16 bodies of each hand, the table, then the bodies."""
    of_hand = [*(f"{finger}/{phalanx}" for finger in FINGERS for phalanx in PHALANX_NAMES), "palm"]
    return [*(f"{hand}/{part}" for hand in hands for part in of_hand), TABLE, *bodies]


def pair_codes(body: IntArray, hands: int) -> dict[str, AnyArray]:
    """Return the columns `a` and `b` of /contact for contacts of the first body.

    `body` is what touches it, coded as in `Contacts` by the first of `hands` hands. `a` is the hand's body where a hand
    touches, else the first body.
    """
    table = HAND_BODIES * hands
    first = np.full(len(body), table + 1)
    return {"a": np.where(body >= 0, body, first), "b": np.where(body >= 0, first, table - 1 - body)}


class Contacts:
    """Columns of /contact by name; `body` is what touches the first body, as one hand counts.

    0 to 14 are its phalanges, finger by finger, 15 its palm, 16 to 31 those of the other hand; -1 is the table, -2 - k
    the body of number k.
    """

    def __init__(self, result: "Result") -> None:
        self._result = result

    def __getitem__(self, name: str) -> AnyArray:
        result = self._result
        if name != "body":
            return result[f"{CONTACT}/{name}"]
        hands = list(result.hands)
        table, own = HAND_BODIES * len(hands), HAND_BODIES * hands.index(result.name)
        a, b = (np.asarray(result[f"{CONTACT}/{column}"], np.int64) for column in ("a", "b"))
        return np.where(a < table, (a - own) % table, table - 1 - b)


def known_pairs(names: str, a: IntArray, b: IntArray, hands: Sequence[str], bodies: Sequence[str]) -> bool:
    """Return True if the codes of contacts are pairs of the first body with a hand, the table or another body."""
    table = HAND_BODIES * len(hands)
    of_hand = (a >= 0) & (a < table) & (b == table + 1)
    of_body = (a == table + 1) & (b >= table) & (b != table + 1) & (b <= table + len(bodies))
    return json.loads(names) == contact_names(hands, bodies) and bool((of_hand | of_body).all())

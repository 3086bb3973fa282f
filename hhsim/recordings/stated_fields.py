"""Fields that a file has beside its samples: which hand it is, its rate, its unit, and the order of its joints.

Names are read without capitals and punctuation, of nested ones the last part:

| names | hold |
|---|---|
| hand, side, handedness, hand_side | right or left, r or l, rhand or lhand: text or bytes, one, or one a sample |
| is_right, is_rhand, is_right_hand, is_left, is_lhand, is_left_hand | 1 or 0, true or false; the same |
| fps, rate, frame_rate, frequency, mocap_frame_rate, sample_rate, sampling_rate | samples a second [Hz] |
| unit, units, length_unit; scale | m, cm, mm or inch, in words too; or the metres in one of it |
| joint_names, joint_order | names of the joints of a row in their order, or mediapipe, mano, smplx, openxr, unity |

A field has no effect but where a reader takes it, and what is taken is told.
"""

import math
import re
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from hhsim.motion.trajectory import HandSide
from hhsim.recordings.joint_names import JOINT_ORDERS, KEYPOINTS, joint_name

TRUTHS = dict.fromkeys(("1", "1.0", "true"), "r") | dict.fromkeys(("0", "0.0", "false"), "l")
"""Side by a word for whether it is the right hand."""
UNITS = {1.0: ("m", "met"), 1e-2: ("cm", "centimet"), 1e-3: ("mm", "millimet"), 0.0254: ("inch", "inch")}
"""Word for a unit, and how a longer one begins, by its metres."""
_SIDE = re.compile(r"(r(?=ight|h|$)|l(?=eft|h|$))|(nan|none|$)")


class StatedFields:
    """Fields of a file by their kind: "side", "rate", "unit", "scale" or "order"; of two of a kind the first."""

    def __init__(self, held: Mapping[str, Any]) -> None:
        # Of each kind the value, and a sentence for when it is taken.
        self._fields: dict[str, tuple[Any, str]] = {}
        self._names: dict[str, str] = {}
        self._taken: set[str] = set()
        for name, values in held.items():
            if kind := kind_of(name):
                found = _PARSERS[kind](_key(name), _words(values)) if kind not in self._fields else None
                self._names[name] = "" if found is None else kind
                if found is not None:
                    self._fields[kind] = found[0], f"{found[1]}, as '{name}' says"

    def seen(self, kind: str) -> Any:
        """Return the value of a kind without taking it, None without any."""
        return self._fields.get(kind, (None, ""))[0]

    def take(self, kind: str) -> Any:
        """Return the value of a kind, None without any, and tell of it from now on."""
        self._taken.add(kind)
        return self.seen(kind)

    def hide(self, kind: str) -> None:
        """Leave out a kind that the format reads by itself: it is neither used nor told."""
        self._fields.pop(kind, None)
        self._names = {name: of for name, of in self._names.items() if of != kind}

    def told(self) -> list[str]:
        """Return a sentence on each field that was taken, and one that names the others."""
        left = [name for name, kind in self._names.items() if kind not in self._taken]
        said = [text for kind, (_, text) in self._fields.items() if kind in self._taken]
        return said + ([f"not used: {', '.join(left)}"] if left else [])


def kind_of(name: str) -> str:
    """Return the kind of the field of a name: "side", "rate", "unit", "scale" or "order"; "" for any other."""
    return _KINDS.get(_key(name), "")


def side_in(node: Mapping[str, Any]) -> HandSide:
    """Return the side that an object's own keys state, "" where they do not."""
    sides: tuple[HandSide, ...] = StatedFields({key: node[key] for key in node if kind_of(key)}).seen("side") or ("",)
    return sides[0] if len(sides) == 1 else ""


@lru_cache(maxsize=4096)
def _key(name: str) -> str:
    return re.sub("[^a-z]", "", re.split(r"[/.]", name)[-1].lower())


def _words(value: Any) -> list[str]:
    """Return a value, or those of a list, as words; none of anything nested."""
    try:
        array = np.asarray(value)
    except ValueError:
        return []
    is_list = array.size == max(array.shape, default=1) and array.dtype.kind != "O"
    entries = array.ravel().tolist() if is_list else []
    return [(each.decode("latin1") if isinstance(each, bytes) else str(each)).strip() for each in entries]


def _sides(key: str, words: list[str]) -> tuple[tuple[HandSide, ...], str] | None:
    """Return the side of all samples, or that of each, "" where it is missing."""
    if key.startswith("is"):
        truths = TRUTHS if key[2] == "r" else {word: "lr"[side == "l"] for word, side in TRUTHS.items()}
        words = [truths.get(word.lower(), word) for word in words]
    found = [_SIDE.match(re.sub("[^a-z]", "", word.lower())) for word in words]
    letters: dict[str | None, HandSide] = {"r": "right", "l": "left", None: ""}
    sides = tuple(letters[each[1]] for each in found if each)
    known = [side for side in letters.values() if side and side in sides]
    if len(sides) < len(words) or not known:
        return None
    return ((known[0],), f"{known[0]} hand") if len(known) == 1 else (sides, "right and left hands by turns")


def _rate(key: str, words: list[str]) -> tuple[float, str] | None:
    value = _number(words)
    return (value, f"{value:g} samples a second") if 0.1 <= value <= 1e5 else None


def _unit(key: str, words: list[str]) -> tuple[float, str] | None:
    """Return the unit [m]."""
    word = "".join(words).lower()
    value = next(
        (metre for metre, (unit, long) in UNITS.items() if word == unit or word.startswith(long)), _number(words)
    )
    unit = UNITS[value][0] if value in UNITS else f"{value:g} m"
    return (value, f"positions in {unit}") if 0.0 < value < math.inf else None


def _order(key: str, words: list[str]) -> tuple[tuple[str, ...], str] | None:
    """Return the joints of a row, "" for what is none of OpenXR's; None unless each of the 21 is there once."""
    names = re.split(r"[,;\s]+", words[0]) if len(words) == 1 else words
    joints = JOINT_ORDERS.get(names[0].lower() if names else "") or tuple(joint_name(name).joint for name in names)
    once = all(joints.count(joint) == 1 for joint in KEYPOINTS)
    return (joints, "joints in the order of the file") if once else None


def _number(words: list[str]) -> float:
    """Return the only word as a number, NaN for anything else."""
    try:
        return float(words[0]) if len(words) == 1 else math.nan
    except ValueError:
        return math.nan


_NAMES = {
    "side": "hand side handedness handside isright isrhand isrighthand isleft islhand islefthand",
    "rate": "fps rate framerate frequency mocapframerate samplerate samplingrate",
    "unit": "unit units lengthunit",
    "scale": "scale",
    "order": "jointnames jointorder",
}
_KINDS = {name: kind for kind, names in _NAMES.items() for name in names.split()}
_PARSERS: dict[str, Callable[[str, list[str]], tuple[Any, str] | None]] = {
    "side": _sides, "rate": _rate, "unit": _unit, "scale": _unit, "order": _order,
}  # fmt: skip

"""Labels of results in a report: a letter, and in few words what tells each from the others."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hhsim.hand.fingers import FINGERS
from hhsim.result.reader import Result
from hhsim.result.wording import cut, motion_name, object_name, option_value

UNNAMED = "method"
"""Label where a file does not say which method was run."""
STIFFNESS = ("translation", "rotation", "flexion")
"""Stiffnesses that the command line takes together."""


def result_labels(results: Sequence[Result]) -> list[str]:
    """Return a label for each result: its method and, where these differ, object, motion and options.

    Several results have letters. Options are named only among results of one object, motion and method, where they
    differ from what most of these have. Results that differ in nothing share a label but for their letters.
    """
    names = [(object_name(result), motion_name(result), result.method or UNNAMED) for result in results]
    if len(results) == 1:
        return [names[0][2]]
    varied = (*(len({name[part] for name in names}) > 1 for part in (0, 1)), True)
    groups: dict[tuple[str, str, str], list[int]] = {}
    for number, name in enumerate(names):
        groups.setdefault(name, []).append(number)
    labels = [" ".join(part for part, differs in zip(name, varied) if differs) for name in names]
    for members in groups.values():
        for number, words in zip(members, _telling([option_words(results[number]) for number in members])):
            labels[number] = ", ".join([labels[number], *words])
    return [f"{letter(number)}: {label}" for number, label in enumerate(labels)]


def letter(number: int) -> str:
    """Return the letters of a number: A, B, … Z, AA, AB, … for 0, 1, and so on."""
    rest, last = divmod(number, 26)
    return (letter(rest - 1) if rest else "") + chr(ord("A") + last)


def option_words(result: Result) -> dict[str, str]:
    """Return a result's options in words by their names."""
    scene = result.scene
    solver: Mapping[str, Any] = scene.get("solver", {})
    levels = result.static["object/tree/level"]
    hand = scene.get("hand", {})
    stiffness = solver.get("stiffness", {})
    words = {
        "kind": "live session" if result.live is not None else "replay",
        "level": f"level {int(levels.max(initial=0))}",
        "spheres": f"{int((levels == levels.max(initial=0)).sum()):,} spheres",
        "rate": f"{result.rate:g} Hz",
        "side": f"{hand.get('side', '')} hand",
        "length": f"hand {1e3 * float(hand.get('length', 0.0)):.0f} mm",
        "fingers": "all fingers" if len(result.fingers) == len(FINGERS) else " ".join(result.fingers) or "no finger",
        "coupling": "stiffness " + ", ".join(f"{stiffness[name]:g}" for name in STIFFNESS if name in stiffness),
    }
    words |= {f"stiffness {name}": f"{name} {value:g}" for name, value in stiffness.items() if name not in STIFFNESS}
    for name, value in sorted(solver.items()):
        if name not in ("method", "fingers", "stiffness"):
            words[name] = f"{name.replace('_', ' ')} {option_value(name, value)}"
    if scene.get("placement"):
        time, depth = (float(scene["placement"][name]) for name in ("time", "depth"))
        words["scene placement"] = f"placed at {time:.2f} s, {1e3 * depth:.1f} mm deep"
    for name in ("max_error", "tremor_mm_deg", "samples", "size_mm", "thickness_mm", "seed"):
        if scene.get(name) is not None:
            words[f"scene {name}"] = cut(f"{name.partition('_mm')[0].replace('_', ' ')} {scene[name]}")
    words["source"] = cut(Path(str(scene.get("trajectory") or "")).name)
    words["hhsim"] = f"hhsim {result.hhsim_version}"
    words["commit"] = f"commit {result.git_revision[:7]}"
    words["cpu"] = cut(str(result.machine.get("cpu", "")))
    return {name: word for name, word in words.items() if word}


CAUSED = {
    "spheres": ("level",),
    "scene max_error": ("level", "spheres"),
    "skin": ("surface",),
    "touch": ("surface",),
    "period": ("rate",),
    "budget": ("rate",),
    **{f"scene {name}": ("kind",) for name in ("samples", "placement", "seed", "size_mm", "thickness_mm")},
    "source": ("kind",),
}
"""Options that follow from others, and are left out where those differ."""
AROUND = ("source", "hhsim", "commit", "cpu")
"""Words for results that were run in the same way."""
MOST_WORDS = 3


def _telling(options: Sequence[dict[str, str]]) -> list[list[str]]:
    """Return of each result's options those that tell it from the others."""
    names = list(dict.fromkeys(name for one in options for name in one))
    differing = [name for name in names if len({one.get(name) for one in options}) > 1]
    told = [name for name in differing if not set(CAUSED.get(name, ())) & set(differing)]
    told = [name for name in told if name not in AROUND] or told
    found: list[list[str]] = [[] for _ in options]
    for name in told:
        ranked = Counter(one.get(name, "") for one in options).most_common()
        usual = ranked[0][0] if ranked[0][1] > ranked[1][1] else None
        for words, one in zip(found, options):
            if one.get(name) and one[name] != usual:
                words.append(one[name])
    return [words[:MOST_WORDS] for words in found]

from pathlib import Path

import pytest

from hhsim.errors import TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.tremor import Disturbance
from hhsim.scene.script import Script, ScriptPhase, parse_script, read_script

SMALL = """
[[phase]]
name = "approach"
duration = 0.5

[[phase]]
name = "touch"
duration = 0.25
"""


def parse(text: str) -> Script:
    return parse_script(text, name="mine", where="mine.toml")


def test_a_short_script_takes_the_documented_defaults() -> None:
    script = parse(SMALL)
    assert script.name == "mine"
    assert script.phases == (ScriptPhase("approach", 0.5), ScriptPhase("touch", 0.25, ("index",)))
    assert (script.rate, script.contact, script.depth, script.clearance) == (1000.0, True, 0.015, 0.005)
    assert (script.palm_gap, script.palm_depth, script.start_distance, script.curl) == (0.005, 0.0, 0.12, 1.0)
    assert script.disturbance == Disturbance()
    assert script.duration == 0.75
    assert script.sample_count == 750
    assert script.fingers == ("index",)


def test_every_key_is_read() -> None:
    script = parse(
        """
        title = "T"
        stresses = "S"
        rate = 200
        depth = 0.01
        clearance = 0.02
        palm_gap = 0.03
        palm_depth = 0.0
        start_distance = 0.2
        curl = 0.5
        phase = [
            { name = "approach", duration = 1 },
            { name = "pinch", duration = 0.3, fingers = ["middle", "thumb"] },
            { name = "grasp", duration = 0.3 },
            { name = "hold", duration = 0.3 },
            { name = "slide", duration = 0.3, distance = 0.03 },
            { name = "release", duration = 0.3 },
        ]
        [tremor]
        position = 1e-4
        rotation = 0.00349
        frequency = 9
        [sensor]
        counts = 4096
        noise = 0.001
        """
    )
    assert (script.title, script.stresses, script.rate, script.depth) == ("T", "S", 200.0, 0.01)
    assert (script.clearance, script.palm_gap, script.start_distance, script.curl) == (0.02, 0.03, 0.2, 0.5)
    assert [phase.name for phase in script.phases] == ["approach", "pinch", "grasp", "hold", "slide", "release"]
    assert script.phases[1].fingers == ("thumb", "middle")
    assert script.phases[2].fingers == FINGERS
    assert script.phases[4].distance == 0.03
    assert script.disturbance == Disturbance(1e-4, 0.00349, 9, 4096, 0.001)
    assert script.sample_count == 500


def phase(name: str, more: str = "") -> str:
    return f'\n[[phase]]\nname = "{name}"\nduration = 1\n{more}'


BAD = [
    ("title = ", "mine.toml: not TOML: "),
    ("", r"phase is missing; expected \[\[phase\]\] tables"),
    ("phase = 3", "phase = 3; expected"),
    ("phase = []", r"phase = \[\]; expected"),
    ("phase = [1]", r"phase\[1\] = 1; expected a table"),
    ("depht = 0.1\n" + SMALL, "unknown key 'depht': did you mean depth"),
    ("depth = '15 mm'\n" + SMALL, "depth = '15 mm'; expected a number from 0 to 0.1"),
    ("depth = 15\n" + SMALL, "depth = 15; expected a number from 0 to 0.1"),
    ("depth = nan\n" + SMALL, "depth = nan; expected a number"),
    ("rate = 0\n" + SMALL, "rate = 0; expected a number from 1 to 100000"),
    ("rate = true\n" + SMALL, "rate = True; expected a number"),
    ("title = 3\n" + SMALL, "title = 3; expected text"),
    ("contact = 1\n" + SMALL, "contact = 1; expected true or false"),
    ("contact = false\npalm_depth = 0.01\n" + SMALL, "palm_depth = 0.01 with contact = false"),
    (SMALL.replace("touch", "tuch"), r"phase\[2\].name: unknown name 'tuch': did you mean touch"),
    (SMALL.replace("touch", "hold"), "no phase closes a finger; expected touch, pinch, grasp, or contact = false"),
    (SMALL.replace("approach", "hold"), "the first phase is 'hold'; expected approach"),
    (SMALL.replace("0.25", "-1"), r"phase\[2\].duration = -1; expected a number from 0.001"),
    (SMALL.replace("duration = 0.25", ""), r"phase\[2\]: duration is missing"),
    (SMALL + "distance = 0.1", r"phase\[2\]: distance belongs to slide, carry, lift, shake, push"),
    (SMALL + "turn = 0.1", r"phase\[2\]: turn belongs to carry, turn"),
    (SMALL + "cycles = 2", r"phase\[2\]: cycles belongs to shake"),
    (SMALL.replace('"touch"', '"carry"'), r"phase\[2\]: distance is missing; a carry needs it"),
    (SMALL + phase("turn"), r"phase\[3\]: turn is missing"),
    (SMALL + phase("lift", "distance = 2"), r"phase\[3\]: distance = 2; expected a number from -1 to 1"),
    (SMALL + phase("shake", "distance = 0.1\ncycles = 0"), r"phase\[3\].cycles = 0; expected a number"),
    (SMALL + phase("carry", "distance = 1") + phase("slip"), "a carry and a slip; expected one of them in a script"),
    (SMALL + phase("slide", "distance = 0") + phase("push", "distance = 1"), "a slide and a push; expected one"),
    (SMALL + "speed = 0.1", r"phase\[2\]: unknown key 'speed'"),
    (SMALL + "fingers = ['indx']", r"phase\[2\].fingers\[1\]: unknown finger 'indx': did you mean index"),
    (SMALL + "fingers = 'index'", r"phase\[2\].fingers = 'index'; expected a list"),
    (SMALL + "fingers = []", r"phase\[2\].fingers = \[\]; expected a list"),
    (SMALL.replace("0.5", "0.5\nfingers = ['index']"), r"phase\[1\]: fingers belongs to touch, pinch, grasp"),
    (SMALL + "[[phase]]\nname = 'slide'\nduration = 1", r"phase\[3\]: distance is missing"),
    (SMALL + "[tremor]\nposition = 100.0", r"tremor_position = 100.0; expected a number from 0 to 0.1"),
    (SMALL + "[tremor]\nheight = 1", r"tremor: unknown key 'height'"),
    (SMALL + "[sensor]\ncounts = 0.5", "sensor_counts = 0.5; expected a whole number"),
    ("tremor = 1\n" + SMALL, r"tremor = 1; expected a table"),
    ("rate = 1e5\n" + SMALL.replace("0.25", "3600"), "360050000 samples; expected at most 10000000"),
]


@pytest.mark.parametrize(("text", "message"), BAD, ids=[message[:40] for _, message in BAD])
def test_bad_scripts_are_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(TrajectoryError, match=message) as caught:
        parse(text)
    assert str(caught.value).startswith("mine.toml: ")
    assert "\n" not in str(caught.value)


def test_a_script_file_is_read_by_its_stem_and_named_in_errors(tmp_path: Path) -> None:
    path = tmp_path / "poke.toml"
    path.write_text(SMALL, encoding="utf-8")
    assert read_script(path).name == "poke"
    path.write_text("depth = 7\n" + SMALL, encoding="utf-8")
    with pytest.raises(TrajectoryError, match=r"poke.toml: depth = 7"):
        read_script(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(TrajectoryError, match="not a text file"):
        read_script(path)
    with pytest.raises(TrajectoryError, match="no such file"):
        read_script(tmp_path / "none.toml")
    with pytest.raises(TrajectoryError, match="cannot be read: Is a directory"):
        read_script(tmp_path)

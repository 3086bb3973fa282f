"""The TOML files of an import, damaged at random: each is refused in one line, or means something."""

import random
from collections.abc import Callable
from pathlib import Path

import pytest
from column_map_sample import GLOVE, TABLE
from recording_samples import read_as

from hhsim.errors import HhsimError
from hhsim.recordings.column_map import ColumnMap
from hhsim.recordings.dexmo_regression import CHANNELS, DexmoRegression, format_calibration, parse_calibration
from hhsim.recordings.repair import repair
from hhsim.scene.demonstration import parse_demonstration
from hhsim.system.settings_file import parse_settings

VALUES = ["", "[]", "{}", "3", "-1e400", "nan", "inf", "'x'", "true", "[1, 2]", "1979-05-27", "[[joint]]", "=", '"']


def map_columns(text: str) -> None:
    repair(read_as("csv", TABLE, columns=parse_settings(text, ColumnMap, "m.toml")))


def calibrate(text: str) -> None:
    parse_calibration(text, where="m.toml").angles([0.5] * len(CHANNELS))


def demonstrate(text: str) -> None:
    folder = Path(__file__).resolve().parents[2] / "trajectories"
    parse_demonstration(text, name="tap", folder=folder, where="m.toml")


TEXTS: dict[str, tuple[Callable[[str], None], str]] = {
    "columns": (map_columns, GLOVE),
    "calibration": (calibrate, format_calibration(DexmoRegression.default())),
    "demonstration": (
        demonstrate,
        'recording = "finger-tap.h5"\ntitle = "t"\n\n[touch]\nfinger = "index"\ndepth = 0.01\n',
    ),
}


@pytest.mark.parametrize("kind", TEXTS)
def test_damaged_toml_is_refused_in_one_line(kind: str) -> None:
    use, text = TEXTS[kind]
    use(text)
    source, words, refused = random.Random(9), text.split(" "), 0
    for _ in range(150):
        some = list(words)
        for _ in range(source.randint(1, 3)):
            some[source.randrange(len(some))] = source.choice([*VALUES, source.choice(words)])
        try:
            use(" ".join(some)[: source.choice([10**9, source.randrange(1, len(text))])])
        except HhsimError as error:
            refused += 1
            assert "\n" not in str(error) and len(str(error)) < 500, error
    assert refused > 75

"""Every format reads its tiny file as the golden one has it: numbers, flags and every word that is told."""

from pathlib import Path

import numpy as np
import pytest
from recorded_files import CASES, GOLDEN, imported

from hhsim.recordings.formats import FORMATS


def test_every_format_has_a_case() -> None:
    assert {name.partition(",")[0] for name in CASES} == set(FORMATS.names())


@pytest.mark.parametrize("name", CASES)
def test_an_import_gives_what_it_gave(name: str, tmp_path: Path) -> None:
    found = imported(CASES[name], tmp_path)
    with np.load(GOLDEN) as held:
        golden = {key.removeprefix(f"{name}/"): held[key] for key in held.files if key.startswith(f"{name}/")}
    assert set(found) == set(golden)
    assert str(found.pop("said")) == str(golden.pop("said"))
    for key, values in golden.items():
        np.testing.assert_allclose(found[key], values, rtol=0.0, atol=1e-12, err_msg=key)

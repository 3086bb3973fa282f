"""Ways in which files go wrong whose form is known, at random: values of HDF5 files, words of TOML documents."""

import io
import re
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from recording_damage import Random, block

NUMBERS = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-320, 1e300, -1e300, 2.0**63, 2.0**31, 1e9, 0.5)
WHOLE = (0, -1, 1, 2**31 - 1, -(2**31), 2**62, -(2**62), 255, 1000)
TEXTS = ("", "{}", "[]", "null", "NaN", "1e999", "{", '{"hand": 3}', "right", "mesh", "x" * 5_000, "\ud7ff")


def damaged_hdf5(data: bytes, random: Random) -> bytes:
    """An HDF5 file of which one to three objects or attributes have other values, another shape, or are gone."""
    image = io.BytesIO(data)
    with h5py.File(image, "r+") as file:
        for _ in range(random.integers(1, 4)):
            items = objects(file)
            datasets = [item for item in items if isinstance(item, h5py.Dataset)]
            with_attributes = [item for item in (file, *items) if len(item.attrs)]
            kind = random.integers(0, 10)
            if kind < 6:
                _change_values(file, datasets[random.integers(len(datasets))], random)
            elif kind < 9:
                # The file's own attributes say more than the units of its datasets.
                item = file if random.random() < 0.5 else with_attributes[random.integers(len(with_attributes))]
                _change_attribute(item, random)
            else:
                del file[items[random.integers(len(items))].name]
    return image.getvalue()


def objects(file: h5py.File) -> list[Any]:
    found: list[Any] = []
    file.visititems(lambda _, item: found.append(item))
    return found


def _change_values(file: h5py.File, dataset: Any, random: Random) -> None:
    values = dataset[()]
    kind = random.integers(0, 6)
    if kind < 4 and isinstance(values, np.ndarray) and values.size and values.dtype.kind in "fiu":
        part = values.reshape(len(values), -1)[block(len(values), random, most=1.0)]
        column = slice(None) if random.random() < 0.5 else int(random.integers(part.shape[1]))
        whole = [number for number in WHOLE if np.can_cast(np.min_scalar_type(number), values.dtype)]
        pool = NUMBERS if values.dtype.kind == "f" else whole
        if kind == 3 and values.dtype.kind == "f":
            part[:, column] *= random.choice([-1.0, 1e-6, 1e3, 1e6])
        else:
            part[:, column] = pool[random.integers(len(pool))]
        dataset[...] = values
        return
    other: NDArray[Any]
    array = np.atleast_1d(values)
    if kind == 4 and len(array):
        other = array[: random.integers(len(array))]
    elif kind == 5 and len(array):
        other = np.concatenate([array, array[block(len(array), random)]])
    else:
        other = array.astype("S8") if array.dtype.kind in "fiu" else np.zeros(3)
    name, attributes = dataset.name, dict(dataset.attrs)
    del file[name]
    file[name] = other
    file[name].attrs.update(attributes)


def _change_attribute(item: Any, random: Random) -> None:
    name = list(item.attrs)[random.integers(len(item.attrs))]
    value = item.attrs[name]
    if random.random() < 0.1:
        del item.attrs[name]
    elif isinstance(value, str) and random.random() < 0.7:
        item.attrs[name] = _other_text(value, random)
    else:
        pool = (*NUMBERS, *WHOLE, *TEXTS[:-1])
        item.attrs[name] = pool[random.integers(len(pool))]


def _other_text(text: str, random: Random) -> str:
    """Another text; of a JSON document, often one with another value in it."""
    if text.startswith(("{", "[")) and random.random() < 0.7:
        return _other_word(text, random, r'(?<=[:\[,] )("[^"]*"|-?\d[\d.e+-]*|true|false|null|\{\}|\[\])', JSON_VALUES)
    return TEXTS[random.integers(len(TEXTS) - 2)]


JSON_VALUES = ("NaN", "-1", "0", "1e300", "1e-320", "99999999999999999999999", '"x"', "null", "true", "[]", "{}", "2.5")
TOML_VALUES = ("nan", "-1", "0", "1e300", "1e-320", "99999999999999999999999", '"x"', "inf", "true", "[]", "{}", "2.5")


def damaged_toml(data: bytes, random: Random) -> bytes:
    """A TOML document with another value in it, or a line lost, doubled or moved."""
    text = data.decode()
    kind = random.integers(0, 6)
    if kind < 4:
        return _other_word(text, random, r'("[^"\n]*"|(?<![\w.])-?\d[\d.e+-]*|true|false)', TOML_VALUES).encode()
    lines = text.split("\n")
    place, other = random.integers(0, len(lines), 2)
    line = lines[place]
    if kind == 4:
        del lines[place]
    lines.insert(int(other), line if kind == 5 else "")
    return "\n".join(lines).encode()


def _other_word(text: str, random: Random, pattern: str, values: tuple[str, ...]) -> str:
    found = list(re.finditer(pattern, text))
    if not found:
        return text[: random.integers(len(text) + 1)]
    word = found[random.integers(len(found))]
    return text[: word.start()] + values[random.integers(len(values))] + text[word.end() :]

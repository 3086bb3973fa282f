"""Ways in which a recording goes wrong, at random: of its samples, and of the bytes of its file."""

from collections.abc import Callable
from dataclasses import replace
from functools import wraps

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.recordings.recording import MOTION, Recording

Random = np.random.Generator
Damage = Callable[[Recording, Random], Recording]


def block(count: int, random: Random, least: int = 1, most: float = 0.3) -> slice:
    """A run of samples, at most a share of all."""
    size = int(random.integers(least, max(least + 1, int(most * count))))
    first = int(random.integers(0, max(1, count - size)))
    return slice(first, first + size)


def of(key: str = "") -> Callable[[Callable[[FloatArray, Random], None]], Damage]:
    """A damage to the values of a field, or of any of a motion, in place."""

    def made(change: Callable[[FloatArray, Random], None]) -> Damage:
        @wraps(change)
        def damage(recording: Recording, random: Random) -> Recording:
            name = key or str(random.choice(MOTION))
            values = getattr(recording, name).copy()
            change(values, random)
            return replace(recording, **{name: values})

        return damage

    return made


@of()
def holes(values: FloatArray, random: Random) -> None:
    value = random.choice([np.nan, np.inf, -np.inf])
    part = values[block(len(values), random)]
    if random.random() < 0.5:
        part[:] = value
    else:
        part.reshape(len(part), -1)[:, random.integers(0, part[0].size)] = value


@of("orientation")
def broken_quaternions(values: FloatArray, random: Random) -> None:
    part = values[block(len(values), random, most=0.05)]
    part[:] = random.normal(size=part.shape)


@of("time")
def repeated_stamps(values: FloatArray, random: Random) -> None:
    part = values[block(len(values), random, least=2)]
    part[:] = part[0]


@of("time")
def swapped_stamps(values: FloatArray, random: Random) -> None:
    i, j = random.integers(0, len(values), 2)
    values[[i, j]] = values[[j, i]]


@of("time")
def wild_stamps(values: FloatArray, random: Random) -> None:
    chosen = random.integers(0, len(values), random.integers(1, 6))
    values[chosen] = random.choice([np.nan, 1e9, -1e9, 0.0, float(values[-1] + 40.0)])


def shuffled_rows(recording: Recording, random: Random) -> Recording:
    """With their stamps: nothing is lost."""
    index = np.arange(recording.sample_count)
    part = block(len(index), random, least=2, most=1.0)
    index[part] = random.permutation(index[part])
    return recording.chosen(index)


def shuffled_values(recording: Recording, random: Random) -> Recording:
    """Without their stamps: the order is lost."""
    return replace(shuffled_rows(recording, random), time=recording.time)


@of("time")
def two_recordings(values: FloatArray, random: Random) -> None:
    half = len(values) // 2
    values[half:] = values[: len(values) - half].copy()


def lost_rows(recording: Recording, random: Random) -> Recording:
    index = np.arange(recording.sample_count)
    return recording.chosen(np.delete(index, block(len(index), random)))


@of("position")
def millimetres(values: FloatArray, random: Random) -> None:
    values *= random.choice([1e3, 1e2, 1.0 / 0.0254])


def degrees(recording: Recording, random: Random) -> Recording:
    return recording.with_angles(np.degrees(recording.angles))


@of("flexion")
def one_finger_in_degrees(values: FloatArray, random: Random) -> None:
    values[:, random.integers(0, 5)] *= 180.0 / np.pi


@of("time")
def other_clock(values: FloatArray, random: Random) -> None:
    values *= random.choice([1e3, 1e6, 1e9, 60.0, 1e-3, 1e-6])


@of("position")
def position_spikes(values: FloatArray, random: Random) -> None:
    for _ in range(random.integers(1, 4)):
        part = values[block(len(values), random, most=0.03)]
        part += random.normal(size=3) * random.choice([0.1, 0.5, 5.0, 500.0])


@of("position")
def noise_burst(values: FloatArray, random: Random) -> None:
    part = values[block(len(values), random, least=8)]
    part += random.normal(size=part.shape) * random.uniform(0.05, 0.3)


def frozen(recording: Recording, random: Random) -> Recording:
    index = np.arange(recording.sample_count)
    part = block(len(index), random, least=6)
    index[part] = part.start
    return replace(recording.chosen(index), time=recording.time)


@of("position")
def displaced_block(values: FloatArray, random: Random) -> None:
    values[block(len(values), random, least=2)] += random.choice([-1.0, 1.0]) * random.uniform(0.5, 3.0)


DAMAGES: tuple[Damage, ...] = (
    holes, broken_quaternions, repeated_stamps, swapped_stamps, wild_stamps, shuffled_rows, shuffled_values,
    two_recordings, lost_rows, millimetres, degrees, one_finger_in_degrees, other_clock, position_spikes, noise_burst,
    frozen, displaced_block,
)  # fmt: skip


def damaged_bytes(data: bytes, random: Random) -> bytes:
    """A file whose bytes were cut, overwritten, lost, doubled or mixed up."""
    kind = random.integers(0, 8)
    size = len(data)
    if kind == 0:
        return data[: random.integers(0, size)]
    out = bytearray(data)
    if kind == 1:
        for place in random.integers(0, size, random.integers(1, 20)):
            out[place] = random.integers(0, 256)
    elif kind == 2:
        for place in random.integers(0, size, random.integers(1, 5)):
            out[place] ^= 1 << random.integers(0, 8)
    else:
        first = int(random.integers(0, size))
        length = int(random.integers(1, max(2, size // 10)))
        part = bytes(out[first : first + length])
        if kind == 3:
            del out[first : first + length]
        elif kind == 4:
            out[first:first] = part
        elif kind == 5:
            out[first : first + length] = bytes(len(part))
        elif kind == 6:
            out[first : first + length] = random.bytes(len(part))
        else:
            lines = bytes(out).split(b"\n")
            random.shuffle(lines)
            return b"\n".join(lines)
    return bytes(out)

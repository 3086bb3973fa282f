"""Decompression of LZ-string's base64 letters, in which published Leap Motion recordings are.

LZ-string is an LZ78 whose codes are as wide as the dictionary needs, least bit first; codes 0 and 1 announce a new
letter of 8 or 16 bits, code 2 the end.
"""

from hhsim.errors import TrajectoryError

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
MOST_LETTERS = 1 << 28
"""Longest text; a damaged file may grow for ever."""


def unpack(text: str) -> str:
    """Decompress text; raise TrajectoryError for other letters, or for one that is damaged or cut short."""
    letters = "".join(text.split()).rstrip("=")
    if other := set(letters) - set(LETTERS):
        raise TrajectoryError(f"not LZ-string text: it holds {min(other)!r}; expected base64 letters")
    six = {letter: f"{value:06b}" for value, letter in enumerate(LETTERS)}
    bits, place = "".join(map(six.__getitem__, letters)), 0

    def number(width: int) -> int:
        nonlocal place
        place += width
        if place > len(bits):
            raise TrajectoryError("LZ-string text that ends too early; was it cut short?")
        return int(bits[place - width : place][::-1], 2)

    code = number(2)
    if code == 2:
        return ""
    if code == 3:
        raise TrajectoryError("damaged LZ-string text at its first letter")
    word = chr(number(8 if code == 0 else 16))
    # Codes 0 to 2 are no words.
    words: list[str] = ["", "", "", word]
    out = [word]
    width, left, length = 3, 4, 1
    while True:
        code = number(width)
        if code == 2:
            return "".join(out)
        if code < 2:
            words.append(chr(number(8 if code == 0 else 16)))
            code = len(words) - 1
            left -= 1
            if left == 0:
                left, width = 1 << width, width + 1
        if code > len(words):
            raise TrajectoryError(f"damaged LZ-string text: code {code} of {len(words)} words")
        entry = words[code] if code < len(words) else word + word[0]
        out.append(entry)
        length += len(entry)
        if length > MOST_LETTERS:
            raise TrajectoryError("damaged LZ-string text: it grows beyond 250 million letters")
        words.append(word + entry[0])
        word = entry
        left -= 1
        if left == 0:
            left, width = 1 << width, width + 1

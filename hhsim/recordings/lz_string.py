"""Decompression of LZ-string's base64 letters, in which published Leap Motion recordings are.

LZ-string is an LZ78 whose codes are as wide as the dictionary needs, least bit first; codes 0 and 1 announce a new
letter of 8 or 16 bits, code 2 the end.
"""

from hhsim.errors import TrajectoryError

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
MOST_LETTERS = 1 << 28
"""Longest text; a damaged file may grow for ever."""
_VALUE = {letter: value for value, letter in enumerate(LETTERS)}


class _Bits:
    """Bits of the letters: six each, the highest first; a number's lowest bit comes first."""

    def __init__(self, text: str) -> None:
        try:
            self.values = [_VALUE[letter] for letter in text]
        except KeyError as error:
            raise TrajectoryError(f"not LZ-string text: it holds {error.args[0]!r}; expected base64 letters") from None
        self.place = 0

    def number(self, width: int) -> int:
        value = 0
        end = self.place + width
        if end > 6 * len(self.values):
            raise TrajectoryError("LZ-string text that ends too early; was it cut short?")
        for bit in range(width):
            place = self.place + bit
            value |= ((self.values[place // 6] >> (5 - place % 6)) & 1) << bit
        self.place = end
        return value


def unpack(text: str) -> str:
    """Decompress text; raise TrajectoryError for other letters, or for one that is damaged or cut short."""
    bits = _Bits("".join(text.split()).rstrip("="))
    code = bits.number(2)
    if code == 2:
        return ""
    if code == 3:
        raise TrajectoryError("damaged LZ-string text at its first letter")
    word = chr(bits.number(8 if code == 0 else 16))
    # Codes 0 to 2 are no words.
    words: list[str] = ["", "", "", word]
    out = [word]
    width, left, length = 3, 4, 1
    while True:
        code = bits.number(width)
        if code == 2:
            return "".join(out)
        if code < 2:
            words.append(chr(bits.number(8 if code == 0 else 16)))
            code = len(words) - 1
            left -= 1
            if left == 0:
                left, width = 1 << width, width + 1
        if code < len(words):
            entry = words[code]
        elif code == len(words):
            entry = word + word[0]
        else:
            raise TrajectoryError(f"damaged LZ-string text: code {code} of {len(words)} words")
        out.append(entry)
        length += len(entry)
        if length > MOST_LETTERS:
            raise TrajectoryError("damaged LZ-string text: it grows beyond 250 million letters")
        words.append(word + entry[0])
        word = entry
        left -= 1
        if left == 0:
            left, width = 1 << width, width + 1

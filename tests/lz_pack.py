"""A packer of LZ-string's base64, written from its description, to test the unpacking with."""

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"


def pack(text: str) -> str:
    """The base64 letters of a text."""
    bits: list[int] = []

    def put(value: int, width: int) -> None:
        bits.extend(value >> place & 1 for place in range(width))

    words: dict[str, int] = {}
    fresh: set[str] = set()
    # Codes are as wide as the unpacker's dictionary asks for: it grows with every code but the first.
    width, left = 2, 2
    word = ""

    def grow() -> None:
        nonlocal width, left
        left -= 1
        if left == 0:
            left = 1 << width
            width += 1

    def emit(code_word: str) -> None:
        if code_word in fresh:
            wide = ord(code_word) > 255
            put(int(wide), width)
            put(ord(code_word), 16 if wide else 8)
            grow()
            fresh.discard(code_word)
        else:
            put(words[code_word], width)
        grow()

    for letter in text:
        if letter not in words:
            words[letter] = len(words) + 3
            fresh.add(letter)
        if word + letter in words:
            word += letter
            continue
        emit(word)
        words[word + letter] = len(words) + 3
        word = letter
    if word:
        emit(word)
    put(2, width)
    bits.extend([0] * (-len(bits) % 6 or 6))
    values = [int("".join(map(str, bits[i : i + 6])), 2) for i in range(0, len(bits), 6)]
    return "".join(LETTERS[value] for value in values)

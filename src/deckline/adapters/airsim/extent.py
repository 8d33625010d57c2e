"""How large a MessagePack message says it is, read from its marks as they come, before anything is kept of it.

Source: the MessagePack specification, formats.
"""

LIST, MAP, BODY = "list", "map", "body"
# Mark -> bytes of the length that follows it, what the length counts, bytes beside the counted ones.
_LENGTHS = {
    0xC4: (1, BODY, 0), 0xC5: (2, BODY, 0), 0xC6: (4, BODY, 0),
    0xC7: (1, BODY, 1), 0xC8: (2, BODY, 1), 0xC9: (4, BODY, 1),
    0xD9: (1, BODY, 0), 0xDA: (2, BODY, 0), 0xDB: (4, BODY, 0),
    0xDC: (2, LIST, 0), 0xDD: (4, LIST, 0), 0xDE: (2, MAP, 0), 0xDF: (4, MAP, 0),
}  # fmt: skip
# Mark -> bytes of the value that follows it: numbers, then fixed extensions with their type.
_FIXED = {0xCA: 4, 0xCB: 8, 0xCC: 1, 0xCD: 2, 0xCE: 4, 0xCF: 8, 0xD0: 1, 0xD1: 2, 0xD2: 4, 0xD3: 8} | {
    0xD4: 2, 0xD5: 3, 0xD6: 5, 0xD7: 9, 0xD8: 17,
}  # fmt: skip


class Extent:
    """Follows a stream of messages, cut anywhere.

    Args:
        limit: bytes of a message from which on it is too large.
        items_limit: values in a message, those of lists and maps counted one by one, from which on it is too large.
    """

    def __init__(self, limit: int, items_limit: int) -> None:
        self.limit, self.items_limit = limit, items_limit
        self._read = self._items = 0  # bytes and values of the message so far
        self._open = 0  # values still to come in this message
        self._skip = 0  # bytes still to come of a value
        self._head = b""  # of a mark whose length has not come whole
        self.largest = 0  # bytes of the largest message so far, as much of it as has come

    @property
    def midway(self) -> bool:
        """Whether a message has begun and not ended."""
        return bool(self._open or self._skip or self._head)

    def follow(self, data: bytes) -> str:
        """Why the message that `data` goes on with is too large; empty: it is not."""
        too_large = self._follow(data)
        self.largest = max(self.largest, self._read)
        return too_large

    def _follow(self, data: bytes) -> str:
        data, at = self._head + data, 0
        self._head = b""
        while at < len(data):
            if self._skip:
                step = min(self._skip, len(data) - at)
                self._skip, self._read, at = self._skip - step, self._read + step, at + step
                continue
            if not self._open:
                self.largest = max(self.largest, self._read)
                self._read, self._items, self._open = 0, 0, 1
            wide = _LENGTHS.get(data[at], (0,))[0]
            if at + 1 + wide > len(data):
                self._head = data[at:]
                break
            self._announce(data[at], int.from_bytes(data[at + 1 : at + 1 + wide], "big"))
            self._read, at = self._read + 1 + wide, at + 1 + wide
            if self._read + self._skip + self._open >= self.limit:  # a value to come has a byte at least
                return f"a message of {self._read + self._skip + self._open} bytes or more"
            if self._items >= self.items_limit:
                return f"a message of {self._items} values or more"
        return ""

    def _announce(self, mark: int, length: int) -> None:
        """Take into account what follows a mark."""
        kind, beside = _LENGTHS.get(mark, (0, BODY, 0))[1:]
        if 0x80 <= mark <= 0x8F:
            kind, length = MAP, mark & 0x0F
        elif 0x90 <= mark <= 0x9F:
            kind, length = LIST, mark & 0x0F
        elif 0xA0 <= mark <= 0xBF:
            length = mark & 0x1F
        inner = {LIST: length, MAP: 2 * length, BODY: 0}[kind]
        self._skip = length + beside + _FIXED.get(mark, 0) if kind == BODY else 0
        self._open += inner - 1
        self._items += inner

"""Plain values as the bytes of ROS 2 messages (CDR), through rosbags: no ROS is needed."""

from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from deckline.adapters.ros.messages import Values

EMPTY: dict[str, Any] = {"string": "", "bool": False}  # other base types begin as 0
STORE = Stores.ROS2_HUMBLE  # the oldest whose types are used


class Encoder:
    """Messages by the definitions of ROS 2 Humble; the fields of all types used here are the same up to Lyrical."""

    def __init__(self) -> None:
        self._store = get_typestore(STORE)

    def __call__(self, kind: str, values: Values) -> bytes:
        """Bytes of a message; fields that are left out are zero or empty.

        Raises:
            ValueError: a field that the type does not have.
        """
        return bytes(self._store.serialize_cdr(self._make(kind, values), kind))

    def definition(self, kind: str) -> bytes:
        """The text of a type and of those in it, as MCAP holds it ("ros2msg")."""
        return self._store.generate_msgdef(kind, ros_version=2)[0].encode()

    def _make(self, kind: str, values: Values) -> Any:
        fields = dict(self._store.fielddefs[kind][1])
        if unknown := set(values) - set(fields):
            raise ValueError(f"{kind} has no {', '.join(sorted(unknown))}")
        made = {name: self._fill(description, values.get(name)) for name, description in fields.items()}
        return self._store.types[kind](**made)

    def _fill(self, description: Any, value: Any) -> Any:
        node, detail = description
        if node == Nodetype.NAME:
            return self._make(detail, value or {})
        if node == Nodetype.BASE:
            return EMPTY.get(detail[0], 0) if value is None else value
        (inner, inner_detail), count = detail
        if inner == Nodetype.NAME:
            return [self._make(inner_detail, item) for item in value or ()]
        if isinstance(value, bytes):
            return np.frombuffer(value, np.uint8)
        return np.asarray(np.zeros(count if node == Nodetype.ARRAY else 0) if value is None else value, inner_detail[0])

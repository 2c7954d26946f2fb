"""Nested settings by their dotted keys."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping


def is_listed(key: str, listed: Iterable[str]) -> bool:
    """Whether a key, or a group that it lies in, is among those listed."""
    return any(key == known or key.startswith(f"{known}.") for known in listed)


def value_at(config: Mapping, key: str) -> object:
    """Returns the value at a dotted key; ``None`` where there is none."""
    node: object = config
    for name in key.split("."):
        node = node.get(name) if isinstance(node, Mapping) else None
    return node


def differences(
    before: Mapping, after: Mapping, prefix: str = ""
) -> Iterator[tuple[str, object, object]]:
    """Yields the dotted keys whose values differ, sorted, with both values; ``None`` is the value
    of a key that is not there."""
    for key in sorted(before.keys() | after.keys()):
        old, new = before.get(key), after.get(key)
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            yield from differences(old, new, f"{prefix}{key}.")
        elif old != new:
            yield f"{prefix}{key}", old, new


def replaced(data: object, change: Callable[[object], object]) -> object:
    """Returns nested plain data, of which every value that holds no others was changed."""
    if isinstance(data, Mapping):
        return {key: replaced(value, change) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [replaced(value, change) for value in data]
    return change(data)


def short(value: object) -> str:
    """Returns a value as JSON, of at most 60 characters."""
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."

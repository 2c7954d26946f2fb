"""What keys of a configuration there may be, and which values they may have."""

import inspect
from collections.abc import Iterator, Mapping

from hydra.utils import get_object
from omegaconf import DictConfig, OmegaConf

from .errors import UserError
from .failures import closest

INTEGER_OR_NULL = ("threads", "sim.workers")
UNION = ("trainer.devices",)
"""Settings of several types, which Lightning itself checks."""
ANY_LENGTH = ("suite.", "task.")
"""Where a list of numbers may be longer or shorter than the configuration's."""
NOT_EMPTY = ("suite.",)
"""Where it may not be empty then."""
UNITS = ("_m", "_s", "_hz", "_deg", "_mps")
"""Endings of quantities: any number will do, even where the configuration has a round one."""
TARGET = "_target_"


def require_set_soundly(before: DictConfig, cfg: DictConfig, told_by: str) -> None:
    """Raises `UserError` where files have added a key that nothing reads, or changed the type of a
    value. Of what they build from another class, all keys are taken.

    ``before`` is the configuration without them, and ``told_by`` names them.
    """
    trees = (OmegaConf.to_container(node, resolve=False) for node in (before, cfg))
    for key, is_new in _changed(*trees):
        try:
            if is_new:
                require_known(key, before, OmegaConf.select(cfg, key))
            else:
                require_type(key, before, cfg)
        except UserError as error:
            raise UserError(f"{told_by}: {error}") from None


def _changed(before: Mapping, after: Mapping, prefix: str = "") -> Iterator[tuple[str, bool]]:
    """Dotted keys that are new or have another value, and whether they are new."""
    for name, value in after.items():
        key, old = f"{prefix}{name}", before.get(name)
        if name not in before:
            yield key, True
        elif isinstance(value, dict) and isinstance(old, dict):
            if value.get(TARGET) == old.get(TARGET):
                yield from _changed(old, value, f"{key}.")
        elif value != old:
            yield key, False


def require_known(key: str, before: DictConfig, value: object = None) -> None:
    """Raises `UserError` for a new key, unless a class takes it as an argument.

    A group of nothing but classes, as ``callbacks``, takes another one.
    """
    parent, _, name = key.rpartition(".")
    node = OmegaConf.select(before, parent) if parent else before
    known = list(map(str, node)) if isinstance(node, DictConfig) else []
    if known and TARGET in node:
        arguments = _arguments(node[TARGET])
        if arguments is None or name in arguments:
            return
        known += [each for each in arguments if each not in known]
    elif isinstance(node, DictConfig):
        of_classes = parent and all(_is_class(node[each]) for each in node)
        if not node or (of_classes and _is_class(value)):
            return
    raise UserError(
        f"{key}: nothing reads this key{closest(name, known)} there are {', '.join(known)}"
    )


def _is_class(node: object) -> bool:
    return isinstance(node, DictConfig) and TARGET in node


def _arguments(target: str) -> list[str] | None:
    """What a class or a function may be given; ``None`` where that is anything, or unknown."""
    try:
        parameters = inspect.signature(get_object(target)).parameters.values()
    except (ImportError, TypeError, ValueError):
        return None
    if any(each.kind is each.VAR_KEYWORD for each in parameters):
        return None
    return [each.name for each in parameters]


def require_type(key: str, before: DictConfig, cfg: DictConfig) -> None:
    """Raises `UserError` for a value that is of another type than it was."""
    was, now = (plain(OmegaConf.select(node, key)) for node in (before, cfg))
    if key in UNION or (now is None and (was is None or key.startswith("trainer."))):
        return
    if key in INTEGER_OR_NULL:
        was = 1
    elif key.endswith(UNITS) and isinstance(was, int):
        was = float(was)
    both_lists = isinstance(was, list) and isinstance(now, list)
    if both_lists and key.startswith(ANY_LENGTH) and (now or not key.startswith(NOT_EMPTY)):
        was = was[:1] * len(now)
    wanted = _mismatch(was, now)
    if wanted:
        raise UserError(f"{key}: {now!r} is not {wanted}; the configuration has {was!r}")


def _mismatch(was: object, now: object) -> str | None:
    """What a value should have been, or ``None`` where it is of the right type."""
    if isinstance(was, bool):
        return None if isinstance(now, bool) else "true or false"
    if isinstance(was, int | float):
        kinds = int if isinstance(was, int) else int | float
        ok = isinstance(now, kinds) and not isinstance(now, bool)
        return None if ok else ("an integer" if kinds is int else "a number")
    if isinstance(was, dict):
        return None if isinstance(now, dict) else "a group of keys"
    if isinstance(was, list):
        if not isinstance(now, list):
            return "a list"
        if was and all(isinstance(item, int | float) for item in was):
            same = len(now) == len(was) and not any(map(_mismatch, was, now))
            return None if same else f"a list of {len(was)} numbers of that type"
    if isinstance(was, str) and isinstance(now, dict | list | None):
        return "a word"
    return None


def plain(node: object) -> object:
    """A value of a configuration, without OmegaConf's classes."""
    return OmegaConf.to_container(node, resolve=True) if OmegaConf.is_config(node) else node

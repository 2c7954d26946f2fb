"""The keys that a configuration may have, and the types of their values."""

import inspect
from collections.abc import Iterator, Mapping

from hydra.utils import get_object
from omegaconf import DictConfig, OmegaConf

from .errors import UserError, closest

TARGET = "_target_"
# Endings of quantities: any number will do, even where the configuration has a round one.
UNITS = ("_m", "_s", "_hz", "_deg", "_mps")


def require_set_soundly(before: DictConfig, cfg: DictConfig, files: str) -> None:
    """Raises `UserError` where files have added a key that nothing reads, or changed the type of a
    value. Where they build another class than before, all of its keys are taken.

    ``before`` is the configuration without these files, which the message names by ``files``.
    """
    trees = (OmegaConf.to_container(node, resolve=False) for node in (before, cfg))
    for key, is_new in _changed(*trees):
        try:
            if is_new:
                require_known(key, before, cfg)
            else:
                require_type(key, before, cfg)
        except UserError as error:
            raise UserError(f"{files}: {error}") from None


def _changed(before: Mapping, after: Mapping, prefix: str = "") -> Iterator[tuple[str, bool]]:
    """Yields each dotted key that is new or has another value, and whether it is new."""
    for name, value in after.items():
        key, old = f"{prefix}{name}", before.get(name)
        if name not in before:
            yield key, True
        elif isinstance(value, dict) and isinstance(old, dict):
            # The arguments of another class have nothing to be compared with.
            if value.get(TARGET) == old.get(TARGET):
                yield from _changed(old, value, f"{key}.")
        elif value != old:
            yield key, False


def require_known(key: str, before: DictConfig, cfg: DictConfig) -> None:
    """Raises `UserError` for a key of ``cfg`` that ``before`` lacks, unless something reads it.

    A class reads its arguments, and a loss the weight of each term. A group that holds only
    classes, such as ``callbacks``, ``loss.terms`` or ``suite.metrics``, takes another class.
    """
    new = _first_new(key, before)
    if new is None:
        return

    parent, _, name = new.rpartition(".")
    node = OmegaConf.select(before, parent) if parent else before
    known = list(map(str, node)) if isinstance(node, DictConfig) else []

    if _is_class(node):
        arguments = _arguments(node[TARGET])
        # The loss itself takes the weight of a term, before it calls the term's function.
        is_weight = name == "weight" and parent.startswith("loss.terms.")
        if arguments is None or name in arguments or is_weight:
            return
        known += [argument for argument in arguments if argument not in known]
    elif isinstance(node, DictConfig):
        holds_classes = parent and all(_is_class(node[sibling]) for sibling in node)
        if not node or (holds_classes and _is_class(OmegaConf.select(cfg, new))):
            return

    raise UserError(
        f"{new}: nothing reads this key{closest(name, known)} there are {', '.join(known)}"
    )


def _first_new(key: str, before: DictConfig) -> str | None:
    """Returns the shortest beginning of a dotted key that a configuration lacks, if it lacks any.

    It is ``loss.terms.mine`` for ``loss.terms.mine.weight`` where no term has that name yet.
    """
    node, names = before, key.split(".")
    for depth, name in enumerate(names, start=1):
        if not isinstance(node, DictConfig) or name not in node:
            return ".".join(names[:depth])
        node = node[name]
    return None


def _is_class(node: object) -> bool:
    return isinstance(node, DictConfig) and TARGET in node


def _arguments(target: str) -> list[str] | None:
    """Names what a class or a function may be given; ``None`` for anything, or for unknown."""
    try:
        parameters = inspect.signature(get_object(target)).parameters.values()
    except (ImportError, TypeError, ValueError):
        return None
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return None
    return [parameter.name for parameter in parameters]


def require_type(key: str, before: DictConfig, cfg: DictConfig) -> None:
    """Raises `UserError` for a value that is of another type than it was before."""
    old, new = (plain(OmegaConf.select(node, key)) for node in (before, cfg))
    group = key.partition(".")[0]

    # Lightning takes several types of devices, and null as its own default; it checks both itself.
    if key == "trainer.devices" or (new is None and (old is None or group == "trainer")):
        return
    if isinstance(old, int) and key.endswith(UNITS):
        old = float(old)
    # A list of edges or of runs has any length, but a suite without edges scores nothing. All
    # other lists of numbers are vectors.
    any_length = group == "task" or (group == "suite" and new)
    if isinstance(old, list) and isinstance(new, list) and any_length:
        old = old[:1] * len(new)

    if wanted := _mismatch(old, new):
        raise UserError(f"{key}: {new!r} is not {wanted}; the configuration has {old!r}")


def _mismatch(old: object, new: object) -> str | None:
    """Says what a value should have been, or returns ``None`` where it has the right type."""
    if isinstance(old, bool):
        return None if isinstance(new, bool) else "true or false"
    if isinstance(old, int | float):
        kinds = int if isinstance(old, int) else int | float
        is_number = isinstance(new, kinds) and not isinstance(new, bool)
        return None if is_number else ("an integer" if kinds is int else "a number")
    if isinstance(old, dict):
        return None if isinstance(new, dict) else "a group of keys"

    if isinstance(old, list):
        if not isinstance(new, list):
            return "a list"
        if old and all(isinstance(item, int | float) for item in old):
            same = len(new) == len(old) and not any(map(_mismatch, old, new))
            return None if same else f"a list of {len(old)} numbers of that type"
    if isinstance(old, str) and isinstance(new, dict | list | None):
        return "a word"
    return None


def plain(node: object) -> object:
    """Returns a value of a configuration without OmegaConf's classes."""
    return OmegaConf.to_container(node, resolve=True) if OmegaConf.is_config(node) else node

"""The keys that a configuration may have, and the types of their values."""

import inspect
import math
from collections.abc import Sequence
from pkgutil import resolve_name

from omegaconf import DictConfig, OmegaConf

from .dotted import differences, is_listed
from .errors import UserError, closest

TARGET = "_target_"
# Groups of words or lists, any of which may go.
OPEN = ("task.scores", "layout.classes")
# Endings of quantities: any number will do, even where the configuration has a round one.
UNITS = ("_m", "_s", "_hz", "_deg", "_mps")


def require_keys(before: DictConfig, cfg: DictConfig, typed: Sequence[str], files: str) -> None:
    """Raises `UserError` where a command adds a key that nothing reads, removes one that is needed,
    or changes the type of a value.

    ``before`` is the configuration without the keys that are ``typed`` and without ``files``,
    which the message names where the mistake is theirs. A class reads its arguments, and a loss
    the weight of each term.
    """
    for key, _, _ in differences(*(OmegaConf.to_container(node) for node in (before, cfg))):
        if is_listed(key, ["hydra"]):
            continue
        try:
            _require_sound(key, before, cfg)
        except UserError as error:
            if any(is_listed(key, [word]) or is_listed(word, [key]) for word in typed):
                raise
            raise UserError(f"{files}: {error}") from None


def _require_sound(key: str, before: DictConfig, cfg: DictConfig) -> None:
    """Checks a key that differs: where it, or a group that it lies in, is new or belongs to another
    class, that something reads it; elsewhere its type."""
    names = key.split(".")
    for depth, name in enumerate(names):
        old, new = (OmegaConf.select(node, ".".join(names[:depth])) for node in (before, cfg))
        if name not in new:
            return _require_needless(".".join(names[: depth + 1]), before, new)
        if name not in old or new.get(TARGET) != old.get(TARGET):
            return _require_read(".".join(names[: depth + 1]), before, cfg)
    _require_type(key, *(_plain(OmegaConf.select(node, key)) for node in (before, cfg)))


def _require_needless(key: str, before: DictConfig, new: DictConfig) -> None:
    """Raises `UserError` for a key that a command removes, but for one among groups of its kind, of
    `OPEN` ones, and for an argument of another class: a callback may go, the logger may not.

    ``new`` is the group without it.
    """
    group = key.rpartition(".")[0]
    siblings = OmegaConf.select(before, group) if group else before
    of_another_class = siblings.get(TARGET) != new.get(TARGET)
    is_open = is_listed(group, OPEN) or all(map(OmegaConf.is_dict, siblings.values()))
    if not (is_open or of_another_class):
        raise UserError(f"{key}: is needed; keep it, and give another value or option instead")


def _require_read(key: str, before: DictConfig, cfg: DictConfig) -> None:
    """Raises `UserError` for a new key that nothing reads.

    A class reads its arguments, and a loss the weight of each term. A group that holds only
    classes, such as ``callbacks``, ``loss.terms`` or ``suite.metrics``, takes another class.
    """
    group, _, name = key.rpartition(".")
    old, new = (OmegaConf.select(node, group) or {} for node in (before, cfg))
    known = [str(each) for each in old if each != "hydra"]
    if TARGET in new:
        arguments = _arguments(new[TARGET])
        if arguments is None or name.startswith("_"):
            return
        # The loss itself takes the weight of a term, before it calls the term's function.
        known += arguments + ["weight"] * group.startswith("loss.terms.")
    elif not old:
        return
    elif group and _is_class(new[name]) and all(map(_is_class, old.values())):
        for argument in new[name]:
            _require_read(f"{key}.{argument}", before, cfg)
        return

    if name not in known:
        there = ", ".join(dict.fromkeys(known))
        raise UserError(f"{key}: nothing reads this key{closest(name, known)} there are {there}")


def _is_class(node: object) -> bool:
    return isinstance(node, DictConfig) and TARGET in node


def _arguments(target: str) -> list[str] | None:
    """Names what a class or a function may be given; ``None`` for anything, or for unknown."""
    try:
        parameters = inspect.signature(resolve_name(target)).parameters.values()
    except (AttributeError, ImportError, TypeError, ValueError):
        return None
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return None
    return [parameter.name for parameter in parameters]


def _require_type(key: str, old: object, new: object) -> None:
    """Raises `UserError` for a value that is of another type than the default, or not finite."""
    group = key.partition(".")[0]
    values = new if isinstance(new, list) else [new]
    if any(isinstance(each, float) and not math.isfinite(each) for each in values):
        raise UserError(f"{key}: {new} is not finite; the default is {old!r}")
    # Lightning takes several types of devices, and null as its own default; it checks both itself.
    if key == "trainer.devices" or (new is None and (old is None or group == "trainer")):
        return
    if isinstance(old, int) and key.endswith(UNITS):
        old = float(old)
    if isinstance(old, list) and key.endswith("class_weights"):
        old = [float(each) for each in old]
    # A list of edges, runs, ages or classes has any length, but a suite without edges scores
    # nothing. All other lists of numbers are vectors.
    is_list = group == "task" or key.endswith(".ages_s") or key.startswith("layout.classes.")
    any_length = is_list or (group == "suite" and new)
    if isinstance(old, list) and isinstance(new, list) and any_length:
        old = old[:1] * len(new)

    if wanted := _mismatch(old, new):
        raise UserError(f"{key}: {new!r} is not {wanted}; the default is {old!r}")


def _mismatch(old: object, new: object) -> str | None:
    """Returns the type that a value should have, or ``None`` where it has it."""
    match old:
        case bool():
            return None if isinstance(new, bool) else "true or false"
        case int() | float():
            kinds = int if isinstance(old, int) else int | float
            is_number = isinstance(new, kinds) and not isinstance(new, bool)
            return None if is_number else ("an integer" if kinds is int else "a number")
        case dict():
            return None if isinstance(new, dict) else "a group of keys"
        case list() if not isinstance(new, list):
            return "a list"
        case [int() | float(), *_]:
            same = len(new) == len(old) and not any(map(_mismatch, old, new))
            kind = "integers" if all(isinstance(each, int) for each in old) else "numbers"
            return None if same else f"a list of {len(old)} {kind}"
        case str() if isinstance(new, dict | list | None):
            return "a word"
    return None


def _plain(node: object) -> object:
    """Returns a value of a configuration without OmegaConf's classes."""
    return OmegaConf.to_container(node, resolve=True) if OmegaConf.is_config(node) else node

"""A composed configuration: checked, completed and handed to its task."""

import gc
from collections.abc import Collection, Sequence
from functools import cache
from hashlib import sha256
from pathlib import Path

from hydra import compose
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import MissingConfigException
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf, open_dict

from .data.manifest import MANIFEST, read_manifest
from .dotted import is_listed, replaced
from .errors import UserError
from .help import GROUPS
from .keys import require_keys
from .run_folder import BEST, KEYS, UNKNOWN_RECIPE
from .values import require_values


def search_path(hydra: DictConfig) -> list[str]:
    """Returns the overrides of Hydra itself that name folders with groups of one's own."""
    return [line for line in hydra.overrides.hydra if line.startswith("hydra.searchpath=")]


def require_sound(cfg: DictConfig, hydra: DictConfig) -> None:
    """Raises `UserError` that names the key, for what would otherwise fail late or do nothing.

    Neither the command line nor a file that it adds, such as an experiment's, may add a key that
    nothing reads, remove one that is needed or change the type of a value. ``hydra`` is Hydra's own
    part of the composition. Must be called inside Hydra's application.
    """
    # Whatever is trained and scored is called by it.
    if (said := cfg.get("recipe_name")) != hydra.runtime.choices["recipe"]:
        raise UserError(
            f"recipe_name: {said!r}; the recipe's own file names it: give recipe=strong, "
            "recipe=paper or one of your own"
        )
    typed = OverridesParser.create().parse_overrides(list(hydra.overrides.task))
    groups = [word for word in typed if (GROUPS / word.key_or_group).is_dir()]
    # Those that may set any key: the recipe's, the scale's, and the added ones.
    files = [word.get_key_element().lstrip("+") for word in groups if word.is_add()]
    files += ["recipe", "scale"]
    files = {group: hydra.runtime.choices[group] for group in files}
    before = _composed_without(files, hydra)

    for group, choice in files.items():
        if group in cfg and group not in before.hydra.runtime.choices:
            line = "# @package _global_"
            raise UserError(f"{group}={choice}: the file {choice}.yaml must begin with {line!r}")
    names = ", ".join(f"{group}={choice}" for group, choice in files.items())
    if removed := [word.key_or_group for word in groups if word.is_delete()]:
        raise UserError(f"{removed[0]}: is needed; keep it, and choose another of its options")
    keys = [word.key_or_group for word in typed if word not in groups]
    require_keys(before, cfg, keys, names)

    require_values(cfg)


def _composed_without(files: Collection[str], hydra: DictConfig) -> DictConfig:
    """Composes the options that a command chooses, without files that may set any key and without
    the keys of the command line."""
    choices = {group: each for group, each in hydra.runtime.choices.items() if group not in files}
    # A task may bring groups of its own.
    words = [f"task={choices['task']}", *search_path(hydra)]
    before = _composed(*words)

    defaults = before.hydra.runtime.choices
    others = [
        f"{'' if group in defaults else '+'}{group}={choice}"
        for group, choice in choices.items()
        if not group.startswith("hydra/") and choice != defaults.get(group)
    ]
    return _composed(*words, *others) if others else before


@cache
def _composed(*words: str) -> DictConfig:
    """A composition that the commands of one process share: not to be changed."""
    return compose("config", list(words), return_hydra_config=True)


def do_task(cfg: DictConfig, hydra: DictConfig) -> object:
    """Does the configured task with all weathers that it names and `adopted` settings.

    ``hydra`` is Hydra's own part of the composition. Must be called inside Hydra's application.
    """
    add_named_weathers(cfg, hydra)
    expand_home(cfg)
    task, cfg = instantiate(cfg.task), adopted(cfg, hydra.overrides.task)
    fit_to_recording(cfg, hydra.overrides.task)

    # As run.py begins. What is imported and composed by now stays, so no search for garbage looks
    # through it; but what an earlier job of a sweep has left is garbage.
    if not gc.isenabled():
        gc.freeze()
        gc.enable()
    return task(cfg)


def expand_home(cfg: DictConfig) -> None:
    """Lets paths begin with ``~``, which a shell leaves as it is behind an equals sign."""
    home = str(Path.home())

    def expanded(value: object) -> object:
        is_path = isinstance(value, str) and (value == "~" or value.startswith("~/"))
        return home + value[1:] if is_path else value

    for key, value in OmegaConf.to_container(cfg).items():
        if (found := replaced(value, expanded)) != value:
            cfg[key] = found


def add_named_weathers(cfg: DictConfig, hydra: DictConfig) -> None:
    """Adds to ``sim.weather`` what ``sim.weathers`` names and no file lists in its defaults.

    A name without a file is left to the generator, which knows all weathers that there are.
    Must be called inside Hydra's application.
    """
    for name in cfg.sim.weathers:
        if name in cfg.sim.weather or not str(name).isidentifier():
            continue
        package = f"sim.weather.{name}"
        try:
            added = compose("config", [f"+sim/weather@{package}={name}", *search_path(hydra)])
        except MissingConfigException:
            continue
        with open_dict(cfg):
            cfg.sim.weather[name] = added.sim.weather[name]


def fit_to_recording(cfg: DictConfig, overrides: Sequence[str]) -> None:
    """Gives a configuration the rate, the image size, the grid and the held-out clips of the
    dataset that ``paths.dataset`` names, where task=annotate has made it.

    What the command line sets stays, and so does the grid of a checkpoint's network.
    """
    if not cfg.paths.dataset or not (Path(cfg.paths.dataset) / MANIFEST).is_file():
        return
    manifest = read_manifest(Path(cfg.paths.dataset))
    if "source" not in manifest:
        return

    made, held_out = manifest["sim"], manifest["held_out"]
    values = {"sim.capture_hz": made["capture_hz"], "sim.image": made["image"]}
    values |= {f"data.{part}_clips": held_out[part] for part in ("val", "test")}
    if cfg.ckpt_path in (None, "best", "last"):
        values["grid"] = made["grid"]
    said = [each.key_or_group for each in OverridesParser.create().parse_overrides([*overrides])]
    for key, value in values.items():
        if key not in said:
            OmegaConf.update(cfg, key, value, merge=True, force_add=True)


def adopted(cfg: DictConfig, overrides: Sequence[str]) -> DictConfig:
    """Returns the configuration to work with: the checkpoint's, where a command names the file of
    one and nothing that shapes a model, else ``cfg``.

    ``overrides`` are those of the command line. task=look shows other flights than those that the
    weights were trained on: which, its own configuration says. What the command leaves lies in the
    run that the file belongs to, or in ``runs/weights/<file>-<hash>``, in no run of one's own.
    Raises `UserError` as `Checkpoint.read` does.
    """
    # An override of the model names another rung, whose configuration must then be given whole.
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    keys = [override.key_or_group for override in parsed]
    flights = KEYS["flights"] if "task=look" in overrides else ()
    says_nothing = (*KEYS["place"], *KEYS["machine"], *KEYS["scoring"], *flights)
    neutral = all(is_listed(key, says_nothing) for key in keys)
    if cfg.ckpt_path in (None, "best", "last") or not neutral:
        return cfg

    from .metrics.protocol import without_former  # only here: these take seconds to import
    from .models.checkpoint import Checkpoint

    own = Checkpoint.read(cfg.ckpt_path).origin.config
    adopted, taken = cfg.copy(), own.keys() - set(KEYS["machine"])
    OmegaConf.set_struct(adopted, False)
    for key in taken:
        adopted[key] = own[key]
    adopted.recipe_name = own.get("recipe_name", UNKNOWN_RECIPE)
    # The trainer is this machine's, but scores depend on the precision.
    adopted.trainer.precision = own["trainer"]["precision"]
    # A metric that is newer than the checkpoint, and its settings, are of the command's suite.
    suite = without_former(own["suite"])
    adopted.suite = OmegaConf.merge({}, cfg.suite, suite)
    # Arguments of metrics refer to shared settings, which the command may set: not their values.
    adopted.suite.metrics = OmegaConf.merge(suite.get("metrics", {}), cfg.suite.metrics)

    if "paths.run" not in keys:
        adopted.paths.run = str(_run_of(Path(cfg.ckpt_path), Path(cfg.paths.runs)))

    # What the checkpoint does not say, or the command says itself.
    unsaid = [key for key in KEYS["place"] if key.partition(".")[0] in taken]
    for key in (*unsaid, *flights, *keys):
        if "." in key:
            OmegaConf.update(adopted, key, OmegaConf.select(cfg, key))
    return adopted


def _run_of(file: Path, runs: Path) -> Path:
    """Returns the folder of the run that a checkpoint belongs to, or one for the file alone, whose
    name ends in the hash of its content: another file of the same name has another one."""
    from .models.weights import hash_in_name  # only here, as above

    if file.parent.name == Path(BEST).parent.name:
        return file.parent.parent
    digest = "" if hash_in_name(file) else f"-{sha256(file.read_bytes()).hexdigest()[:8]}"
    return runs / "weights" / (file.stem + digest)

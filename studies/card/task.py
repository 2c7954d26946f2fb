"""task=card: draws the card of a finished dataset: a page, its figures, and metadata."""

from importlib import import_module

from omegaconf import DictConfig, OmegaConf

from src.data.manifest import read_manifest
from src.errors import UserError
from src.tasks.dataset import root_of
from src.terminal import say
from studies.card.page import CARD, FIGURES, write_card


def card(cfg: DictConfig, pipeline: str | None = None) -> None:
    """Reads every frame of the dataset and prints where its card lies.

    ``pipeline`` is the dotted path of a function that simulates one frame again and draws how it
    was annotated; without pybullet the card goes without that picture.
    """
    # A dataset that is named by paths.dataset has settings of its own.
    root = root_of(cfg)
    manifest = read_manifest(root)
    sim = OmegaConf.to_container(cfg.sim, resolve=True) | manifest["sim"]
    try:
        if pipeline and "source" not in manifest:
            from src.sim.plan import plan_clips

            module, _, name = pipeline.rpartition(".")
            draw = getattr(import_module(module), name)
            draw(sim, plan_clips(sim)[0], root / FIGURES / "pipeline.jpg")
    except (ImportError, UserError) as error:
        say(f"no picture of the annotation: {error}")

    write_card(root)
    say(root / CARD)

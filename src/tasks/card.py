"""task=card: draws the card of a finished dataset: a page, its figures, and metadata."""

from omegaconf import DictConfig, OmegaConf

from ..data.manifest import read_manifest
from ..errors import UserError
from ..report.card import CARD, FIGURES, write_card
from ..terminal import say
from .dataset import root_of


def card(cfg: DictConfig) -> None:
    """Reads every frame of the dataset and prints where its card lies.

    One frame is simulated again, for the picture of how it was annotated; without pybullet the
    card goes without that picture.
    """
    # A dataset that is named by paths.dataset has settings of its own.
    root = root_of(cfg)
    sim = OmegaConf.to_container(cfg.sim, resolve=True) | read_manifest(root)["sim"]
    try:
        from ..portrait.pipeline import draw_pipeline
        from ..sim.plan import plan_clips

        draw_pipeline(sim, plan_clips(sim)[0], root / FIGURES / "pipeline.jpg")
    except (ImportError, UserError) as error:
        say(f"no picture of the annotation: {error}")

    write_card(root)
    say(root / CARD)

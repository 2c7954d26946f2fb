"""task=card: draws the card of a finished data set: a page, its figures, and metadata."""

from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from ..data.manifest import read_manifest
from ..errors import UserError
from ..report.card import CARD, FIGURES, write_card
from .dataset import root_of


def card(cfg: DictConfig) -> None:
    """Reads every frame of the data set and prints where its card lies.

    One frame is simulated again, for the picture of how it was annotated; without pybullet the
    card goes without that picture.
    """
    root, console = root_of(cfg), Console(highlight=False, soft_wrap=True)
    sim = OmegaConf.to_container(cfg.sim, resolve=True) | read_manifest(root)["sim"]
    picture = root / FIGURES / "pipeline.jpg"
    try:
        from ..portrait.pipeline import draw_pipeline
        from ..sim.plan import plan_clips

        draw_pipeline(sim, plan_clips(sim)[0], picture)
    except (ImportError, UserError) as error:
        console.print(f"{picture}: not drawn ({error})")
    write_card(root)
    console.print(f"{root / CARD}")

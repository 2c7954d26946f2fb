"""task=card: writes the card of a finished data set again."""

from omegaconf import DictConfig
from rich.console import Console

from ..report.card import CARD, write_card
from .dataset import root_of


def card(cfg: DictConfig) -> None:
    """Reads every frame of the data set and prints where its card lies."""
    root = root_of(cfg)
    write_card(root)
    Console().print(f"{root / CARD}", highlight=False, soft_wrap=True)

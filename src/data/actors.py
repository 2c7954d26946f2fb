"""The actors that a front image shows."""

from collections.abc import Sequence

import pandas as pd

from ..ontology import ACTOR_TYPES
from .clip import Clip

# An actor with this share of the image's pixels or more counts as visible.
MIN_VISIBLE_SHARE = 5e-5


def visible_actors(clip: Clip) -> pd.DataFrame:
    """Counts the visible actors of each type (``visible/<type>``), a row a frame."""
    # A share of the image, so that the count means the same at every resolution.
    pixels = clip.meta.width * clip.meta.height
    visible = clip.actors[clip.actors["visible_pixels"] >= MIN_VISIBLE_SHARE * pixels]
    counts = pd.crosstab(visible["frame"], visible["type"])
    counts = counts.reindex(index=clip.frames["frame"], columns=list(ACTOR_TYPES), fill_value=0)
    return counts.add_prefix("visible/").reset_index(drop=True)


def liveliest(clips: Sequence[Clip]) -> Clip:
    """Returns the clip with most visible actors in a frame, of equal ones the first."""
    return max(clips, key=lambda clip: visible_actors(clip).to_numpy().sum() / len(clip))

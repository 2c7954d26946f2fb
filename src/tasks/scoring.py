"""What the configuration says of scoring: which scores, of which clips, under which protocol."""

from collections.abc import Sequence

from omegaconf import DictConfig, OmegaConf

from ..data.datamodule import SkyShieldData
from ..metrics.protocol import SUPERVISED, Protocol
from ..metrics.suite import ScoreSuite, import_metrics


def score_settings(cfg: DictConfig) -> tuple[dict, dict]:
    """Returns ``metric`` and ``suite`` as plain data: all that says how scores are computed."""
    metric, suite = (OmegaConf.to_container(cfg[key], resolve=True) for key in ("metric", "suite"))
    import_metrics(suite)
    return metric, suite


def suite_of(cfg: DictConfig, data: SkyShieldData) -> ScoreSuite:
    """Returns the configured scores of the test split."""
    return ScoreSuite(data.grid, clips_of(data.split["test"]), score_settings(cfg)[1])


def clips_of(samples: Sequence[tuple[str, int]]) -> list[str]:
    """Returns the clips in the order of their first frame."""
    return list(dict.fromkeys(clip for clip, _ in samples))


def protocol_of(cfg: DictConfig, data: SkyShieldData, frames: int) -> Protocol:
    """Returns the protocol of scores of ``frames`` frames of the test split."""
    settings = score_settings(cfg)
    return Protocol.of(data.root.name, "test", frames, data.grid, SUPERVISED, *settings)

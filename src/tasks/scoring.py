"""What the configuration says of scoring: which scores, of which clips, under which protocol."""

from collections import Counter
from collections.abc import Collection, Sequence

from omegaconf import DictConfig, OmegaConf

from ..data.datamodule import SkyShieldData
from ..metrics.protocol import SUPERVISED, Protocol
from ..metrics.suite import ScoreSuite, import_metrics
from ..results.counts import Counts
from ..results.table import Parts


def parts_of(unseen: Collection[str]) -> Parts:
    """Returns the test split and its parts: clips never trained on, and last seconds of others."""
    return {
        "test": lambda clip: True,
        "test_unseen_clips": lambda clip: clip in unseen,
        "test_seen_clips": lambda clip: clip not in unseen,
    }


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


def counts_of(
    name: str, protocol: Protocol, suite: ScoreSuite, samples: Sequence[tuple[str, int]]
) -> Counts:
    """Returns the counts of a suite over all samples."""
    frames = Counter(clip for clip, _ in samples)
    of_clips = [frames[clip] for clip in suite.clips]
    return Counts(name, protocol, suite.clips, of_clips, suite.counts())


def protocol_of(cfg: DictConfig, data: SkyShieldData, frames: int) -> Protocol:
    """Returns the protocol of scores of ``frames`` frames of the test split."""
    settings = score_settings(cfg)
    return Protocol.of(data.root.name, "test", frames, data.grid, SUPERVISED, *settings)

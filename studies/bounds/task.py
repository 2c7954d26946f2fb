"""task=bounds: floor and ceiling of a dataset's scores, without any training."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import get_args

import pandas as pd
import torch
from hydra.utils import instantiate
from jaxtyping import UInt8
from omegaconf import DictConfig
from torch import Tensor

from src.data.batch import Batch
from src.errors import UserError
from src.metrics.protocol import require_same_protocol
from src.results.scored import read_scored
from src.run_folder import METRICS, NO_RECIPE
from src.tasks.evaluate import Anchor, anchors_of
from src.tasks.model import origin_of
from src.tasks.scoring import clips_of, protocol_of
from src.tasks.session import Session
from src.terminal import say, tracked
from studies.attitude.measured_poses import Fault, MeasuredPoses
from studies.bounds.true_sight import By, TrueSight
from studies.counting import SCORE, ClipCounts, print_scores, scores_of, write_counted

# The scores that are printed, and their names.
PRINTED = {"miou_occupied": "mIoU occupied", SCORE: "KAR-mIoU"}
TITLE = "Scores (%) of what sees nothing, and of what sees the pixels' true depth and class"

Predict = Callable[[Batch], UInt8[Tensor, "b X Y Z"]]


@dataclass(frozen=True)
class Sight:
    """How a perfect sight is made worse. Its fields are columns of ``bounds.csv``."""

    images: int = 1
    depth_error: float = 0.0
    by: By = "image"
    attitude_deg: float = 0.0
    level: bool = False

    @property
    def name(self) -> str:
        """The sight in words, as sight, depth_5%_by_pixel or images_4."""
        parts = [f"images_{self.images}"] if self.images > 1 else []
        by = "_by_pixel" if self.by == "pixel" else ""
        parts += [f"depth_{100 * self.depth_error:g}%{by}"] if self.depth_error else []
        parts += [f"attitude_{self.attitude_deg:g}deg"] if self.attitude_deg else []
        return "_".join(parts + ["level"] * self.level) or "sight"


def bounds(
    cfg: DictConfig,
    depth_error: Sequence[float],
    attitude_deg: Sequence[float],
    seed: int,
    out: str,
    runs: Sequence[str] = (),
) -> None:
    """Writes ``bounds.csv``, the counts of each bound and ``bounds.png`` to ``out``.

    The floors are the anchors that stand beside every run. The ceilings are those of `TrueSight`:
    of the current frame and of the queue of ``data.frames``, with each ``depth_error``, smooth and
    by pixel, told the true attitude and that of level flight, and with each ``attitude_deg`` of
    noise on roll and pitch. All are scored on the test split. Trained ``runs``, scored on the same
    frames, stand beside them, in the figure at the error of the depth that they have on validation.

    Raises `UserError` for data without depth images, for runs of another dataset or without an
    error of the depth, and as `TrueSight` and `Fault` do.
    """
    session = Session(cfg)
    data, samples = session.data, session.data.split["test"]
    protocol = protocol_of(cfg, data, len(samples))
    trained = read_scored(list(map(str, runs)))
    protocols = {data.root.name: protocol} | {name: of.protocol for name, of in trained.items()}
    # Only occupancy scores are compared.
    require_same_protocol({name: replace(each, suite={}) for name, each in protocols.items()})
    reached = [_depth_error(Path(str(run))) for run in runs]

    sights = list(dict.fromkeys(_sights(depth_error, attitude_deg, cfg.data.frames)))
    predictions, metric = _predictions(session, sights, seed), instantiate(cfg.metric)
    counters = {
        name: ClipCounts(name, metric(data.grid), clips_of(samples)) for name in predictions
    }
    for batch in tracked(data.in_order("test"), "scoring"):
        for name, predict in predictions.items():
            counters[name].add(batch, predict(batch))

    seen = (counter.counts(protocol) for counter in counters.values())
    counts = [replace(each, recipe=NO_RECIPE) for each in seen]
    beside = [
        replace(each, name=name, tables={"occupancy": each.tables["occupancy"]})
        for name, each in trained.items()
    ]
    # What a floor's row says of a sight is empty, and a run's but for its depth.
    rows = [{"bound": sight.name, **asdict(sight)} for sight in sights]
    rows += [{"bound": name, "depth_error": error} for name, error in zip(trained, reached)]
    facts = pd.DataFrame(rows)
    table = scores_of([*counts, *beside], "bound").merge(facts, on="bound", how="left")

    # Scoring needs no drawing code; it is loaded for the figure alone.
    from studies.bounds.figure import draw_bounds

    write_counted(Path(out), "bounds", counts, table, draw_bounds)
    print_scores(table, "bound", TITLE, PRINTED)
    say(out)


def _sights(
    depth_error: Sequence[float], attitude_deg: Sequence[float], queue: int
) -> Iterator[Sight]:
    """Yields the ceilings, from the highest down."""
    yield Sight(images=queue)
    for error, level, by in product((0.0, *depth_error), (False, True), get_args(By)):
        if error or by == "image":
            yield Sight(depth_error=error, by=by, level=level)
    for noise_deg in attitude_deg:
        yield Sight(attitude_deg=noise_deg)


def _depth_error(run: Path) -> float:
    """Returns the error of the depth of the pixels that a run's best epoch had on validation."""
    log = pd.read_csv(run / METRICS) if (run / METRICS).is_file() else pd.DataFrame()
    if "val/depth_error" not in log:
        raise UserError(
            f"task.runs: {run} has no error of the depth; name folders of runs trained with "
            "model/sight=on"
        )
    return float(log.loc[log["val/kar_miou"].idxmax(), "val/depth_error"])


def _predictions(session: Session, sights: Sequence[Sight], seed: int) -> dict[str, Predict]:
    """Returns the prediction of every floor and every ceiling, by its name."""
    cfg, data = session.cfg, session.data
    clips = {clip: data.clips[clip] for clip in clips_of(data.split["test"])}
    dataset = data.dataset("test")

    def seen(sight: Sight) -> Predict:
        true = TrueSight(clips, dataset.step, sight.images, sight.depth_error, sight.by, seed)
        told = MeasuredPoses(dataset, Fault(sight.attitude_deg, level=sight.level), seed)
        return lambda batch: true(told(batch))

    def blind(anchor: Anchor) -> Predict:
        def predict(batch: Batch) -> Tensor:
            frames = zip(batch["clip"], batch["frame"])
            return torch.stack([anchor(data.layer(clip, int(frame))) for clip, frame in frames])

        return predict

    # What is wrong with the settings is refused before the labels are read.
    ceilings = {sight.name: seen(sight) for sight in sights}
    floors = anchors_of(origin_of(cfg, data, session.folder))
    return {name: blind(anchor) for name, anchor in floors.items()} | ceilings

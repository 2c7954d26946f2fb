"""task=free_bias: a checkpoint's scores with the weight of free that validation prefers.

A model that was trained with class weights calls more voxels occupied than one without. A number
that is added to the logit of free, chosen by one rule for every model, takes that apart from what a
model sees.
"""

import math
from collections.abc import Sequence

import pandas as pd
from hydra.utils import instantiate
from jaxtyping import Float
from omegaconf import DictConfig
from torch import Tensor

from src.atomic import replacing_folder
from src.data.truth import truth_of
from src.errors import UserError
from src.ontology import FREE
from src.results.counts import Counts
from src.results.files import write_table
from src.run_folder import TALLIES
from src.tasks.scoring import protocol_of, suite_of
from src.tasks.session import Session
from src.tasks.trainer import Predictor, predictor
from src.terminal import say, tracked
from studies.counting import SCORE
from studies.free_bias.counts import BIAS, FREE_BIAS, SCORED, best_bias


def free_bias(cfg: DictConfig, bias: Sequence[float]) -> None:
    """Writes ``<run>/free_bias/``: KAR-mIoU on validation by each ``bias``, and the counts of all
    scores of the test split with the best one.

    Of several best ones it takes the smallest. Raises `UserError` without a bias, for one that is
    not finite, and as `Session` does.
    """
    biases = list(map(float, bias))
    if not biases or not all(map(math.isfinite, biases)):
        raise UserError(f"task.bias: {list(bias)}; give one finite number or more")
    session = Session(cfg)
    trainer, run = session.trainer, session.folder
    checkpoint, data = session.checkpoint("free_bias"), session.data
    logits_of = predictor(checkpoint.network(), trainer)

    curve = _on_validation(session, logits_of, biases)
    best = best_bias(curve)
    suite, samples = suite_of(cfg, data), data.split["test"]
    for batch in tracked(data.in_order("test"), "scoring"):
        suite.update(_shifted(logits_of(batch), best), truth_of(batch))
    protocol = protocol_of(cfg, data, len(samples))
    counts = Counts.of(cfg.name, protocol, suite, samples, cfg.recipe_name)

    folder = run.path / FREE_BIAS
    with replacing_folder(folder) as new:
        counts.write(new / TALLIES / f"{cfg.name}.npz")
        table = pd.DataFrame({BIAS: list(curve), SCORED: list(curve.values())})
        write_table(table, new / f"{FREE_BIAS}.csv")
    score = float(counts.scores("occupancy")[SCORE])
    say(f"free {best:+g}: KAR-mIoU {100 * curve[best]:.1f} % on validation, {100 * score:.1f} %")
    say(folder)


def _on_validation(
    session: Session, logits_of: Predictor, biases: Sequence[float]
) -> dict[float, float]:
    """Returns KAR-mIoU on the validation split by what is added to the logit of free."""
    metrics = {bias: instantiate(session.cfg.metric)(session.data.grid) for bias in biases}
    for batch in tracked(session.data.in_order("val"), "validating"):
        logits = logits_of(batch)
        for bias, metric in metrics.items():
            metric.update(_shifted(logits, bias), batch["semantics"], batch["velocity_mps"])
    return {bias: float(metric.compute()[SCORE]) for bias, metric in metrics.items()}


def _shifted(logits: Float[Tensor, "b 9 x y z"], bias: float) -> Float[Tensor, "b 9 x y z"]:
    shifted = logits.detach().float().cpu().clone()
    shifted[:, FREE] += bias
    return shifted

"""task=look: what trained weights see in streets of another seed, as a film and three scores."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import torch
from omegaconf import DictConfig
from torch.utils.data import default_collate

from ..data.clip import CLIP_SECONDS
from ..data.datamodule import SkyShieldData
from ..data.truth import truth_of
from ..errors import UserError
from ..metrics.suite import ScoreSuite
from ..models.checkpoint import Origin
from ..report.scene import VoxelScene
from ..terminal import metered, say, tracked
from .evaluate import anchors_of
from .scenes import scene_of
from .scoring import clips_of, score_settings
from .session import Session
from .stages import Stage, announce, generation
from .trainer import Predictor, predictor

FILM, FILM_BYTES = "look.gif", 4_000_000
# The part of the split that is shown: the last seconds of every flight.
SHOWN = "shown"
# Seconds that a frame takes to be predicted and scored, and to be drawn.
PREDICTED_S, DRAWN_S = 0.3, 0.3


# Scores to print: the metric of the suite that has each, its name, and what it says.
SCORES = {
    "geometric_iou": (
        *("safety", "geometric IoU"),
        "of the space that is occupied or predicted to be, the share that is both",
    ),
    "kar_miou": (
        *("occupancy", "KAR-mIoU"),
        "the same by class, where a mistake weighs more the sooner the UAV would reach it",
    ),
    "false_free_rate": (
        *("safety", "called free"),
        "of the occupied space that the UAV could reach in 5 s, the share called free",
    ),
}
NEXT = """\
next:  make demo                                      trains such weights, in minutes
       .venv/bin/python run.py task=look sim.seed=2   looks at other streets; further keys:
       'sim.towns=[market]' 'sim.weathers=[fog]' ckpt_path=FILE"""


def look(cfg: DictConfig, seconds: float, out: str) -> None:
    """Generates the configured flights, and shows what ``ckpt_path`` predicts in their last
    ``seconds``: as a film under ``out``, and in three scores.

    Flights that are there are not made again. Raises `UserError` as `Session` does, and for a time
    that is no part of a flight.
    """
    session = Session(cfg, generates=True)
    trainer, checkpoint = session.trainer, session.checkpoint("look")
    count = round(seconds * cfg.sim.capture_hz)
    if not 0 < count <= CLIP_SECONDS * cfg.sim.capture_hz:
        raise UserError(f"task.seconds: {seconds} is no time; a flight has {CLIP_SECONDS} s")
    _announce(cfg, count, checkpoint.origin)

    data = session.data
    for clip_id, clip in data.clips.items():
        data.split.setdefault(SHOWN, []).extend((clip_id, n) for n in range(len(clip))[-count:])
    suites = _suite(cfg, data), _suite(cfg, data)
    logits_of = predictor(checkpoint.network(cfg.calibrated), trainer)
    scenes = _predicted(data, logits_of, checkpoint.origin, *suites)

    film = Path(out) / data.root.name / FILM
    _draw(data, scenes, film)
    _print_scores(*(suite.scores() for suite in suites))
    say(f"film:  {film}")
    say(NEXT)


def _announce(cfg: DictConfig, count: int, origin: Origin) -> None:
    """Prints the stages, and whether the weights know the streets."""
    sim, own = cfg.sim, origin.config["sim"]
    frames = count * len(sim.towns) * sim.clips_per_town
    stages = [
        generation(cfg),
        Stage(f"predict and score {frames} frames", PREDICTED_S * frames),
        Stage("draw the film", DRAWN_S * frames),
    ]
    streets = f"{', '.join(sim.towns)} of sim.seed={sim.seed} ({', '.join(sim.weathers)})"
    announce(f"{Path(cfg.ckpt_path).name} looks at {streets}", stages)
    if sim.seed == own["seed"] and (known := sorted({*sim.towns} & {*own["towns"]})):
        say(f"note: these weights were trained in these streets of {', '.join(known)}")


def _suite(cfg: DictConfig, data: SkyShieldData) -> ScoreSuite:
    """Returns the metrics that have a score to print."""
    settings = score_settings(cfg)[1]
    metrics = {metric: settings["metrics"][metric] for metric, _, _ in SCORES.values()}
    return ScoreSuite(data.grid, clips_of(data.split[SHOWN]), settings | {"metrics": metrics})


def _predicted(
    data: SkyShieldData, logits_of: Predictor, origin: Origin, model: ScoreSuite, prior: ScoreSuite
) -> list[VoxelScene]:
    """Predicts the frames, counts what the model and the prior by height say, and returns them."""
    by_height, scenes = anchors_of(origin)["height_prior"], []
    for sample in tracked(data.dataset(SHOWN), "predicting"):
        batch = default_collate([sample])
        logits, truth = logits_of(batch).cpu(), truth_of(batch)
        model.update(logits, truth)
        prior.update(by_height(data.layer(sample["clip"], sample["frame"]))[None], truth)

        labels = logits.argmax(dim=1)[0].to(torch.uint8).numpy()
        scenes.append(scene_of(sample, data.grid, {"Prediction": labels}))
    return scenes


def _draw(data: SkyShieldData, scenes: Sequence[VoxelScene], film: Path) -> None:
    # Loaded for the film alone: drawing code takes seconds to import.
    from ..report.animation import draw_scenes

    titles = []
    for clip_id, frame in data.split[SHOWN]:
        meta = data.clips[clip_id].meta
        titles.append(f"{meta.town}, {meta.weather}: {frame / meta.capture_hz:.1f} s")
    durations_ms = [round(1000 / meta.capture_hz)] * len(scenes)
    with metered("drawing the film"):
        draw_scenes(scenes, durations_ms, film, titles, FILM_BYTES)


def _print_scores(model: Mapping[str, float], prior: Mapping[str, float]) -> None:
    """Prints a line for each score: the model's, that of the prior by height, and its meaning."""
    for key, (_, name, meaning) in SCORES.items():
        values = f"{100 * model[key]:5.1f} %  (guessed from the height: {100 * prior[key]:5.1f} %)"
        say(f"{name:<15}{values}  {meaning}")

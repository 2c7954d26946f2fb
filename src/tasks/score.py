"""task=score: scores a folder of predictions, anyone's, against the labels of a dataset."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from ..data.predictions import FACTS
from ..errors import UserError
from ..metrics.protocol import Protocol
from ..metrics.suite import ScoreSuite
from ..provenance import git_commit
from ..results import files
from ..results.counts import Counts, Parts, parts_of
from ..results.protocols import protocol_table
from ..results.summary import print_summary
from ..run_folder import RESULTS, RunFolder
from ..terminal import say, tracked
from .pairing import LAYOUTS, Pairing, Sample
from .scoring import clips_of, score_settings


def score(cfg: DictConfig, part: str, allow_missing: bool, out: str | None) -> None:
    """Prints and writes all scores of ``predictions`` against ``dataset``.

    Writes ``results.csv``, ``scores.csv``, ``protocols.csv``, ``breakdown.csv`` and the counts to
    ``out`` (null: ``scores/`` under the predictions). Raises `UserError` where frames are missing,
    corrupt or too many; with ``allow_missing`` the sound ones are scored, and the protocol says how
    many. Calibration needs logits of all of them.
    """
    if cfg.predictions is None:
        raise UserError("predictions: name the folder to score, as predictions=DIR")

    folder = Path(cfg.predictions)
    pairing = LAYOUTS[cfg.layout.name](cfg, folder, part)
    facts = _facts(cfg, pairing, folder)
    if part != (said := pairing.facts.get("part", part)):
        raise UserError(f"{folder / FACTS}: of the part {said!r}; give task.part={said}")
    samples = _sound_samples(pairing, folder, allow_missing)
    metric, suite = score_settings(cfg)
    name = str(pairing.facts.get("name", folder.name))

    scored = ScoreSuite(pairing.grid, clips_of(samples), suite)
    with_logits = _count(scored, samples, pairing, name)
    # Scores of some frames would stand beside scores of all of them.
    if partly := ", ".join(scored.forget_partly_fed()):
        say(f"{folder}: has logits of {with_logits} of {len(samples)} frames, so no {partly}")

    protocol = Protocol.of(
        pairing.dataset, part, len(samples), pairing.grid, pairing.mask, metric, suite
    )
    counts = Counts.of(name, protocol, scored, samples, facts["recipe"])
    parts = (
        parts_of(pairing.unseen) if part == "test" and pairing.unseen else {part: lambda _: True}
    )
    _write(Path(out) if out else folder / "scores", counts, parts, facts)


def _count(scored: ScoreSuite, samples: Sequence[Sample], pairing: Pairing, name: str) -> int:
    """Counts all samples; returns how many have logits."""
    with_logits = 0
    for sample in tracked(samples, f"scoring {name}"):
        labels, target, logits = pairing.frame(sample)
        scored.update(labels, target, logits)
        with_logits += logits is not None
    return with_logits


def _facts(cfg: DictConfig, pairing: Pairing, folder: Path) -> dict:
    """Returns the facts about the predictions that every row of the results repeats.

    Raises `UserError` for a number that is none.
    """
    said = pairing.facts
    numbers = {key: said.get(key, 0) for key in ("seed", "parameters")}
    # Checked before anything is scored, as that may take an hour.
    for key, value in numbers.items():
        if type(value) is not int:
            raise UserError(f"{folder / FACTS}: {key}: {value!r} is no whole number; correct it")

    config = OmegaConf.to_container(cfg, resolve=True)
    this_code = RunFolder(Path(cfg.paths.run), config, pairing.dataset).version
    return {
        **numbers,
        **{key: str(said.get(key, "")) or "unknown" for key in ("scale", "recipe", "precision")},
        "code_version": str(said.get("code_version") or this_code),
        "git_commit": str(said.get("git_commit") or git_commit()),
        "dataset": pairing.dataset,
        "seconds": 0.0,
    }


def _write(folder: Path, counts: Counts, parts: Parts, facts: Mapping[str, object]) -> None:
    """Writes every table of the scores, and prints the results."""
    files.write_scores(folder, {facts["seed"]: [counts]}, parts)
    files.write_table(protocol_table(counts), folder / "protocols.csv")
    summed = {name: table.sum(0) for name, table in counts.tables["breakdown"].items()}
    breakdown = counts.suite().metric("breakdown").table(summed)
    files.write_table(breakdown, folder / "breakdown.csv")

    files.write_results(folder / RESULTS, files.result_rows(counts, parts, facts))
    print_summary(folder, counts.name, f"{folder}/breakdown.csv and protocols.csv")


def _sound_samples(pairing: Pairing, folder: Path, allow_missing: bool) -> list[Sample]:
    """Returns the frames to score.

    Raises `UserError` where the sound ones are not exactly those asked for.
    """
    inventory = pairing.inventory()
    if inventory.sound:
        return list(pairing.samples)

    if not allow_missing and inventory.missing and inventory.extra:
        raise UserError(
            f"{folder}: {inventory}; they are of another split, whose val and test clips "
            f"{FACTS} may name as held_out"
        )
    if not allow_missing:
        raise UserError(f"{folder}: {inventory}; task.allow_missing=true scores what is sound")
    samples = [sample for sample in pairing.samples if pairing.has(sample)]
    if not samples:
        raise UserError(f"{folder}: {inventory}; nothing is left to score")
    say(f"{folder}: {inventory}; left out")
    return samples

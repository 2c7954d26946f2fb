"""task=check: verifies a dataset clip by clip, draws its labels, and mends what is damaged."""

import os
import shutil
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from pathlib import Path

from omegaconf import DictConfig

from ..data.check import agreement_of, problems_of, shares_of
from ..data.clip import AUX, SUMS, Clip, recorded_sums, sha256_of, unfinished
from ..data.doubt import AS_RECORDED, doubt_of, shares_that_stay
from ..data.files import differing_files
from ..data.manifest import MANIFEST, read_manifest
from ..errors import UserError, is_of_the_system, way_out_of
from ..report.check_sheet import draw_check_sheet
from ..terminal import say, tracked
from ..worker_pool import default_workers, mapped
from .dataset import make_dataset, root_of

# Sums of the files of the dataset's card, where it has one.
CARD_SUMS = f"card/{SUMS}"
# Fewer are checked before another process would have started.
CLIPS_A_WORKER = 8


@dataclass
class Findings:
    """Problems of a dataset, in lines for people, and how its labels agree with the depth."""

    of_clips: dict[str, list[str]] = field(default_factory=dict)
    of_whole: list[str] = field(default_factory=list)
    agreement: Counter = field(default_factory=Counter)
    recorded: bool = False
    stays: dict[str, float] = field(default_factory=dict)

    @property
    def lines(self) -> list[str]:
        return sum(self.of_clips.values(), self.of_whole)


def check(
    cfg: DictConfig, mend: bool, sheets: bool, card: Callable[[Path], None] | None = None
) -> None:
    """Prints every problem and the agreement of labels with depth; raises `UserError` where there
    is a problem and ``mend`` is false.

    With ``mend`` damaged clips are made again, and they alone, and ``card`` writes a damaged card
    again. With ``sheets`` the labels of every
    town are laid over its images, in ``check/<town>.jpg`` under the dataset.
    """
    root = root_of(cfg)
    if mend and cfg.paths.dataset:
        raise UserError(
            "task.mend: only a dataset that is named after its settings can be mended; drop "
            "paths.dataset and give the settings that it was made with"
        )

    if sheets and root.is_dir() and not os.access(root, os.W_OK):
        raise UserError(
            f"task.sheets: {root} cannot be written; task.sheets=false checks without drawing"
        )

    findings = _findings(root, cfg.sim.workers)
    for line in findings.lines:
        say(line)
    if findings.lines and mend:
        _mend(cfg, root, findings)
        if card and findings.of_whole and (root / CARD_SUMS).is_file():
            card(root)
        say(f"mended: {', '.join(findings.of_clips) or MANIFEST}")
        findings = _findings(root, cfg.sim.workers)

    _report(findings, root)
    if sheets:
        _draw_sheets(root)


def _report(findings: Findings, root: Path) -> None:
    """Prints how labels agree with the depth. Raises `UserError` where there is a problem."""
    if findings.agreement["pixels"]:
        for name, share in shares_of(findings.agreement).items():
            say(f"{name}: {100 * share:.2f} %")
        for clip_id, share in findings.stays.items():
            say(f"surfaces of {clip_id} that stay where they are: {100 * share:.2f} %")
    else:
        say("labels not compared with depth: no clip was made with sim.save_aux=true")

    if findings.lines:
        way_out = "" if findings.recorded else "; task.mend=true makes the damaged clips again"
        raise UserError(
            f"{root}: {len(findings.lines)} problems, in {len(findings.of_clips)} clips; the lines "
            f"above name them{way_out}"
        )
    say(f"{root}: {len(read_manifest(root)['clips'])} clips are sound")


def _findings(root: Path, workers: int | None) -> Findings:
    """Checks every clip that the manifest lists, or that is there where the manifest is damaged."""
    findings = Findings()
    try:
        manifest = read_manifest(root)
        clips = {clip: listed["sha256"] for clip, listed in manifest["clips"].items()}
        findings.recorded = "source" in manifest
        findings.of_whole += _card_problems(root)
    except UserError as error:
        if not (root / MANIFEST).is_file():
            raise
        # Without a list of sums every clip is still held against its own.
        findings.of_whole.append(str(error))
        folders = sorted(path.parent for path in root.glob(f"*/*/{SUMS}"))
        clips = {folder.relative_to(root).as_posix(): None for folder in folders}

    workers = workers or min(default_workers(), 1 + len(clips) // CLIPS_A_WORKER)
    results = mapped(partial(_check_clip, root), workers, clips, clips.values())
    bar = tracked(results, f"checking {root.name}", len(clips))
    for clip, (lines, agreement) in zip(clips, bar):
        findings.agreement.update(agreement)
        if lines:
            findings.of_clips[clip] = lines
    if findings.recorded:
        _doubt(findings, root, [each for each in clips if each not in findings.of_clips])
    return findings


def _doubt(findings: Findings, root: Path, clip_ids: Sequence[str]) -> None:
    """Finds how many surfaces of a recording stay where they are, and what to look at first where
    they do not, for one clip of each flight."""
    first_of = {clip.split("/")[0]: clip for clip in reversed(clip_ids)}
    for clip_id in tracked(first_of.values(), "comparing frames"):
        clip = Clip(root / clip_id)
        shares = shares_that_stay(clip)
        findings.stays[clip_id] = shares[AS_RECORDED]
        if doubt := doubt_of(shares):
            findings.of_whole.append(f"{clip.folder}: {doubt}")


def _check_clip(root: Path, clip_id: str, sums_sha256: str | None) -> tuple[list[str], Counter]:
    """Returns the problems of a clip, given the manifest's digest of its sums, and how its labels
    agree with the depth, where there is one. An unreadable file is a problem.

    Raises `UserError` where the system does not let a file be read, which then may be sound.
    """
    folder, agreement = root / clip_id, Counter()
    try:
        problems = list(problems_of(folder))
        if sums_sha256 is not None and sha256_of(folder / SUMS) != sums_sha256:
            problems.append(f"{folder / SUMS}: is not the one in the manifest")
    except OSError as error:
        way_out = way_out_of(error, "run it again")
        raise UserError(f"{error.filename or folder}: {error.strerror}; {way_out}") from error
    except UserError as error:
        if is_of_the_system(error):
            raise
        problems = [str(error)]

    if not problems and (folder / AUX).is_file():
        clip = Clip(folder)
        for frame in range(len(clip)):
            agreement.update(agreement_of(clip, frame))
    return problems, agreement


def _card_problems(root: Path) -> list[str]:
    """Returns the problems of the card, which is derived: it may be missing, but not changed."""
    if not (root / CARD_SUMS).is_file():
        return []
    try:
        sums = recorded_sums((root / CARD_SUMS).parent)
    except UserError as error:
        return [str(error)]
    damaged = differing_files(root, sums)
    return [f"{root / name}: its bytes are not the ones written" for name in damaged]


def _mend(cfg: DictConfig, root: Path, findings: Findings) -> None:
    """Puts damaged clips out of the way, so that they are missing, and makes what is missing."""
    for clip in findings.of_clips:
        folder = root / clip
        if folder.exists():
            # Renamed, not removed: what the generator finds under this name it clears away.
            shutil.rmtree(unfinished(folder), ignore_errors=True)
            folder.rename(unfinished(folder))

    make_dataset(cfg)


def _draw_sheets(root: Path) -> None:
    """Draws a sheet for every town, and prints its path."""
    clip_ids = sorted(read_manifest(root)["clips"])
    for town, clips in groupby(clip_ids, key=lambda clip: clip.split("/")[0]):
        path = root / "check" / f"{town}.jpg"
        heading = f"{town.replace('_', ' ')}: images, and their labels over them"
        draw_check_sheet(root, list(clips), path, heading)
        say(path)

"""task=check: verifies a data set, clip by clip."""

import sys
from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console
from rich.progress import track

from ..data.check import Agreement, agreement_of, problems_of
from ..data.clip import SUMS, Clip, sha256_of
from ..data.manifest import read_manifest
from ..errors import UserError
from .dataset import root_of


def check(cfg: DictConfig) -> None:
    """Prints every problem and the agreement of labels with depth; raises where there is one."""
    root, console = root_of(cfg), Console()
    clips = read_manifest(root)["clips"]
    problems, agreement = [], Agreement()
    quiet = not sys.stdout.isatty()
    progress = track(clips.items(), f"checking {root.name}", transient=True, disable=quiet)
    for clip_id, listed in progress:
        found = clip_problems(root / clip_id, listed["sha256"])
        problems += found
        if not found and (root / clip_id / "aux.npz").is_file():
            clip = Clip(root / clip_id)
            for frame in range(len(clip)):
                agreement_of(clip, frame, agreement)
    for problem in problems:
        console.print(problem, soft_wrap=True, highlight=False)
    if agreement.pixels:
        for name, share in agreement.shares().items():
            console.print(f"{name}: {100 * share:.2f} %")
    else:
        console.print("labels not compared with depth: no clip was made with sim.save_aux=true")
    if problems:
        raise UserError(
            f"{root}: {len(problems)} problems in {len(clips)} clips; the lines above name them"
        )
    console.print(f"{root}: {len(clips)} clips are sound", soft_wrap=True, highlight=False)


def clip_problems(folder: Path, sums_sha256: str) -> list[str]:
    """Problems of a clip, given the manifest's digest of its sums; an unreadable file is one."""
    try:
        found = list(problems_of(folder))
        if sha256_of(folder / SUMS) != sums_sha256:
            found.append(f"{folder / SUMS}: is not the one in the manifest; delete {folder}")
        return found
    except UserError as error:
        return [str(error)]

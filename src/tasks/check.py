"""task=check: verifies a data set, clip by clip."""

from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console
from rich.progress import track

from ..data.check import Agreement, agreement_of, problems_of
from ..data.clip import Clip
from ..data.manifest import read_manifest
from ..errors import UserError
from .dataset import root_of


def check(cfg: DictConfig) -> None:
    """Prints every problem and the agreement of labels with depth; raises where there is one."""
    root, console = root_of(cfg), Console()
    clip_ids = list(read_manifest(root)["clips"])
    problems, agreement = [], Agreement()
    for clip_id in track(clip_ids, f"checking {root.name}", transient=True):
        found = clip_problems(root / clip_id)
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
    if problems:
        raise UserError(f"{root}: {len(problems)} problems in {len(clip_ids)} clips; see above")
    console.print(f"{root}: {len(clip_ids)} clips are sound")


def clip_problems(folder: Path) -> list[str]:
    """Problems of a clip; an unreadable file is one of them."""
    try:
        return list(problems_of(folder))
    except UserError as error:
        return [str(error)]

"""task=audit: the labels of a dataset against the exact geometry of the scenes they came from."""

import shlex
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig, OmegaConf

from src.data.clip import Clip
from src.data.manifest import missing_clips, read_manifest, require_same_data
from src.errors import UserError
from src.limits import require_at_least
from src.provenance import git_commit, machine
from src.report.template import write_text
from src.sim.clip_maker import ClipMaker, ClipPlan
from src.sim.plan import plan_clips
from src.tasks.dataset import root_of, spec_of
from src.terminal import say, tracked
from src.worker_pool import default_workers, mapped
from studies.world.agreement import SurfaceAgreement
from studies.world.truth import Camera, SurfaceTruth


def audit(cfg: DictConfig, frames_per_clip: int, out: str | None) -> None:
    """Prints precision, recall, ghosts and free-space errors, and writes them as ``audit.csv`` and
    ``audit.md`` to ``out`` (null: ``audit/`` under the dataset).

    ``frames_per_clip`` frames of every clip are compared, spread evenly. Raises `UserError` for a
    dataset that is not finished, or that other settings or other code made: its scenes could not
    be built again.
    """
    require_at_least(1, "task", {"frames_per_clip": frames_per_clip}, "frames_per_clip")
    root = root_of(cfg)
    _require_rebuildable(cfg, root)

    sim = OmegaConf.to_container(cfg.sim, resolve=True)
    plans, total = plan_clips(sim), SurfaceAgreement()
    workers = min(len(plans), sim["workers"] or default_workers())
    results = mapped(partial(_audit_clip, sim, root, frames_per_clip), workers, plans)
    for result in tracked(results, f"auditing {root.name}", len(plans)):
        total.join(result)

    folder = Path(out) if out else root / "audit"
    _write(folder, total, root, sim)
    say(_readable(total.table()))
    say(f"{total.frames} frames of {root}: {folder / 'audit.md'}")


def _audit_clip(sim: Mapping, root: Path, frames_per_clip: int, plan: ClipPlan) -> SurfaceAgreement:
    """Builds one clip's scene again and compares its labels with it."""
    maker, clip, agreement = ClipMaker(sim, root), Clip(root / plan.clip_id), SurfaceAgreement()
    _, scene = maker.stage(plan)
    meta = clip.meta
    mount = meta.body_from_camera, meta.pix_from_camera, meta.width, meta.height

    frames = np.linspace(0, len(clip) - 1, min(frames_per_clip, len(clip)))
    for frame in np.unique(frames.round().astype(int)).tolist():
        camera = Camera(clip.world_from_body[frame], *mount)
        truth = SurfaceTruth.of(scene, maker.step_of(frame), camera, meta.grid)
        agreement.add(clip.semantics(frame), truth)
    return agreement


def _require_rebuildable(cfg: DictConfig, root: Path) -> None:
    """Raises `UserError` for a dataset whose scenes this code and these settings do not build."""
    manifest, spec = read_manifest(root), spec_of(cfg)
    require_same_data(root, spec)
    if manifest["generator"] != spec.generator:
        raise UserError(
            f"{root}: was made by other code (generator {manifest['generator']}, this is "
            f"{spec.generator}); drop paths.dataset and run task=generate, then audit that"
        )
    missing = missing_clips(root, list(manifest["clips"]))
    if missing:
        raise UserError(f"{root}: {len(missing)} clips are missing; run task=generate first")


def _write(folder: Path, total: SurfaceAgreement, root: Path, sim: Mapping) -> None:
    """Writes ``audit.csv`` and ``audit.md``, each as a whole."""
    table = total.table()
    csv = table.to_csv(index=False, float_format="%.6f", lineterminator="\n")
    write_text(folder / "audit.csv", csv)

    # Where the dataset lies on this machine is nobody else's concern.
    overrides = [each for each in sys.argv[1:] if not each.startswith("paths.")]
    command = shlex.join(["python", "run.py", *overrides])
    text = f"""# Label audit

{total.frames} frames of `{root.name}`, {len(sim["towns"])} towns, `sim.seed={sim["seed"]}`, \
commit {git_commit() or "unknown"}, {machine()}.

    {command}

The truth is the scene as it is drawn: every triangle, clipped against every voxel; a class is in
a voxel when its surface there exceeds 1 % of a voxel's face. *Visible* surfaces are those that
some of 16 rays a pixel meet; what is visible and not labelled counts as missed.

- *recall*: truly occupied voxels that are labelled occupied; *class recall*: with that class
- *precision*: labelled voxels that truly hold a surface; *class precision*: one of that class
- *ghosts*: labelled, and nothing of the class within 1 mm
- *free error*: voxels labelled free that hold a surface

Ghosts of moving classes among what is visible: {total.moving_ghosts}.

```
{_readable(table)}
```
"""
    write_text(folder / "audit.md", text)


def _readable(table: pd.DataFrame) -> str:
    """Returns the main columns of the table as text for people."""
    columns = ["scope", "class", "true", "recall", "class_recall", "labelled", "precision"]
    columns += ["class_precision", "ghosts", "free", "free_error"]
    # Free space has no class, so its two columns stand in the row of all classes alone.
    readable = table[columns].astype({"free": object, "free_error": object})
    readable.loc[readable["class"] != "all", ["free", "free_error"]] = ""
    return readable.to_string(index=False, float_format="{:.4f}".format, na_rep="")

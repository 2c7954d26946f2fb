"""task=verge: flights past obstacles as clips; and who may use such a dataset."""

from pathlib import Path

import numpy as np
import pytest
from hydra.utils import instantiate
from omegaconf import OmegaConf

from src.data.clip import Clip
from src.data.manifest import MANIFEST, read_manifest
from src.errors import UserError
from src.ontology import BUILDING, FREE, UNKNOWN
from src.tasks.check import check
from src.tasks.fit import fit
from src.tasks.verge import _spec_of
from studies.card.page import CARD, overrides_of, write_card
from tests.synthetic import compose_config, sound_config

YARD = (
    *("task=verge", "scale=tiny", "mission.towns=[tests.loop.yard]", "mission.maps=1"),
    *("mission.conflict=1", "mission.offset_m=[3.0,9.0]", "task.workers=1"),
)


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    cfg = sound_config(*YARD, f"paths.data={folder}")
    instantiate(cfg.task)(cfg)
    return next(folder.glob(f"*/{MANIFEST}")).parent


def test_every_clip_is_one_to_score_on_and_passes_the_check(root):
    manifest = read_manifest(root)
    assert root.name.startswith("tiny-verge-")
    assert manifest["split"] == {"train": 0, "val": 0, "test": 60}
    assert manifest["held_out"]["test"] == list(manifest["clips"])
    check(compose_config("scale=tiny", f"paths.dataset={root}"), mend=False, sheets=False)
    [name] = manifest["clips"]
    words = f"paths.dataset={root}", "data.val_clips=[]", f"data.test_clips=[{name}]"
    with pytest.raises(UserError, match="has no train frame; it is a dataset to score on"):
        fit(compose_config("+experiment=skyocc", "scale=tiny", *words))


def test_its_card_says_how_it_was_made(root):
    write_card(root)
    card = (root / CARD).read_text()
    assert "Bullet, renderer" in card
    assert "MIT, data and code alike" in card
    cfg = compose_config(*overrides_of(read_manifest(root)))
    made = _spec_of(OmegaConf.to_container(cfg, resolve=True))
    assert made.root(root.parent) == root


def test_what_shapes_the_flights_is_in_the_name(tmp_path):
    def digest(*words):
        return _spec_of(OmegaConf.to_container(compose_config(*YARD, *words), resolve=True)).digest

    given = tmp_path / "missions.csv"
    names = [digest(), digest("task.grid.shape=[25,25,15]"), digest("planner.cruise_mps=5.0")]
    for content in ("a", "b"):
        given.write_text(content)
        names.append(digest(f"task.missions={given}"))
    assert len({*names}) == 5


def test_a_card_gives_the_command_of_other_grids_and_missions(root, tmp_path):
    shape = "task.grid.shape=[25,25,15]"
    sides = "task.grid.lower_m=[0,-12.5,-10]", "task.grid.upper_m=[25,12.5,5]"
    cfg = OmegaConf.to_container(compose_config(*YARD, shape, *sides), resolve=True)
    spec = _spec_of(cfg)
    manifest = {**read_manifest(root), "sim": spec.sim, "source": spec.source}
    again = OmegaConf.to_container(compose_config(*overrides_of(manifest)), resolve=True)
    assert _spec_of(again).digest == spec.digest
    manifest["source"] = {**spec.source, "missions": "0123"}
    assert "task.missions=FILE" in overrides_of(manifest)


def test_the_uav_flies_around_a_wall_that_is_labelled_where_it_stands(root):
    [name] = read_manifest(root)["clips"]
    clip = Clip(root / name)
    way_m = clip.world_from_body[:, :3, 3].numpy()
    assert np.linalg.norm(np.diff(way_m, axis=0), axis=1).sum() > 40
    speed_mps = np.linalg.norm(clip.frames[["vx_mps", "vy_mps", "vz_mps"]], axis=1)
    steps_mps = np.linalg.norm(np.diff(way_m, axis=0), axis=1) * clip.meta.capture_hz
    assert speed_mps[1:] == pytest.approx(steps_mps, abs=1.5)

    seen = np.stack([clip.semantics(frame) for frame in range(len(clip))])
    known = seen[seen != UNKNOWN]
    assert (known == BUILDING).any()
    assert (known == FREE).mean() > 0.5


def test_what_is_there_is_not_made_again(root, capsys):
    made = {path: path.stat().st_mtime_ns for path in root.glob("*/*/*")}
    cfg = sound_config(*YARD, f"paths.data={root.parent}")
    instantiate(cfg.task)(cfg)
    assert "0 clips made now, 1 in all" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in root.glob("*/*/*")} == made


def test_a_way_that_is_shorter_than_a_clip_is_refused(tmp_path):
    cfg = sound_config(*YARD, f"paths.data={tmp_path}", "mission.length_m=50")
    with pytest.raises(UserError, match=r"mission\.length_m: .* ends after .*; give a longer way"):
        instantiate(cfg.task)(cfg)
    assert not list(Path(tmp_path).rglob(MANIFEST))

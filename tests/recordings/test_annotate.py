"""One of our clips, recorded as others record, has the labels that our chain gives it directly."""

import numpy as np
import pytest
from hydra.utils import instantiate
from omegaconf import OmegaConf

from src.data.clip import Clip
from src.data.manifest import read_manifest
from src.ontology import FREE, UNKNOWN
from src.recordings.clip import RecordedClip
from src.sim.observation import Annotator
from tests.recordings import foreign
from tests.sessions import ROOT

LAYOUTS = {
    "plain": (foreign.write_plain, False),
    "airsim": (foreign.write_airsim, False),
    "carla": (foreign.write_carla, True),
    "tartanair": (foreign.write_tartanair, True),
}
# The share of the labelled voxels that may differ: of depths in 24 bits, of boxes for instances,
# and of everything that moves taken to stand.
DIFFERING = {"plain": 0.0, "airsim": 0.02, "carla": 0.02, "tartanair": 0.05}


@pytest.fixture(scope="module")
def clip(mini_dataset):
    return Clip(mini_dataset / next(iter(read_manifest(mini_dataset)["clips"])))


def annotator(clip):
    return Annotator(clip.meta.grid, range_m=60.0, camera_stride=2, fused_hz=5.0)


def layout(name, **changes):
    settings = OmegaConf.load(ROOT / f"conf/layout/{name}.yaml")
    del settings["name"]
    return instantiate(OmegaConf.merge(settings, changes), _convert_="all")


def labels_of(recording, how):
    seen = how.observe(recording)
    return np.stack([how.label(seen, frame).semantics for frame in range(len(seen.views))])


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_clip_recorded_elsewhere_has_the_labels_of_the_chain(clip, tmp_path, name):
    write, from_camera = LAYOUTS[name]
    write(clip, tmp_path / "flight")
    hz = clip.meta.capture_hz
    changes = {"airsim": {"position_m": clip.meta.body_from_camera[:3, 3].tolist()}}
    changes |= {"tartanair": {"rate_hz": hz}}
    [flight] = layout(name, **changes.get(name, {})).flights(tmp_path)
    static = name == "tartanair"

    direct = RecordedClip(foreign.Direct(clip, from_camera), 0, 1, hz, 0.0, static)
    theirs = RecordedClip(flight, 0, 1, hz, 0.0, static)
    wanted = labels_of(direct, annotator(clip))
    got = labels_of(theirs, annotator(clip))

    known = (wanted != UNKNOWN) | (got != UNKNOWN)
    share = (wanted != got)[known].mean()
    print(name, f"{share:.5f}")
    assert share <= DIFFERING[name]
    assert ((got < FREE).sum(axis=(1, 2, 3)) > 50).all()

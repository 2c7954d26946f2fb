"""task=slim, and image encoders that begin with a checkpoint."""

import hashlib
from pathlib import Path

import pytest
import torch

from src.errors import UserError
from src.models.backbone import ResNet
from src.models.checkpoint import Checkpoint
from src.models.weights import ORIGIN, read_encoder, require_unseen
from src.tasks.fit import fit
from src.tasks.slim import slim
from tests.synthetic import compose_config


@pytest.fixture(scope="module")
def slimmed(trained, tmp_path_factory):
    return slim(compose_config(*trained, "ckpt_path=best"), str(tmp_path_factory.mktemp("out")))


def test_it_is_named_after_its_content_and_holds_the_network_alone(slimmed, checkpoint):
    digest = hashlib.sha256(slimmed.read_bytes()).hexdigest()
    assert slimmed.name == f"skyocc-tiny-{digest[:8]}.ckpt"
    assert slimmed.stat().st_size < 0.3 * checkpoint.stat().st_size

    small, whole = (Checkpoint.read(path) for path in (slimmed, checkpoint))
    assert (small.epochs, small.origin.config) == (whole.epochs, whole.origin.config)
    networks = (each.network() for each in (small, whole))
    for rounded, exact in zip(*(network.state_dict().values() for network in networks)):
        torch.testing.assert_close(rounded, exact, rtol=2**-11, atol=2**-24)


def test_an_image_encoder_begins_with_it(slimmed, checkpoint, tmp_path):
    encoder = ResNet(18, 8, weights=str(slimmed)).state_dict()
    trained = Checkpoint.read(checkpoint).network().backbone.state_dict()
    for name, value in encoder.items():
        torch.testing.assert_close(value, trained[name], rtol=2**-11, atol=2**-24)

    with pytest.raises(UserError, match=r"model\.backbone\.weights: .*ResNet-18 of this width"):
        ResNet(18, 16, weights=str(slimmed))
    damaged = tmp_path / slimmed.name
    damaged.write_bytes(slimmed.read_bytes()[:-1] + b"!")
    with pytest.raises(UserError, match=r"model\.backbone\.weights: .* SHA-256"):
        ResNet(18, 8, weights=str(damaged))


def test_an_encoder_that_has_learnt_a_clip_is_not_tested_on_it(slimmed, trained, tmp_path):
    cfg = compose_config(*trained, f"model.backbone.weights={slimmed}", "name=other")
    cfg.data.test_clips = ["downtown/clip00"]
    with pytest.raises(UserError, match="downtown/clip00"):
        fit(cfg)
    assert not Path(cfg.paths.run).exists()

    # The same flights in other images are the same; of published files nothing is known.
    dataset, sim = read_encoder(slimmed)[1]["dataset"], {"seed": cfg.sim.seed}
    torch.save(read_encoder(slimmed)[0], tmp_path / "resnet18.pth")
    for unproblematic in (None, "imagenet", str(tmp_path / "resnet18.pth")):
        require_unseen(unproblematic, dataset, sim, ["downtown/clip00"])
    with pytest.raises(UserError, match="downtown/clip00"):
        require_unseen(str(slimmed), f"paper-{12 * '0'}", sim, ["downtown/clip00"])
    # It had neither a clip of a recording, nor one past an obstacle, nor one beyond its own.
    for place, clip in (
        ("mine", "a/clip00"),
        ("tiny-verge", "downtown-500/clip00"),
        ("paper", "downtown/clip14"),
    ):
        require_unseen(str(slimmed), f"{place}-{12 * '0'}", sim, [clip])
    for other in ({"seed": 7}, sim | {"town_seeds": 3}, sim | {"flight": {"floor_m": 2}}):
        require_unseen(str(slimmed), f"paper-{12 * '0'}", other, ["downtown/clip00"])
    require_unseen(str(slimmed), dataset, sim, ["suburb/clip00"])


def test_a_file_of_an_encoder_without_a_configuration_is_refused_by_its_clips(tmp_path):
    path = tmp_path / "image_encoder.pth"
    torch.save({"state_dict": {}, ORIGIN: {"dataset": "tiny-0123", "held_out": {}}}, path)
    with pytest.raises(UserError, match="suburb/clip00"):
        require_unseen(str(path), "tiny-0123", {}, ["suburb/clip00"])

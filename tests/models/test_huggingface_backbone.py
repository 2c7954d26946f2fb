import json
import sys

import pytest
import torch

from src.errors import UserError
from src.models.huggingface_backbone import HuggingFaceBackbone
from tests.models.synthetic import build_batch, build_network, loss_of
from tests.models.test_backbone import random_image, require_levels, require_normalised

pytest.importorskip("transformers")

FOUR = {"depths": [1, 1, 1, 1]}
RESNET = {"model_type": "resnet", "embedding_size": 8, "hidden_sizes": [8, 16, 32, 64], **FOUR}
CONVNEXT = {"model_type": "convnext", "hidden_sizes": [8, 16, 32, 64], **FOUR}
SWIN = {"model_type": "swin", "embed_dim": 8, "num_heads": [1, 2, 4, 8], "window_size": 3, **FOUR}
CONFIGS = {"resnet": RESNET, "convnext": CONVNEXT, "swin": SWIN}
EACH = pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)


def at_random(config):
    torch.manual_seed(0)
    return HuggingFaceBackbone(pretrained=False, config=config)


@pytest.fixture(autouse=True)
def no_hub(monkeypatch):
    """Whatever this machine can reach or has kept."""
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)


@pytest.fixture
def saved(tmp_path):
    """A classifier of that configuration, saved as on the Hub, and its weights."""
    import transformers

    def save(config, **how):
        torch.manual_seed(1)
        config = transformers.AutoConfig.for_model(**config)
        model = transformers.AutoModelForImageClassification.from_config(config)
        model.save_pretrained(tmp_path, **how)
        return model.state_dict()

    return save


@EACH
def test_four_levels_at_strides_4_to_32(config):
    backbone = at_random(config)
    require_levels(backbone, (8, 16, 32, 64))
    assert all(module.training for module in backbone.modules())


def test_channels_are_what_comes_out_whatever_the_configuration_says():
    stages = {"stem_channels": [3, 4, 8], "stage_in_channels": [8, 16, 24, 32]}
    widths = {"stage_mid_channels": [4] * 4, "stage_out_channels": [16, 24, 32, 40]}
    counts = {"stage_num_blocks": [1] * 4, "stage_numb_of_layers": [1] * 4}
    config = {"model_type": "hgnet_v2", "hidden_sizes": [1, 2, 3, 4], **stages, **widths, **counts}
    require_levels(at_random(config), (16, 24, 32, 40))


def test_pixels_are_normalised_inside():
    backbone = at_random(CONVNEXT)
    require_normalised(backbone, backbone.model)


@pytest.mark.parametrize("config", [RESNET, CONVNEXT], ids=["resnet", "convnext"])
def test_weights_load_from_a_folder_and_drop_the_classifier(config, saved, tmp_path):
    state = saved(config)
    backbone = HuggingFaceBackbone(str(tmp_path))
    loaded = backbone.model.state_dict()
    prefix = config["model_type"] + "."
    shared = [name for name in loaded if prefix + name in state]
    assert len(shared) > 0.8 * len(loaded)
    assert all(loaded[name].equal(state[prefix + name]) for name in shared)
    assert all("norm" in name for name in loaded if name not in shared)
    assert backbone.model.training


def test_a_folder_without_safetensors_gives_a_random_model_and_no_pickle_is_read(saved, tmp_path):
    state = saved(CONVNEXT)
    (tmp_path / "model.safetensors").unlink()
    torch.save(state, tmp_path / "pytorch_model.bin")
    assert HuggingFaceBackbone(str(tmp_path), pretrained=False).channels == (8, 16, 32, 64)
    with pytest.raises(UserError, match="safetensors"):
        HuggingFaceBackbone(str(tmp_path))


def test_weights_that_leave_a_part_at_random_are_refused(saved, tmp_path):
    from safetensors.torch import save_file

    state = saved(CONVNEXT)
    kept = {name: value for name, value in state.items() if "stages.2" not in name}
    save_file(kept, tmp_path / "model.safetensors", metadata={"format": "pt"})
    with pytest.raises(UserError, match=r"lack encoder\.stages\.2"):
        HuggingFaceBackbone(str(tmp_path))


@pytest.mark.parametrize("name", ["nobody/no-such-model", "no such name"])
@pytest.mark.parametrize("pretrained", [True, False])
def test_a_name_that_cannot_be_had_is_refused_in_one_line(name, pretrained):
    with pytest.raises(UserError, match=rf"^model\.backbone\.name: .*{name}.*\Z"):
        HuggingFaceBackbone(name, pretrained)


STRIDES = r": .* strides \[.*, not at \[4, 8, 16, 32\]"


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({}, r"\.name"),
        ({"config": CONVNEXT}, r"\.config: .*model\.backbone\.pretrained=false"),
        *(
            ({"pretrained": False, "config": config}, r"\.config")
            for config in ({"model_type": "bert"}, {**RESNET, "depths": "x"}, {})
        ),
        ({"pretrained": False, "config": {**RESNET, "downsample_in_first_stage": True}}, STRIDES),
    ],
)
def test_what_is_no_hierarchical_backbone_is_refused(settings, key):
    with pytest.raises(UserError, match=rf"^model\.backbone{key}"):
        HuggingFaceBackbone(**settings)


def test_without_transformers_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(UserError, match=r"pip install -e '\.\[encoders\]'"):
        at_random(CONVNEXT)


@pytest.mark.parametrize("lift", ["deformable", "lss"])
@EACH
def test_the_network_trains_on_them(config, lift):
    """With batch normalisation or without. All that is trained has a gradient, which several
    processes wait for; the norms of levels that the lift does not read are left alone."""
    batch = build_batch(batch_size=1, frames=2)
    network = build_network(backbone=at_random(config), lift=lift)
    loss_of(network, batch).backward()
    trained = {name: p.grad for name, p in network.named_parameters() if p.requires_grad}
    assert [name for name, grad in trained.items() if grad is None] == []
    assert all(grad.isfinite().all() for grad in trained.values())
    assert len(trained) > 0.9 * len(list(network.parameters()))


@EACH
def test_it_is_built_again_without_any_file(config, saved, tmp_path):
    """As a checkpoint does, which holds the weights."""
    saved(config)
    first = HuggingFaceBackbone(str(tmp_path))
    again = HuggingFaceBackbone(**json.loads(json.dumps(first.built_by)))
    again.load_state_dict(first.state_dict())
    image = random_image()
    pairs = zip(again.eval()(image), first.eval()(image))
    assert all(level.equal(expected) for level, expected in pairs)

import hashlib

import pytest
import torch

from src.errors import UserError
from src.models.backbone import IMAGENET_MEAN, IMAGENET_STD, ResNet, require_maps
from src.models.neck import FPN
from src.models.network import SkyOcc
from tests.models.synthetic import build_network


def random_image(width=96, height=64):
    generator = torch.Generator().manual_seed(0)
    return torch.randint(0, 256, (1, 3, height, width), generator=generator, dtype=torch.uint8)


def require_levels(backbone, channels):
    """Fails unless a backbone gives four levels of so many channels at strides 4 to 32."""
    features = backbone(random_image())
    assert backbone.channels == tuple(f.shape[1] for f in features) == channels
    assert [tuple(f.shape[2:]) for f in features] == [(16, 24), (8, 12), (4, 6), (2, 3)]


@pytest.mark.parametrize(
    ("depth", "channels", "parameters"),
    [(18, (8, 16, 32, 64), 11_176_512), (50, (32, 64, 128, 256), 23_508_032)],
)
def test_four_levels_at_strides_4_to_32_and_the_published_size(depth, channels, parameters):
    """Known sizes, 11,689,512 and 25,557,032, less the classifier's 513,000 and 2,049,000."""
    require_levels(ResNet(depth, width=8), channels)
    assert sum(p.numel() for p in ResNet(depth).parameters()) == parameters


class Halves(torch.nn.Module):
    """An own encoder that halves its image, once too rarely or of floats alone."""

    channels = (3, 3, 3, 3)

    def __init__(self, first=4):
        super().__init__()
        self.first = first

    def forward(self, images):
        floats = images if self.first is None else images.float()
        strides = [(self.first or 4) * 2**n for n in range(4)]
        return [torch.nn.functional.avg_pool2d(floats, stride) for stride in strides]


def test_an_encoder_that_the_neck_cannot_read_is_refused_by_its_name():
    require_maps(ResNet(18, width=8))
    require_maps(Halves())
    for own, told in (
        (Halves(first=2), r"Halves gives maps .* and its channels at strides 4, 8, 16, 32 would"),
        (Halves(first=None), r"Halves fails on images, which are uint8 \[B, 3, H, W\] of 0 to 255"),
    ):
        with pytest.raises(UserError, match=f"^model/backbone: {told}"):
            require_maps(own)


def test_an_encoder_without_a_list_of_channels_is_refused_by_its_name():
    own, network = Halves(), build_network()
    own.channels = 8
    with pytest.raises(UserError, match=r"^model/backbone: Halves does not state its channels"):
        SkyOcc(own, network.encoder, network.decoder)


def test_parameter_names_are_the_published_ones():
    names = set(ResNet(50, width=8).state_dict())
    assert {"conv1.weight", "bn1.running_mean", "layer1.0.conv3.weight"} <= names
    assert {"layer1.0.downsample.0.weight", "layer4.0.downsample.1.bias"} <= names
    assert {"layer2.3.bn3.weight", "layer3.5.conv1.weight", "layer4.2.conv2.weight"} <= names
    assert len(names) == 318, "320 of the published file, less fc.weight and fc.bias"
    assert len(ResNet(18, width=8).state_dict()) == 120


def require_normalised(backbone, first):
    """Fails unless ``first``, a module of the backbone, is given pixels less ImageNet's mean."""
    seen, image = [], random_image()
    first.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
    backbone(image)
    mean, std = (torch.tensor(x).view(3, 1, 1) for x in (IMAGENET_MEAN, IMAGENET_STD))
    torch.testing.assert_close(seen[0], (image / 255 - mean) / std)


def test_pixels_are_normalised_inside():
    backbone = ResNet(18, width=8).eval()
    require_normalised(backbone, backbone.conv1)


def test_sides_that_are_no_multiples_of_32_and_unknown_depths_are_refused():
    for size in ((100, 64), (96, 48)):
        with pytest.raises(UserError, match=f"^image: {size[0]}x{size[1]} .*multiples of 32"):
            ResNet(18, width=8)(random_image(*size))
    with pytest.raises(UserError, match=r"^size\.backbone_depth: 34"):
        ResNet(34)


def save_weights(folder, name="net-{}.pth", without=None):
    """A state dict with a classifier, saved under a name with its own hash."""
    torch.manual_seed(1)
    state = ResNet(18, width=8).state_dict()
    state = {**state, "fc.weight": torch.zeros(1000, 64), "fc.bias": torch.zeros(1000)}
    state.pop(without, None)
    torch.save(state, folder / "raw")
    digest = hashlib.sha256((folder / "raw").read_bytes()).hexdigest()
    path = (folder / "raw").rename(folder / name.format(digest[:8]))
    return path, digest, state


def test_weights_load_by_path_and_by_url_and_drop_the_classifier(tmp_path, monkeypatch):
    monkeypatch.setattr(torch.hub, "_hub_dir", str(tmp_path / "hub"))
    path, digest, state = save_weights(tmp_path)
    url = path.as_uri()
    loaded = [ResNet(18, 8, weights=str(path)), ResNet(18, 8, url, weights_sha256=digest)]
    path.unlink()
    loaded.append(ResNet(18, 8, weights=url))  # kept after the download
    for backbone in loaded:
        assert all(value.equal(state[name]) for name, value in backbone.state_dict().items())


def test_weights_with_another_hash_are_refused(tmp_path):
    path, digest, _ = save_weights(tmp_path)
    with pytest.raises(UserError, match=digest):
        ResNet(18, 8, weights=str(path), weights_sha256="0" * 64)


def test_weights_without_any_hash_are_refused_with_the_hash_to_set(tmp_path):
    path, digest, _ = save_weights(tmp_path, name="mine.pth")
    with pytest.raises(UserError, match=f"weights_sha256.*{digest}"):
        ResNet(18, 8, weights=str(path))
    assert ResNet(18, 8, weights=str(path), weights_sha256=digest)


@pytest.mark.parametrize(
    ("depth", "width", "without", "named"),
    [
        (18, 16, None, "ResNet-18"),
        (50, 8, None, "ResNet-50"),
        (18, 8, "layer4.1.bn2.weight", r"layer4\.1\.bn2\.weight"),
    ],
)
def test_weights_of_another_architecture_are_refused(tmp_path, depth, width, without, named):
    path, _, _ = save_weights(tmp_path, without=without)
    with pytest.raises(UserError, match=rf"^model\.backbone\.weights: {path.name} .*{named}"):
        ResNet(depth, width, weights=str(path))


def test_weights_that_are_missing_or_out_of_reach_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(torch.hub, "_hub_dir", str(tmp_path))
    with pytest.raises(UserError, match="no file"):
        ResNet(18, 8, weights=str(tmp_path / "none-00000000.pth"))
    with pytest.raises(UserError, match="cannot download"):
        ResNet(18, 8, weights=(tmp_path / "none-00000000.pth").as_uri())


def test_the_pyramid_brings_coarse_features_to_fine_levels_and_never_the_other_way():
    features = [torch.randn(1, 4 * 2**i, 16 // 2**i, 24 // 2**i) for i in range(4)]
    levels = FPN((4, 8, 16, 32), dim=6)([each.requires_grad_() for each in features])
    for number, level in enumerate(levels):
        assert level.shape == (1, 6, 16 // 2**number, 24 // 2**number)
        slopes = torch.autograd.grad(
            level.sum(), features, retain_graph=True, materialize_grads=True
        )
        assert [slope.any().item() for slope in slopes] == [n >= number for n in range(4)]

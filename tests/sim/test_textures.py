"""Procedural textures: what the renderer may rely on."""

import numpy as np
import pytest

from src.sim.textures import PALETTE, TEXTURES, rgb_of


@pytest.mark.parametrize("name", TEXTURES)
def test_texture_is_a_small_repeatable_image_without_hairlines(name):
    """No texel differs from both its neighbours on a line by more than what noise does."""
    texture = TEXTURES[name]
    image = texture.draw()
    assert image.dtype == np.uint8
    assert image.shape[2:] == (3,)
    assert max(image.shape) <= 128
    assert min(texture.tile_m) > 0
    assert np.array_equal(image, texture.draw())
    assert image.std() > 1, "a texture that shows nothing belongs into PALETTE"

    image = image.astype(int)
    for axis in (0, 1):
        before = image - np.roll(image, 1, axis)
        after = image - np.roll(image, -1, axis)
        sharp = np.minimum(abs(before), abs(after)).max(axis=2) > 40
        same_way = (np.sign(before) == np.sign(after)).all(axis=2)
        assert not (sharp & same_way).any()


def test_palette_fits_one_image_and_is_unique():
    assert 0 < len(PALETTE) <= 256
    assert len(set(PALETTE)) == len(PALETTE)
    assert rgb_of("#0a141e") == (10, 20, 30)
    assert all(0 <= value <= 255 for color in PALETTE for value in rgb_of(color))

"""What surfaces look like: small procedural textures that tile in metres, and plain colors.

A ``material`` is a key of `TEXTURES` or one of the plain colors ``"#rrggbb"`` of `PALETTE`.
Textures hold no line thinner than a few texels, because the renderer takes the nearest texel and
has no mip-maps: finer detail would flicker with distance and be learned as if it meant something.
"""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float, UInt8

# Texels along each side of a texture.
SIZE = 96

# Plain colors: several to choose from of each thing, or one with a name of its own.
CAR_PAINT = ("#b3202a", "#1f4e8c", "#d8d8d4", "#2b2e33", "#8d949b", "#27613f", "#d99a26", "#5b2333")
TRUCK_PAINT = ("#e8e6df", "#2f5d8a", "#a83a2a", "#3f6f4f", "#d0a43a")
BUS_PAINT = ("#c8372d", "#2a6f97", "#e0a526", "#3d8361")
SHIRTS = ("#a63d40", "#33658a", "#e0c068", "#5b8266", "#efefea", "#3a3a48", "#7d5ba6", "#d9763d")
TROUSERS = ("#2c3440", "#46443f", "#5a6b85", "#7c6a52", "#1f2126")
SKIN = ("#e0b394", "#b98560", "#8a5a3c", "#5e3d29")
HAIR = ("#2a211c", "#5a3e28", "#9a7440", "#77787c")
METAL = ("#3c4248", "#5e666d", "#8c949a", "#b4bac0")
SIGNS = SIGN_RED, SIGN_BLUE, SIGN_WHITE = "#c4282c", "#2257a6", "#f0f0ec"
LIGHTS = LIGHT_RED, LIGHT_AMBER, LIGHT_GREEN = "#e03a2c", "#e8a623", "#34b45a"
_VEHICLES = TYRE, WINDOW_GLASS, HEADLIGHT, TAIL_LIGHT = "#17181a", "#27343f", "#f4efd0", "#8f1d1d"
_BUILT = CABLE, TIMBER, CONCRETE, CHIMNEY = "#202225", "#7d5f43", "#b4b0a6", "#8a4f3c"
_STREET = BIN_GREEN, BIN_GREY, BARRIER_ORANGE = "#35573f", "#55595c", "#e2702a"

# Every plain color that a material may be.
_CHOICES = (CAR_PAINT, TRUCK_PAINT, BUS_PAINT, SHIRTS, TROUSERS, SKIN, HAIR, METAL)
_NAMED = (SIGNS, LIGHTS, _VEHICLES, _BUILT, _STREET)
PALETTE: tuple[str, ...] = tuple(sorted({color for each in _CHOICES + _NAMED for color in each}))

Image = Float[np.ndarray, "h w 3"]
Pixels = UInt8[np.ndarray, "h w 3"]
Span = tuple[float, float]


@dataclass(frozen=True)
class Texture:
    """An image that repeats every ``tile_m`` metres along the surface's u and v."""

    tile_m: Span
    paint: Callable[[], Image]

    def draw(self) -> Pixels:
        """Returns the image, the same at every call.

        Its last row is at v = 0, so that it reads upright on a wall.
        """
        return np.clip(np.rint(self.paint()), 0, 255).astype(np.uint8)


def rgb_of(color: str) -> tuple[int, int, int]:
    """Returns ``"#rrggbb"`` as three values from 0 to 255."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def _mottled(color: str, cells: int = 16, spread: float = 7.0) -> Image:
    """A color with soft blotches that repeat at the tile's edges; the color seeds them."""
    generator = np.random.default_rng(zlib.crc32(f"{color}{cells}".encode()))
    coarse = generator.normal(0, spread, (cells, cells))

    # A texel lies between two cells of each axis; after the last cell comes the first again.
    position = np.arange(SIZE) * cells / SIZE
    low, weight = position.astype(int), position % 1
    rows = coarse[low] * (1 - weight[:, None]) + coarse[(low + 1) % cells] * weight[:, None]
    blotches = rows[:, low] * (1 - weight) + rows[:, (low + 1) % cells] * weight
    return np.array(rgb_of(color), dtype=float) + blotches[..., None]


def _fill(image: Image, color: str, u: Span, v: Span, blend: float = 1.0) -> None:
    """Paints a rectangle given as fractions of the tile, v upwards."""
    columns = slice(round(u[0] * SIZE), round(u[1] * SIZE))
    rows = slice(round((1 - v[1]) * SIZE), round((1 - v[0]) * SIZE))
    image[rows, columns] += blend * (np.array(rgb_of(color)) - image[rows, columns])


def _windows(wall: str, frame: str, width: float, height: float, glass: Sequence[str]) -> Image:
    """Two bays by two storeys; a window's width and height are fractions of its bay and storey."""
    image = _mottled(wall, 24, 6)
    for bay in range(2):
        for storey in range(2):
            u0, v0 = 0.5 * bay + 0.25 * (1 - width), 0.5 * storey + 0.16
            u1, v1 = u0 + 0.5 * width, v0 + 0.5 * height
            _fill(image, frame, (u0 - 0.03, u1 + 0.03), (v0 - 0.03, v1 + 0.03))
            # Panes differ from window to window, and a pale strip on each is a curtain.
            _fill(image, glass[(bay + 2 * storey) % len(glass)], (u0, u1), (v0, v1))
            _fill(image, SIGN_WHITE, (u0, u0 + 0.4 * (u1 - u0)), (v0, v1), blend=0.15)
    return image


def _courses(color: str, mortar: str, rows: int, columns: int) -> Image:
    """Bricks, slabs or roof tiles: staggered rows with darker joints and uneven stones."""
    image = _mottled(color, 2 * columns, 9)
    generator = np.random.default_rng(zlib.crc32(f"{color}{rows}{columns}".encode()))

    for row in range(rows):
        for column in range(columns + 1):
            # Every other row is shifted by half a stone, so its first one is cut.
            u0 = (column - 0.5 * (row % 2)) / columns
            span = (max(u0, 0.0), min(u0 + 1 / columns, 1.0))
            _fill(image, mortar, span, (row / rows, (row + 1) / rows), 0.3 * generator.random())
            if u0 >= 0:
                _fill(image, mortar, (u0, u0 + 0.03), (row / rows, (row + 1) / rows))
        _fill(image, mortar, (0, 1), (row / rows, row / rows + 0.03))
    return image


def _stripes(first: str, second: str, count: int, along_u: bool) -> Image:
    """``count`` stripes of each color, lying along u or standing along v."""
    image = _mottled(first, 16, 4)
    for k in range(count):
        span = ((k + 0.5) / count, (k + 1) / count)
        _fill(image, second, *(((0, 1), span) if along_u else (span, (0, 1))))
    return image


def _road(lanes: int) -> Image:
    """Asphalt across a whole road: edge lines, dashes between lanes, a solid line in the middle."""
    image = _mottled("#55565a", 20, 5)
    line = 0.035 if lanes == 2 else 0.022
    for edge in (0.03, 0.97 - line):
        _fill(image, "#c9c7bd", (0, 1), (edge, edge + line))
    for lane in range(1, lanes):
        middle = lanes > 2 and lane == lanes // 2
        color, length = ("#d9b64a", 1.0) if middle else ("#d6d4ca", 0.5)
        v0 = lane / lanes - line / 2
        _fill(image, color, (0, length), (v0, v0 + line))
    return image


def _shopfront(wall: str, sign: str) -> Image:
    """A shop window with a reflection, a door, and a sign over both."""
    image = _mottled(wall, 16, 5)
    _fill(image, "#31404a", (0.06, 0.62), (0.10, 0.68))
    _fill(image, "#8fa5b0", (0.10, 0.30), (0.14, 0.64), blend=0.5)
    _fill(image, "#4a3527", (0.70, 0.92), (0.0, 0.68))
    _fill(image, sign, (0.04, 0.96), (0.74, 0.92))
    return image


# Panes of a facade's windows.
_DARK, _PALE = ("#2f3d49", "#3c4c58"), ("#56707f", "#49606f")
_WARM, _BLUE = ("#37424c", "#8c7a4e", "#3c4c58"), ("#6f93a8", "#5a7f96")

# A facade's texture holds two bays by two storeys.
BAY_M = STOREY_M = 3.0

FACADES = {
    "facade_brick": partial(_windows, "#9a5442", "#d8cdb8", 0.50, 0.52, _WARM),
    "facade_brick_dark": partial(_windows, "#6b4a40", "#3f3a36", 0.56, 0.56, _PALE),
    "facade_plaster_cream": partial(_windows, "#d9cba6", "#f2ede0", 0.42, 0.56, _DARK),
    "facade_plaster_ochre": partial(_windows, "#c99a5b", "#efe3c8", 0.42, 0.56, _WARM),
    "facade_plaster_rose": partial(_windows, "#c58f80", "#f0e2d6", 0.40, 0.54, _DARK),
    "facade_concrete": partial(_windows, "#a3a39c", "#7c7d7a", 0.70, 0.46, _PALE),
    "facade_panel": partial(_windows, "#c8ccce", "#8a9196", 0.60, 0.50, _DARK),
    "facade_glass": partial(_windows, "#5d7482", "#44545f", 0.88, 0.80, _BLUE),
}

# Materials that are drawn; sides of boxes have u along the horizontal edge and v upwards.
TEXTURES: dict[str, Texture] = {
    **{name: Texture((2 * BAY_M, 2 * STOREY_M), draw) for name, draw in FACADES.items()},
    "shopfront_red": Texture((6.0, 4.0), partial(_shopfront, "#b9ae9a", "#a8322d")),
    "shopfront_blue": Texture((6.0, 4.0), partial(_shopfront, "#8f9498", "#2b5a8c")),
    "shopfront_green": Texture((6.0, 4.0), partial(_shopfront, "#c4b48e", "#2f6b4a")),
    "bricks": Texture((0.9, 0.6), partial(_courses, "#a4583f", "#cdbfa6", 6, 4)),
    "stone": Texture((2.4, 2.0), partial(_courses, "#9c9587", "#77726a", 4, 3)),
    "siding_white": Texture((3.0, 1.6), partial(_stripes, "#e3e0d6", "#c9c6bb", 4, True)),
    "siding_blue": Texture((3.0, 1.6), partial(_stripes, "#7f97a8", "#6d8495", 4, True)),
    "roof_tiles": Texture((2.4, 2.0), partial(_courses, "#a0523a", "#6e3426", 5, 4)),
    "roof_slate": Texture((2.4, 2.0), partial(_courses, "#565d66", "#3a3f46", 5, 4)),
    "roof_flat": Texture((8.0, 8.0), partial(_mottled, "#7d7a74")),
    "planks": Texture((1.2, 1.2), partial(_stripes, "#8b6b4a", "#76593c", 4, True)),
    "corrugated_red": Texture((1.6, 2.4), partial(_stripes, "#a23b2e", "#84302a", 4, False)),
    "corrugated_blue": Texture((1.6, 2.4), partial(_stripes, "#2f5f86", "#264d6d", 4, False)),
    "awning_red": Texture((1.2, 1.2), partial(_stripes, "#b5342f", "#ece6d8", 2, False)),
    "awning_green": Texture((1.2, 1.2), partial(_stripes, "#2f6d4a", "#ece6d8", 2, False)),
    "barrier": Texture((1.2, 1.2), partial(_stripes, "#efece4", "#c4302b", 2, False)),
    "asphalt": Texture((8.0, 8.0), partial(_mottled, "#58595c", 20, 5.0)),
    "road_2lane": Texture((8.0, 7.0), partial(_road, 2)),
    "road_4lane": Texture((8.0, 14.0), partial(_road, 4)),
    "road_wide": Texture((8.0, 8.0), partial(_road, 2)),
    "crossing": Texture((2.0, 2.0), partial(_stripes, "#55565a", "#dcdad2", 2, True)),
    "cobbles": Texture((2.0, 2.0), partial(_courses, "#87807a", "#625c57", 6, 6)),
    "paving": Texture((3.0, 3.0), partial(_courses, "#aaa59b", "#8d887f", 3, 3)),
    "paving_warm": Texture((3.0, 3.0), partial(_courses, "#b89f86", "#978068", 4, 3)),
    "kerb": Texture((2.0, 2.0), partial(_mottled, "#bdb9b0", 8, 4.0)),
    "gravel": Texture((4.0, 4.0), partial(_mottled, "#b59e78", 24, 10.0)),
    "earth": Texture((6.0, 6.0), partial(_mottled, "#8d7c64", 20, 9.0)),
    "concrete": Texture((6.0, 6.0), partial(_mottled, "#a7a49c", 12, 5.0)),
    "corrugated_grey": Texture((1.6, 2.4), partial(_stripes, "#9aa0a4", "#868c90", 4, False)),
    "roller_door": Texture((2.0, 1.6), partial(_stripes, "#b9bec2", "#9da3a8", 4, True)),
    "water": Texture((12.0, 12.0), partial(_mottled, "#3d6273", 16, 8.0)),
    "grass": Texture((6.0, 6.0), partial(_mottled, "#5f8a45", 24, 9.0)),
    "grass_dry": Texture((6.0, 6.0), partial(_mottled, "#8c9250", 24, 9.0)),
    "bark": Texture((1.0, 1.5), partial(_stripes, "#6a5140", "#57412f", 5, False)),
    "foliage_dark": Texture((3.0, 3.0), partial(_mottled, "#3a6233", 20, 14.0)),
    "foliage_mid": Texture((3.0, 3.0), partial(_mottled, "#4f7c3a", 20, 14.0)),
    "foliage_light": Texture((3.0, 3.0), partial(_mottled, "#7a9a4a", 20, 14.0)),
    "foliage_autumn": Texture((3.0, 3.0), partial(_mottled, "#b0752f", 20, 16.0)),
    "needles": Texture((3.0, 3.0), partial(_mottled, "#2c4d3a", 20, 10.0)),
}

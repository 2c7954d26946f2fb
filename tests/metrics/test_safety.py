"""The safety suite against plain loops over voxels, and its edge cases."""

import math
from itertools import product

import pytest
import torch

from src.errors import UserError
from src.geometry import VoxelGrid
from src.metrics import SafetyScores
from src.ontology import BUILDING, CAR, FREE, THIN_STRUCTURE

LINE = VoxelGrid(lower_m=(0, -1, -1), upper_m=(20, 1, 1), shape=(10, 1, 1))  # 1, 3, 5 ... m away
NAMES = [
    "false_free_rate",
    "collision_miss_rate",
    "collision_miss_frames",
    "phantom_stop_rate",
    "phantom_voxel_rate",
    "thin_recall",
    "thin_recall_tolerant",
    "geometric_iou",
]


def norm(*vector):
    return math.sqrt(sum(x * x for x in vector))


def distance_to_path_m(point, end):
    length = norm(*end)
    along = sum(p * e for p, e in zip(point, end))
    if along <= 0 or length == 0:
        return norm(*point)
    if along >= length * length:
        return norm(*(p - e for p, e in zip(point, end)))
    (px, py, pz), (ex, ey, ez) = point, end
    return norm(py * ez - pz * ey, pz * ex - px * ez, px * ey - py * ex) / length


def share(part, whole):
    return part / whole if whole else math.nan


def expected_scores(
    grid,
    preds,
    target,
    velocity,
    mask=None,
    horizon_s=5.0,
    min_speed_mps=5.0,
    tube_radius_m=1.0,
    tube_s=2.0,
    thin_tolerance=1,
):
    lost = solid = missed = blocking = phantom = clear = 0
    blocked_frames = missed_frames = clear_frames = stopped_frames = 0
    thin = exact = near = both = either = 0
    for b in range(len(target)):
        v = velocity[b].tolist()
        true, guess = target[b].tolist(), preds[b].tolist()
        places = [
            (x, y, z)
            for x, y, z in product(*map(range, grid.shape))
            if true[x][y][z] != 255 and (mask is None or mask[b, x, y, z])
        ]
        wires = [(x, y, z) for x, y, z in places if guess[x][y][z] == THIN_STRUCTURE]
        in_tube = []
        for x, y, z in places:
            centre = [low + (i + 0.5) * grid.voxel_m for low, i in zip(grid.lower_m, (x, y, z))]
            t, p = true[x][y][z] != FREE, guess[x][y][z] != FREE
            both, either = both + (t and p), either + (t or p)
            if t and norm(*centre) <= horizon_s * max(norm(*v), min_speed_mps):
                solid, lost = solid + 1, lost + (not p)
            if distance_to_path_m(centre, [tube_s * part for part in v]) <= tube_radius_m:
                in_tube.append((t, p))
            if true[x][y][z] == THIN_STRUCTURE:
                off = [max(abs(x - i), abs(y - j), abs(z - k)) for i, j, k in wires]
                thin, exact = thin + 1, exact + (0 in off)
                near += any(voxels <= thin_tolerance for voxels in off)
        blocking += sum(t for t, _ in in_tube)
        missed += sum(t and not p for t, p in in_tube)
        clear += sum(not t for t, _ in in_tube)
        phantom += sum(p and not t for t, p in in_tube)
        stopped = any(p for _, p in in_tube)
        if any(t for t, _ in in_tube):
            blocked_frames, missed_frames = blocked_frames + 1, missed_frames + (not stopped)
        elif in_tube:
            clear_frames, stopped_frames = clear_frames + 1, stopped_frames + stopped
    shares = [
        (lost, solid),
        (missed, blocking),
        (missed_frames, blocked_frames),
        (stopped_frames, clear_frames),
        (phantom, clear),
        (exact, thin),
        (near, thin),
        (both, either),
    ]
    return {name: share(*pair) for name, pair in zip(NAMES, shares)}


def scores_of(grid, *batches, **arguments):
    safety = SafetyScores(grid, **arguments)
    for batch in batches:
        safety.update(*batch)
    return {name: float(score) for name, score in safety.compute().items()}


def check(grid, batch, **arguments):
    expected = expected_scores(grid, *batch, **arguments)
    assert scores_of(grid, batch, **arguments) == pytest.approx(expected, abs=1e-6, nan_ok=True)
    return expected


def state(safety):
    return {name: table.clone() for name, table in safety.tables.items()}


def same(a, b):
    return all(torch.equal(a[name], b[name]) for name in a)


def coins(seed, like, chance=0.5):
    return torch.rand(like.shape, generator=torch.Generator().manual_seed(seed)) < chance


def sparse(batch):
    """As `random_batch`, but with tubes that are truly free in some frames, and seen so."""
    preds, target, velocity = batch
    empty = coins(9, target, 0.7) & (target != 255)
    preds = preds.masked_fill(coins(10, target, 0.85), FREE)
    return preds, target.masked_fill(empty, FREE), velocity


# ------------------------------------------------------------------------- against the loops


@pytest.mark.parametrize("seed", [0, 4, 5])
def test_every_score_matches_the_loops(grid, random_batch, seed):
    batch = sparse(random_batch(seed, frames=12))
    expected = check(grid, batch, tube_radius_m=3.0, horizon_s=1.5)
    assert all(0 < score < 1 for score in expected.values())
    assert expected != expected_scores(grid, *batch, tube_radius_m=3.0, horizon_s=5.0)


@pytest.mark.parametrize(
    "arguments",
    [
        {"tube_radius_m": 0.5},
        {"tube_radius_m": 6.0, "tube_s": 0.25},
        {"tube_radius_m": 40.0, "tube_s": 10.0},
        {"horizon_s": 0.5, "min_speed_mps": 20.0},
        {"thin_tolerance": 0},
        {"thin_tolerance": 2},
        {"thin_tolerance": 9},
    ],
)
def test_other_parameters_match_the_loops(grid, random_batch, arguments):
    check(grid, random_batch(3), **arguments)


@pytest.mark.parametrize(
    "velocity",
    [
        [0.0, 0.0, 0.0],
        [-8.0, 0.0, 0.0],
        [-8.0, 3.0, 1.0],
        [1000.0, 0.0, 0.0],
        [1000.0, -350.0, 90.0],
        [0.0, 0.0, -1e6],
        [1e-30, 0.0, 0.0],
    ],
)
@pytest.mark.parametrize("radius_m", [2.0, 5.0])
def test_any_velocity_matches_the_loops(grid, random_batch, velocity, radius_m):
    preds, target, like = random_batch(5)
    check(grid, (preds, target, torch.tensor(velocity).expand_as(like)), tube_radius_m=radius_m)


def test_a_mask_restricts_every_score(grid, random_batch):
    batch = random_batch(2)
    masked = check(grid, (*batch, coins(0, batch[0])), tube_radius_m=4.0, horizon_s=1.0)
    assert masked != expected_scores(grid, *batch, tube_radius_m=4.0, horizon_s=1.0)


def test_a_grid_that_the_path_never_enters_has_no_tube(random_batch):
    aside = VoxelGrid((0.0, 30.0, -6.0), (24.0, 50.0, 6.0), (6, 5, 3))
    scores = scores_of(aside, random_batch(0))
    assert math.isnan(scores["collision_miss_rate"])
    assert math.isnan(scores["phantom_voxel_rate"])
    assert not math.isnan(scores["geometric_iou"])


def test_the_names_are_in_the_documented_order(grid, random_batch):
    assert list(scores_of(grid, random_batch(0))) == NAMES


# ------------------------------------------------------------------------------ by hand


def line(**occupied):
    """Free labels with class ids at ``x<index>``."""
    labels = torch.full((1, *LINE.shape), FREE)
    for name, class_id in occupied.items():
        labels[0, int(name[1:])] = class_id
    return labels


def along_x(speed_mps):
    return torch.tensor([[speed_mps, 0.0, 0.0]])


@pytest.mark.parametrize(("index", "rate"), [(0, 1.0), (2, 1.0), (3, math.nan)])
def test_the_bubble_holds_its_edge(index, rate):
    batch = (line(), line(**{f"x{index}": CAR}), along_x(0.0))
    found = scores_of(LINE, batch, horizon_s=1.0)["false_free_rate"]
    assert found == pytest.approx(rate, nan_ok=True)


@pytest.mark.parametrize(("speed_mps", "in_tube"), [(0.0, 1), (2.0, 3), (3.0, 4), (-9.0, 1)])
def test_the_tube_reaches_as_far_as_the_next_seconds(speed_mps, in_tube):
    target = torch.full((1, *LINE.shape), CAR)
    safety = SafetyScores(LINE)
    safety.update(torch.full_like(target, FREE), target, along_x(speed_mps))
    assert safety.tube.tolist() == [[0, 0], [in_tube, 0]]


def test_another_class_than_the_true_one_still_stops_the_flight():
    scores = scores_of(LINE, (line(x1=BUILDING), line(x1=CAR), along_x(3.0)))
    assert scores["collision_miss_rate"] == scores["false_free_rate"] == 0.0
    assert scores["geometric_iou"] == 1.0


def test_a_frame_is_missed_only_if_nothing_in_its_tube_was_predicted():
    target = line(x1=CAR, x2=CAR)
    half, phantom, nothing = line(x1=CAR), line(x0=CAR), line()
    batches = [(preds, target, along_x(3.0)) for preds in (half, phantom, nothing)]
    scores = scores_of(LINE, *batches)
    assert scores["collision_miss_frames"] == pytest.approx(1 / 3)
    assert scores["collision_miss_rate"] == pytest.approx(5 / 6)
    assert math.isnan(scores["phantom_stop_rate"])
    assert scores["phantom_voxel_rate"] == pytest.approx(1 / 6)


def test_a_phantom_stops_only_frames_whose_tube_is_free():
    far, near = line(x8=CAR), line(x1=CAR)
    batches = [(near, far, along_x(3.0)), (far, far, along_x(3.0))]
    scores = scores_of(LINE, *batches)
    assert scores["phantom_stop_rate"] == 0.5
    assert scores["phantom_voxel_rate"] == pytest.approx(1 / 8)
    assert math.isnan(scores["collision_miss_frames"])


def test_what_is_predicted_at_unknown_voxels_never_counts(grid, random_batch):
    preds, target, velocity = random_batch(1)
    arguments = {"tube_radius_m": 4.0, "thin_tolerance": 2}
    expected = scores_of(grid, (preds, target, velocity), **arguments)
    for anything in (FREE, THIN_STRUCTURE, CAR, 255):
        other = preds.masked_fill(target == 255, anything)
        found = scores_of(grid, (other, target, velocity), **arguments)
        assert found == pytest.approx(expected, abs=0, nan_ok=True)


def test_a_wire_predicted_at_an_unknown_voxel_beside_it_does_not_count_as_found():
    target = line(x4=THIN_STRUCTURE, x5=255)
    scores = scores_of(LINE, (line(x5=THIN_STRUCTURE), target, along_x(3.0)))
    assert scores["thin_recall_tolerant"] == 0.0


@pytest.mark.parametrize("tolerance", [0, 1, 2])
def test_thin_tolerance_reaches_diagonals_and_no_further(tolerance):
    cube = VoxelGrid((0, -2, -2), (5, 3, 3), (5, 5, 5))
    for i, j, k in product(range(5), repeat=3):
        target, preds = torch.full((2, 1, 5, 5, 5), FREE)
        target[0, 2, 2, 2] = preds[0, i, j, k] = THIN_STRUCTURE
        off = max(abs(i - 2), abs(j - 2), abs(k - 2))
        scores = scores_of(cube, (preds, target, along_x(1.0)), thin_tolerance=tolerance)
        assert scores["thin_recall_tolerant"] == float(off <= tolerance)
        assert scores["thin_recall"] == float(off == 0)


def test_tolerance_does_not_wrap_around_the_grid():
    target, preds = line(x0=THIN_STRUCTURE), line(x9=THIN_STRUCTURE)
    scores = scores_of(LINE, (preds, target, along_x(1.0)), thin_tolerance=3)
    assert scores["thin_recall_tolerant"] == 0.0


def test_another_class_may_be_the_thin_one(grid, random_batch):
    preds, target, velocity = random_batch(0)
    known = target == CAR
    expected = float((preds[known] == CAR).sum()) / float(known.sum())
    assert scores_of(grid, (preds, target, velocity), thin_index=CAR)["thin_recall"] == (
        pytest.approx(expected)
    )


@pytest.mark.parametrize("how", ["unknown", "masked", "no frames"])
def test_nothing_counted_is_nan(grid, random_batch, how):
    preds, target, velocity = random_batch(0)
    if how == "unknown":
        batch = (preds, torch.full_like(target, 255), velocity)
    elif how == "masked":
        batch = (preds, target, velocity, torch.zeros_like(target, dtype=torch.bool))
    else:
        batch = (preds[:0], target[:0], velocity[:0])
    assert all(math.isnan(score) for score in scores_of(grid, batch).values())


def test_all_free_is_nan_where_something_must_be_occupied():
    scores = scores_of(LINE, (line(), line(), along_x(3.0)))
    counted = {name for name, score in scores.items() if not math.isnan(score)}
    assert counted == {"phantom_stop_rate", "phantom_voxel_rate"}


# ------------------------------------------------------------------- input kinds and batches


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_logits_score_as_the_labels_of_their_maximum(grid, random_batch, backend):
    _, target, velocity = random_batch(0)
    rng = torch.Generator().manual_seed(0)
    logits = torch.randn(len(target), 9, *grid.shape, generator=rng)
    by_logits = scores_of(grid, (logits, target, velocity), backend=backend)
    by_labels = scores_of(grid, (logits.argmax(1), target, velocity))
    assert by_logits == pytest.approx(by_labels, abs=0, nan_ok=True)


@pytest.mark.parametrize("size", [1, 2, 5])
def test_any_split_into_batches_gives_the_same_bits(grid, random_batch, size):
    preds, target, velocity = random_batch(0, frames=7)
    batch = (preds, target, velocity, coins(0, preds))
    at_once, in_parts = (SafetyScores(grid, tube_radius_m=4.0) for _ in range(2))
    at_once.update(*batch)
    for split in reversed(list(zip(*(tensor.split(size) for tensor in batch)))):
        in_parts.update(*split)
    assert same(state(at_once), state(in_parts))
    assert at_once.tube.any()
    assert at_once.frames.any()


# -------------------------------------------------------------------------------------- errors


BAD_BATCHES = {
    "speeds": ("velocity:.*not speeds", lambda p, t, v: (p, t, v.norm(dim=-1))),
    "velocity of another batch": ("velocity:", lambda p, t, v: (p, t, v[:3])),
    "velocity with NaN": ("velocity:", lambda p, t, v: (p, t, v.fill_(torch.nan))),
    "target id 9": ("target:", lambda p, t, v: (p, t.fill_(9), v)),
    "preds id 9": ("preds:", lambda p, t, v: (p.fill_(9), t, v)),
    "preds of another batch": ("preds:", lambda p, t, v: (p[:2], t, v)),
    "target of another grid": ("target:", lambda p, t, v: (p[:, :5], t[:, :5], v)),
    "logits with NaN": (
        "preds:",
        lambda p, t, v: (torch.full((4, 9, 6, 5, 3), torch.nan), t, v),
    ),
    "mask of bytes": ("mask:", lambda p, t, v: (p, t, v, t)),
}


@pytest.mark.parametrize("call", ["update", "forward"])
@pytest.mark.parametrize("what", BAD_BATCHES)
def test_a_bad_batch_is_one_clear_error_and_leaves_the_state(grid, random_batch, call, what):
    names, spoil = BAD_BATCHES[what]
    safety = SafetyScores(grid)
    safety.update(*random_batch(0))
    before = state(safety)
    with pytest.raises(UserError, match=f"^{names}"):
        getattr(safety, call)(*spoil(*random_batch(1)))
    assert same(state(safety), before)
    assert safety.update_count == 1


@pytest.mark.parametrize(
    "arguments",
    [
        {"tube_radius_m": 0.0},
        {"tube_radius_m": math.nan},
        {"tube_s": -1.0},
        {"tube_s": math.inf},
        {"thin_index": 9},
        {"thin_index": -1},
        {"thin_tolerance": -1},
        {"horizon_s": -1.0},
        {"min_speed_mps": 0.0},
        {"free_index": 9},
        {"num_classes": 16},
    ],
)
def test_parameters_that_make_no_sense_are_refused_by_name(grid, arguments):
    with pytest.raises(UserError, match=f"^{next(iter(arguments))}:"):
        SafetyScores(grid, **arguments)

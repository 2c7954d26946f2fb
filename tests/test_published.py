"""What the pages publish is what their files have."""

import re
from itertools import product

import pandas as pd

from tests.sessions import ROOT

SMALL, MOTION = ROOT / "docs/results/small", ROOT / "studies/motion"
SCORES = {
    **{"mIoU": "miou", "mIoU occupied": "miou_occupied", "KAR-mIoU": "kar_miou"},
    **{"of visible voxels": "visible/kar_miou", "of unseen flights": "kar_miou"},
    **{"geometric IoU": "geometric_iou", "primitive miss": "primitive_miss"},
    **{"thin structure": "iou/thin_structure", "car": "iou/car", "VRU": "iou/vru"},
}


def rows_of(page):
    """The table of the page that compares SkyOcc with the anchors: rows of cells by column."""
    table = re.search(r"^\|[^\n]*mIoU occupied.*?(?=\n\n)", page, re.MULTILINE | re.DOTALL)[0]
    head, _, *rows = (
        [cell.strip(" *") for cell in line.split("|")[1:-1]] for line in table.split("\n")
    )
    return {row[0]: dict(zip(head[1:], row[1:])) for row in rows}


def scores_of(path):
    """Scores in percent, by experiment, part and score: of the seeds, or of the anchor."""
    table = pd.read_csv(path).dropna(subset="value")
    table = table[table["seed"] != "mean"]
    return (
        (100 * table["value"])
        .groupby([table["experiment"], table["part"], table["score"]])
        .agg(list)
    )


def test_the_demo_s_rows_are_those_of_its_three_seeds():
    published = scores_of(SMALL / "scores.csv.xz")
    page, readme = (rows_of(path.read_text()) for path in (SMALL / "README.md", ROOT / "README.md"))
    for column, score in SCORES.items():
        part = "test_unseen_clips" if column == "of unseen flights" else "test"
        seeds = published["skyocc", part, score]
        shown = [page[row][column] for row in ("SkyOcc, seed 0", "seed 1", "seed 2", "mean")]
        assert shown == [f"{value:.1f}" for value in (*seeds, sum(seeds) / 3)]
        if column in readme["height prior"]:
            mean, low, high = re.findall(r"[\d.]+", readme["SkyOcc, mean and range"][column])
            assert [mean, low, high] == [
                f"{x:.1f}" for x in (sum(seeds) / 3, min(seeds), max(seeds))
            ]

        for name in ("height prior", "voxel prior", "all free"):
            of_anchor = published.get((name.replace(" ", "_"), part, score))
            assert page[name][column] == (f"{of_anchor[0]:.1f}" if of_anchor else "")


def test_the_rows_at_ladder_are_those_of_their_file():
    published = scores_of(MOTION / "ladder.csv.xz")
    page = rows_of((MOTION / "README.md").read_text())
    names = {"SkyOcc": "skyocc", "without parallax": "skyocc_without_parallax"}
    for name, (column, score) in product(names, SCORES.items()):
        if column not in page[name]:
            continue
        part = "test_unseen_clips" if column == "of unseen flights" else "test"
        [value] = published[names[name], part, score]
        assert page[name][column] == f"{value:.1f}"

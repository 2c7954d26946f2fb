"""task=portraits: pictures of the simulated world for people who have not generated any of it."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from src.report.canvas import readable, titled_sheet, write_picture
from src.sim.clip_maker import ClipPlan
from src.sim.plan import plan_clips
from src.sim.renderer import require_renderer
from src.terminal import say, tracked
from studies.world.pipeline import draw_pipeline
from studies.world.shot import aerial_shot, photograph, street_shot

# Pictures in the repository's docs must stay small.
MAX_TOWN_BYTES, MAX_WEATHER_BYTES = 150_000, 450_000
TOWN_WIDTH_PIX, WEATHER_WIDTH_PIX, WEATHER_COLUMNS = 620, 400, 5


def portraits(cfg: DictConfig, out: str) -> None:
    """Writes ``towns/<town>.jpg`` (from above, and as the UAV sees it), ``weathers.jpg`` (one frame
    under all of them) and ``pipeline.jpg`` (how a frame is annotated) to the folder ``out``.

    Everything comes from ``sim`` and its seed. Raises `UserError` for settings that cannot be made.
    """
    sim = OmegaConf.to_container(cfg.sim, resolve=True)
    plans = plan_clips(sim)
    require_renderer(sim["renderer"])

    pictures = _draw(sim, plans[0], Path(out))
    for path in tracked(pictures, "drawing", len(sim["towns"]) + 2):
        say(path)


def _draw(sim: Mapping, plan: ClipPlan, folder: Path) -> Iterator[Path]:
    """Draws one picture after the other and yields their paths."""
    first = None
    for town in sim["towns"]:
        street = street_shot(sim, town)
        first = first or street
        shots = {"from above": aerial_shot(sim, town), "from the UAV": street}
        pictures = [
            (f"{readable(town)}, {name}", photograph(shot, ["clear"], sim)["clear"])
            for name, shot in shots.items()
        ]
        path = folder / "towns" / f"{town}.jpg"
        write_picture(titled_sheet([pictures], TOWN_WIDTH_PIX).drawn(), path, MAX_TOWN_BYTES)
        yield path

    # One frame under all weathers: that of the first town.
    weathers = [
        (readable(name), picture)
        for name, picture in photograph(first, sim["weathers"], sim).items()
    ]
    rows = [weathers[k : k + WEATHER_COLUMNS] for k in range(0, len(weathers), WEATHER_COLUMNS)]
    path = folder / "weathers.jpg"
    write_picture(titled_sheet(rows, WEATHER_WIDTH_PIX).drawn(), path, MAX_WEATHER_BYTES)
    yield path

    draw_pipeline(sim, plan, folder / "pipeline.jpg")
    yield folder / "pipeline.jpg"

"""The sections of a report on the cube: what each factor adds, and the learning rates tried."""

from collections.abc import Sequence
from pathlib import Path

from src.report.section import Reported, Section
from studies.attitude.section import scores_of
from studies.cube.effects import cube_tables, vertices_of
from studies.cube.figure import draw_cube
from studies.cube.lr_search import search_table


def cube_section(reported: Reported, cube: Sequence[str] = ()) -> Section:
    """Returns the effects of the factors of the experiments that ``cube`` names.

    Raises `UserError` as `vertices_of` does.
    """
    vertices = vertices_of(reported.runs, cube)
    tables = cube_tables(reported.runs, vertices, reported.parts, scores_of(reported))
    pictures = {"cube.png": lambda path, _: draw_cube(tables, path)}
    return Section(tables, experiments=cube, pictures=pictures)


def search_section(
    reported: Reported, search: Sequence[str] = (), cube: Sequence[str] = ()
) -> Section:
    """Returns the table of the learning rates of the short runs in the folders of ``search``.

    Raises `UserError` as `search_table` does.
    """
    places = [Path(str(place)) for place in search]
    return Section([search_table(places, cube, reported.out)] if places else [])

"""Scored runs that a user names on the command line: their counts, by a name of each."""

from collections.abc import Sequence
from pathlib import Path

from ..errors import UserError
from ..run_folder import ANCHORS, TALLIES
from .counts import Counts


def read_scored(runs: Sequence[str]) -> dict[str, Counts]:
    """Reads the counts of run folders, score folders or files, by a name of each."""
    files = [_file_of(Path(run)) for run in runs]
    resolved = [file.resolve() for file in files]
    for n, run in enumerate(runs):
        if resolved[n] in resolved[:n]:
            raise UserError(f"task.runs: {run} is named twice")

    scored = [Counts.read(file) for file in files]
    return dict(zip(_names(scored, files, runs), scored))


def _file_of(path: Path) -> Path:
    """Returns the one file of counts of a run or score folder beside the anchors', or the file."""
    if not path.exists():
        raise UserError(f"task.runs: {path} is neither a folder nor a file")
    if path.is_file() and path.suffix != ".npz":
        raise UserError(f"task.runs: {path} holds no counts; name its folder, or {TALLIES}/*.npz")
    files = [path] if path.is_file() else sorted((path / TALLIES).glob("*.npz"))
    own = [file for file in files if len(files) == 1 or file.stem not in ANCHORS]
    if len(own) != 1:
        raise UserError(f"{path}: holds {len(own)} scored runs; name one of its files of counts")
    return own[0]


def _names(scored: Sequence[Counts], files: Sequence[Path], given: Sequence[str]) -> list[str]:
    """Returns a distinct name for every run. Runs with the same name get the parts in which their
    paths differ, such as the seed, or the text given by the user if the paths do not align."""
    names = []
    for counts, file, words in zip(scored, files, given):
        # Seeds of one experiment have one name, and so have two scorings of one run.
        alike = [each for other, each in zip(scored, files) if other.name == counts.name]
        own = f" {_own_parts(file, alike) or words}" if len(alike) > 1 else ""
        names.append(counts.name + own)
    return names


def _own_parts(path: Path, alike: Sequence[Path]) -> str:
    """Returns the parts of a path in which paths differ; nothing for paths of several depths."""
    if len({len(each.parts) for each in alike}) > 1:
        return ""
    columns = zip(*(each.parts for each in alike))
    return "/".join(part for part, column in zip(path.parts, columns) if len(set(column)) > 1)

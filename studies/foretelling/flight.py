"""Flies every perception of a plan, on each of its sets of frames.

    python -m studies.foretelling.flight [OVERRIDE...] [--runs FOLDER] [--out FOLDER]
                                         [--only NAME...]

``flight.yaml`` is the plan; ``--runs`` is the folder of the runs whose checkpoints fly, as
``<experiment>/seed<k>``. The flights of a perception lie in ``<out>/<stratum>/<name>/<set>``, as
``task=foretell`` reads them; beside those of a run are its scores on the test split. They are those
of ``run.py task=fly`` with the plan's overrides and those given here, but all perceptions take
turns on a mission. It can be interrupted: flights that are there are not flown again. ``--only``
names perceptions or strata.
"""

from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path

from omegaconf import OmegaConf

from src.errors import UserError
from src.results.counts import Counts
from src.run_folder import BEST, TALLIES
from src.tasks.fly import fly_together
from src.terminal import say, tracked
from studies.settings import composed, read_plan, run

PLAN = Path(__file__).with_suffix(".yaml")


def perceptions(plan: Mapping, runs: str) -> Iterator[tuple[str, str, list[str]]]:
    """Yields stratum, name and overrides of every perception of a plan."""
    for stratum, members in plan["perceptions"].items():
        for name, overrides in members.items():
            yield stratum, name, [each.replace("{runs}", runs) for each in overrides]

    for name, seed in product(plan["learned"]["runs"], plan["learned"]["seeds"]):
        checkpoint = f"ckpt_path={runs}/{name}/seed{seed}/{BEST}"
        of_run = ["perception=learned", f"name={name}", f"seed={seed}", checkpoint]
        yield "learned", f"{name}-seed{seed}", of_run

    # A fault is one of a model's frames, a damage one of the truth.
    of_run = [f"ckpt_path={runs}/skyocc/seed0/{BEST}"]
    for stratum, key, more in (("faulty", "fault", of_run), ("damaged", "kind", [])):
        for kind, amounts in plan[stratum].items():
            for amount in amounts:
                how = [f"perception.{key}={kind}", f"perception.amount={amount}", *more]
                yield stratum, f"{kind}_{amount}", [f"perception={stratum}", *how]


def main(
    *overrides: str,
    runs: str = "runs/ladder",
    out: Path = Path("runs/flight"),
    only: tuple[str, ...] = (),
    plan: Path = PLAN,
) -> None:
    keys = "overrides", "sets", "perceptions", "learned", "faulty", "damaged"
    planned = read_plan(plan, *keys)
    there, wanted = list(perceptions(planned, runs)), set(only)
    if unknown := wanted - {word for stratum, name, _ in there for word in (stratum, name)}:
        raise UserError(f"--only: {', '.join(sorted(unknown))} is not in {plan}")
    chosen = [each for each in there if not wanted or wanted & {each[0], each[1]}]

    for stratum, name, _ in chosen:
        if stratum == "learned":
            write_test(Path(runs), name, out / stratum / name)
    for frames, of_set in planned["sets"].items():
        say(frames)
        configs = []
        for stratum, name, own in tracked(chosen, "composing"):
            own = [*of_set, *own, f"task.out={out / stratum / name / frames}"]
            words = [*planned["overrides"], *own, *overrides]
            configs.append(OmegaConf.to_container(composed(words), resolve=True))
        fly_together(configs)


def write_test(runs: Path, name: str, folder: Path) -> None:
    """Writes the counts of a run's test split, clip by clip, as those of flights."""
    experiment, _, seed = name.rpartition("-")
    counts = Counts.read(runs / experiment / seed / TALLIES / f"{experiment}.npz")
    for clip in counts.clips:
        one = counts.of_clips(lambda each, clip=clip: each == clip)
        path = folder / "test/frames" / f"{clip}.npz"
        if one.clips:
            path.parent.mkdir(parents=True, exist_ok=True)
            one.write(path)


if __name__ == "__main__":
    run(main)

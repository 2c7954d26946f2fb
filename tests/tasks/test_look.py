"""task=look: whose flights are shown, by which weights, and whether the scores are theirs."""

import re

import pytest
import torch
from hydra.utils import instantiate
from PIL import Image
from torch.utils.data import default_collate

from src.errors import UserError
from src.models.checkpoint import Checkpoint
from src.ontology import FREE, UNKNOWN
from src.settings import adopted
from src.tasks.dataset import root_of
from src.tasks.session import data_of
from tests.synthetic import compose_config, write_dataset


@pytest.fixture
def looking(checkpoint, tmp_path):
    """The configuration of a look with some words, as the program hands it to the task."""
    places = [f"paths.data={tmp_path}/data", f"paths.runs={tmp_path}/runs"]

    def config(*words):
        words = ["task=look", f"ckpt_path={checkpoint}", "trainer.accelerator=cpu", *places, *words]
        return adopted(compose_config(*words), words)

    return config


def test_the_flights_are_the_command_s_and_all_else_is_the_checkpoint_s(looking, trained):
    own = compose_config(*trained)
    cfg = looking("sim.seed=9", "sim.towns=[market]")
    assert (cfg.sim.seed, list(cfg.sim.towns), cfg.sim.clips_per_town) == (9, ["market"], 1)
    assert (cfg.sim.image, cfg.grid, cfg.model) == (own.sim.image, own.grid, own.model)
    assert (cfg.name, cfg.sim.capture_hz, cfg.data.frames) == ("skyocc", 2.5, 2)
    assert list(cfg.data.test_clips) == []


def test_it_leaves_a_film_and_prints_the_scores_of_what_it_shows(looking, checkpoint, capsys):
    cfg = looking("task.seconds=2")
    write_dataset(cfg)
    instantiate(cfg.task)(cfg)
    output = capsys.readouterr().out

    film = re.search(r"^film:  (\S+)$", output, re.MULTILINE)[1]
    with Image.open(film) as gif:
        assert (gif.n_frames, gif.width) == (5, 1016)
        assert gif.info["duration"] == 400

    # By the definition of the score, from the last two seconds: frames 25 to 29.
    data, network = data_of(cfg, root_of(cfg)), Checkpoint.read(checkpoint).network()
    data.split["last"] = [("downtown/clip00", n) for n in range(25, 30)]
    both = either = 0
    for sample in data.dataset("last"):
        with torch.no_grad():
            said = network(default_collate([sample])).argmax(dim=1)[0] != FREE
        known, occupied = sample["semantics"] != UNKNOWN, sample["semantics"] != FREE
        both += int((known & said & occupied).sum())
        either += int((known & (said | occupied)).sum())
    assert f"geometric IoU   {100 * both / either:4.1f} %" in output
    assert len(re.findall(r"%  \(guessed from the height:", output)) == 3
    assert "next:  make demo" in output


def test_it_says_where_the_weights_have_been_trained(looking, capsys):
    for words, told in ((["sim.seed=0"], True), ([], False), (["sim.towns=[park]"], False)):
        cfg = looking("task.seconds=1", *words)
        write_dataset(cfg)
        instantiate(cfg.task)(cfg)
        assert ("trained in these streets of downtown" in capsys.readouterr().out) == told


@pytest.mark.parametrize("seconds", [0, -1, 12.5])
def test_a_time_that_no_flight_has_is_refused_before_any_is_made(looking, seconds):
    cfg = looking(f"task.seconds={seconds}")
    with pytest.raises(UserError, match=r"task\.seconds"):
        instantiate(cfg.task)(cfg)
    assert not root_of(cfg).exists()

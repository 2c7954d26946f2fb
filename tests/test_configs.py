"""Every experiment at every scale composes and instantiates; the rungs differ in their factors."""

import re
from collections import Counter
from pathlib import Path

import lightning
import pytest
import torch
from hydra.utils import instantiate
from omegaconf import OmegaConf, open_dict
from torchmetrics import Metric

from src.data.dataset import history_stride
from src.dotted import differences
from src.errors import UserError
from src.failures import one_line
from src.geometry import VoxelGrid
from src.models.attention import DeformableCrossAttention
from src.models.bilinear_lift import BilinearLift
from src.models.lift_splat import LiftSplat
from src.models.losses import OccupancyLoss
from src.ontology import NUM_CLASSES
from src.settings import expand_home
from src.sim.plan import plan_clips
from src.tasks.dataset import root_of
from src.tasks.trainer import trainer_of
from tests.synthetic import CONF, compose_config, sound_config

FACTORS = {  # projection, class weights, Lovász: the table of the design
    "baseline": ("level", False, 0.0),
    "attitude": ("attitude", False, 0.0),
    "weights": ("attitude", True, 0.0),
    "skyocc": ("attitude", True, 1.0),
}
LIFTS = {"deformable": DeformableCrossAttention, "bilinear": BilinearLift, "lss": LiftSplat}
HELD_OUT = {"towns": {"old_town", "market"}, "weathers": {"fog", "night", "rainy_night"}}
BACKBONES = {  # and what each needs where there is no network
    "resnet": (),
    "huggingface": (
        "model.backbone.pretrained=false",
        "model.backbone.config={model_type: convnext, hidden_sizes: [8, 16, 32, 64]}",
    ),
}


def names_in(group):
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))


@pytest.mark.parametrize(("recipe", "group"), [("strong", "tiny"), ("paper", "tiny-paper")])
@pytest.mark.parametrize("experiment", names_in("experiment"))
def test_an_experiment_has_the_name_of_its_file_and_of_its_runs_folder(experiment, recipe, group):
    """Two without a name would train in one folder; and so would two recipes."""
    cfg = compose_config("scale=tiny", f"+experiment={experiment}", f"recipe={recipe}", "seed=3")
    assert (cfg.name, cfg.recipe_name) == (experiment, recipe)
    assert cfg.paths.run == f"runs/{group}/{experiment}/seed3"


@pytest.mark.parametrize("scale", ["ladder", "paper"])
@pytest.mark.parametrize("split", [each for each in names_in("split") if each != "streets"])
def test_a_split_holds_out_all_of_a_town_or_weather_or_three_flights_of_every_town(split, scale):
    cfg = compose_config(f"scale={scale}", f"+split={split}")
    plans = plan_clips(OmegaConf.to_container(cfg.sim, resolve=True))
    held_out = [plan for plan in plans if plan.clip_id in cfg.data.test_clips]
    if split == "flights":
        assert Counter(plan.town for plan in held_out) == dict.fromkeys(cfg.sim.towns, 3)
        assert {plan.weather for plan in held_out} == {*cfg.sim.weathers}
    else:
        values = HELD_OUT[split]
        assert held_out == [plan for plan in plans if {plan.town, plan.weather} & values]
    assert not {*cfg.data.val_clips} & {*cfg.data.test_clips}


def test_the_split_of_streets_tests_on_drawings_of_a_town_that_training_has_not():
    cfg = compose_config("scale=small", "+split=streets")
    plans = plan_clips(OmegaConf.to_container(cfg.sim, resolve=True))
    drawings = {plan.clip_id: plan.index % cfg.sim.town_seeds for plan in plans}
    assert {clip for clip, drawing in drawings.items() if drawing} == {*cfg.data.test_clips}


@pytest.mark.parametrize("rung", FACTORS)
def test_a_rung_has_its_three_factors(rung):
    cfg = compose_config(f"+experiment={rung}", "scale=tiny")
    with torch.device("meta"):
        network = instantiate(cfg.model, decoder={"class_prior": [1] * NUM_CLASSES})
    loss = instantiate(cfg.loss, class_counts=[1] * NUM_CLASSES)
    assert isinstance(loss, OccupancyLoss)

    weights = {"lovasz": 0.0, **{term.name: term.weight for term in loss.terms}}
    projection = network.encoder.references.projection
    assert (projection, loss.class_weights is not None, weights.pop("lovasz")) == FACTORS[rung]
    assert weights == {"cross_entropy": 1.0}


@pytest.mark.parametrize("backbone", names_in("model/backbone"))
@pytest.mark.parametrize("lift", names_in("model/lift"))
def test_every_lift_and_backbone_instantiates(lift, backbone):
    if backbone == "huggingface":
        pytest.importorskip("transformers")
    chosen = [f"model/lift={lift}", f"model/backbone={backbone}", *BACKBONES[backbone]]
    # It reads no features as fine as those that say what pixels see.
    chosen += [f"model/{task}=off" for task in ("sight", "parallax", "evidence") if lift == "lss"]
    cfg = sound_config("scale=tiny", *chosen)
    network = instantiate(cfg.model)
    layers = [*network.encoder.frame_layers, network.encoder.last_layer]
    assert [type(layer.lift) for layer in layers] == [LIFTS[lift]] * cfg.model.encoder.num_layers
    assert network.backbone.channels == (8, 16, 32, 64)
    assert getattr(layers[0].lift, "grid", network.encoder.grid) == network.encoder.grid


@pytest.mark.parametrize("scale", names_in("scale"))
def test_a_scale_holds_together(scale, tmp_path):
    cfg = sound_config("+experiment=skyocc", f"scale={scale}", f"paths.runs={tmp_path}")
    assert cfg.scale_name == scale
    assert cfg.sim.image.width % 32 == cfg.sim.image.height % 32 == 0
    assert history_stride(cfg.data.history_step_s, cfg.sim.capture_hz) >= 1
    clips = {f"{t}/clip{i:02d}" for t in cfg.sim.towns for i in range(cfg.sim.clips_per_town)}
    held_out = [*cfg.data.val_clips, *cfg.data.test_clips]
    assert len({*held_out} & clips) == len(held_out)

    # A volume on the ground has the pillars and voxels of the grid.
    volume, grid = instantiate(cfg.model.decoder.grid), VoxelGrid(**cfg.grid)
    assert instantiate(cfg.model.encoder.grid) == volume
    assert instantiate(cfg.model.ground.grid) == grid == VoxelGrid(**cfg.sim.grid)
    assert (volume.voxel_m, volume.shape[:2]) == (grid.voxel_m, grid.shape[:2])
    assert (volume.lower_m[2], volume.upper_m[2]) == (-2.0, 14.0)

    cfg.trainer.accelerator, cfg.trainer.precision = "cpu", "32-true"
    assert isinstance(instantiate(cfg.metric)(grid), Metric)
    assert isinstance(trainer_of(cfg), lightning.Trainer)
    assert callable(instantiate(cfg.task))
    with torch.device("meta"):
        instantiate(cfg.model)


@pytest.mark.parametrize("recipe", [[], ["recipe=paper"]])
def test_the_rungs_share_what_the_recipe_of_the_paper_has_not(recipe):
    """The volume on the ground, what pixels see as a second task, and Muon."""
    cfg = sound_config("+experiment=skyocc", "scale=paper", *recipe)
    strong = not recipe
    assert (cfg.recipe_name, cfg.data.pixels) == ("strong" if strong else "paper", strong)
    assert cfg.optimizer.rule._target_.endswith("Muon" if strong else "AdamW")
    assert cfg.sim.save_aux, "the data are the same"
    with torch.device("meta"):
        network = instantiate(cfg.model)
    assert (network.ground is not None, network.sight is not None) == (strong, strong)
    assert type(network.encoder.last_layer.lift) is LIFTS["deformable"]
    if not strong:
        assert (cfg.data.frames, cfg.data.parallax, network.evidence) == (4, None, None)


@pytest.mark.parametrize("recipe", names_in("recipe"))
def test_tasks_and_files_that_are_added_go_with_every_recipe(recipe):
    added = ["+experiment=skyocc", "+debug=fast", "+split=towns"]
    for words in (["scale=ladder", *added], *([f"task={name}"] for name in ("report", "look"))):
        assert sound_config(f"recipe={recipe}", *words).recipe_name == recipe


def test_what_a_command_chooses_or_an_experiment_sets_wins_over_the_recipe(experiment):
    groups = (f"model/{name}" for name in ("volume=occ", "sight=off", "parallax=on", "evidence=on"))
    cfg = compose_config(*groups, "optimizer=adamw", "data.frames=3")
    assert (cfg.model.ground, cfg.data.pixels, cfg.data.frames) == (None, False, 3)
    assert None not in (cfg.data.parallax, cfg.model.evidence)
    assert cfg.optimizer.rule._target_.endswith("AdamW")
    mine = WHOLE.replace("_self_]", "_self_, override /model/volume: occ]")
    cfg = experiment(f"{mine}data: {{ frames: 3 }}\n")
    assert (cfg.model.ground, cfg.data.frames) == (None, 3)


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("recipe=papre", "recipe: there is no 'papre'; did you .*there are paper, strong$"),
        ("recipe_name=mine", "recipe_name: 'mine'; .*give recipe=strong, recipe=paper or one"),
    ],
)
def test_a_recipe_that_there_is_not_is_one_line_with_those_that_there_are(word, said):
    with pytest.raises(Exception) as info:  # noqa: PT011
        sound_config(word)
    assert re.match(said, one_line(info.value))


def test_the_metric_has_the_papers_parameters():
    """Table 5 of the paper."""
    cfg = sound_config()
    parameters = {"horizon_s": 5.0, "decay_per_s": 0.5, "penalty_scale": 2.0, "min_speed_mps": 5.0}
    assert {name: cfg.metric[name] for name in parameters} == parameters


def test_the_rungs_differ_in_their_factors_and_in_nothing_else():
    """So they share data, schedule, seeds and sizes."""
    reference = OmegaConf.to_container(compose_config("+experiment=baseline"))
    for rung, (projection, weighted, lovasz) in FACTORS.items():
        cfg = OmegaConf.to_container(compose_config(f"+experiment={rung}"))
        expected = {
            "name": rung != "baseline",
            "model.encoder.projection": projection != "level",
            "loss.terms.cross_entropy.class_weights": weighted,
            "loss.terms.lovasz.weight": lovasz,
        }
        changed = [key for key, _, _ in differences(reference, cfg)]
        assert changed == sorted(key for key, changes in expected.items() if changes)


@pytest.mark.parametrize("rung", FACTORS)
def test_every_rung_states_its_three_factors_and_inherits_from_none(rung):
    """Inheritance between rungs could silently undo a factor."""
    stated = OmegaConf.load(CONF / "experiment" / f"{rung}.yaml")
    assert set(stated) == {"defaults", "name"}
    assert [key for entry in stated.defaults for key in entry] == [
        "override /model/projection",
        "override /loss/class_weights",
        "override /loss/lovasz",
    ]


def test_a_name_an_experiment_and_a_factor_are_chosen_on_the_command_line():
    """An experiment that is listed in the defaults could not be added there."""
    listed = OmegaConf.load(CONF / "config.yaml").defaults
    assert not any("experiment" in entry for entry in listed)
    assert compose_config().name == "custom"
    cfg = compose_config("+experiment=skyocc", "loss/lovasz=off")
    assert cfg.loss.terms.lovasz.weight == 0
    assert cfg.loss.terms.cross_entropy.class_weights is not None
    debug = compose_config("+experiment=skyocc", "+debug=fast")
    assert debug.paths.run == "runs/debug/small/skyocc/seed0", "real runs are left alone"


def test_a_training_seed_changes_no_data():
    root = root_of(compose_config())
    assert root_of(compose_config("seed=1", "sim.workers=7", "sim.dry_run=true")) == root
    assert root_of(compose_config("sim.seed=1")) != root


def test_a_batch_of_one_is_sound_but_for_training_on_the_smallest_image():
    for words in (
        ("data.batch_size=1", "sim.image.width=64"),
        ("data.batch_size=1", "sim.image.height=64"),
        ("data.batch_size=2",),
        ("data.batch_size=1", "task=predict"),
    ):
        assert sound_config("sim.image.width=32", "sim.image.height=32", *words)


# What is typed, and how the message about it begins.
REFUSED = {
    **{f"data.{name}=0": f"data.{name}: 0 .*1 or more" for name in ("batch_size", "frames")},
    **{f"size.{name}=0": f"size.{name}: 0 " for name in ("dim", "layers", "heads", "heights")},
    **{f"{key}=-1": rf"{key}: -1 .*0 or more" for key in ("sim.seed", "optimizer.lr")},
    **{f"threads={value}": f"threads: '?{value}'?;" for value in (0, -1, 1.5, "two", True)},
    "data.run_frames=0": "data.run_frames: 0 ",
    "data.workers=-1": "data.workers: -1 ",
    "data.history=none": "data.history: 'none'.*open, strict",
    "data.order=stream": "data.order: 'stream'.*shuffled, streams",
    "data.order=streams data.frames=1": "data.order: .*data.frames=1",
    "data.history_step_s=0.3": "data.history_step_s: 0.3 s",
    "data.mirror=3": "data.mirror: 3 .*true or false",
    "sim.image.width=32 sim.image.height=32 data.batch_size=1": "data.batch_size: .*32x32",
    "sim.image.width=100": "sim.image.width: 100 .*32",
    "sim.workers=some": "sim.workers: 'some'",
    "size.backbone_width=0": "size.backbone_width: 0 ",
    "size.blocks=-1": "size.blocks: -1 ",
    "optimizer.warmup=5": "optimizer.warmup: 5 .*0 to 1",
    "trainer.max_epochs=lots": "trainer.max_epochs: 'lots' .*integer",
    "trainer.accumulate_grad_batches=-1": "trainer.accumulate_grad_batches: -1 ",
    "trainer.gradient_clip_val=-1": "trainer.gradient_clip_val: -1",
    "trainer.precision=fp16": "trainer.precision: 'fp16'.*auto, 32-true",
    "trainer.precision=null": "trainer.precision: None.*auto, 32-true",
    "gpu_precision=fp8": "gpu_precision: 'fp8'.*32-true",
    "+trainer.limit_test_batches=0": "trainer.limit_test_batches: 0",
    "loss/class_weights=manual loss.terms.cross_entropy.class_weights=[1,1,1,1,1,1,1,1,O.5]": (
        r"loss\.terms\.cross_entropy\.class_weights: .* is not a list of 9 numbers"
    ),
    "suite.ttc_edges_s=[]": r"suite.ttc_edges_s: \[\] .*numbers",
    "task=attitude task.delay_s=[soon]": r"task.delay_s: \['soon'\]",
    "grid.shape=[50,50,31]": r"grid.shape: \[50, 50, 31\]",
    "grid.shape=[50,50]": r"grid.shape: \[50, 50\] .*3 integers",
    "model.ground.grid.shape=[5,5,5]": r"model\.ground\.grid\.shape: .*grid\.shape",
    "name=voxel_prior": "name: 'voxel_prior' .*anchor",
    "name=1e5": r"name: 100000\.0 is no word; quote it twice",
    "name=true": "name: True is no word",
    f"name={300 * 'n'}": "name: of 300 bytes; give one of 200",
    "name=report": "name: 'report' .*no run",
    "name=mine.before1": "name: 'mine.before1' .*no run",
    "group=../mine": r"group: '\.\./mine' .*below paths\.runs",
    **{f"seed={n}": f"seed: {n} .*0 to 4294967295" for n in (-1, 2**32)},
    # Infinite, or no number.
    "data.history_step_s=inf": "data.history_step_s: inf is not finite",
    "task=watch task.start_s=nan": "task.start_s: nan is not finite",
    "task=watch task.camera.fx=nan": "task.camera.fx: nan is not finite",
    "sim.grid.lower_m=[0,nan,0]": r"sim.grid.lower_m: \[0, nan, 0\] is not finite",
    # Set by another key, or by the program.
    "model.encoder.num_frames=2": "model.encoder.num_frames: 2, .* set data.frames alone",
    "model.encoder.dim=32": "model.encoder.dim: 32, .* set size.dim alone",
    "+optimizer.rule.lr=1": "optimizer.rule.lr: nothing reads it; give optimizer.lr",
    "+optimizer.rule.weight_decay=1": "optimizer.rule.weight_decay: .*optimizer.weight_decay",
    "+trainer.logger=false": "trainer.logger: nothing reads it; give logger=csv",
    "+trainer.callbacks=[]": r"trainer.callbacks: nothing reads it; give \+callbacks",
    "model.history_grad=true data.order=streams": "model.history_grad: .*data.order=streams",
    "model.encoder.num_heads=-2": "model.encoder.num_heads: -2 ",
    "model.sight.weight=-1": "model.sight.weight: -1 ",
    "model.sight.bins=0": "model.sight.bins: 0 ",
    "data.parallax.ages_s=[0.2,100]": "data.parallax.ages_s: 100 s .*12 s",
    "sim.save_aux=false": "sim.save_aux: false, .*model/sight=off",
    # A training that would end without its best weights, or never go on.
    "callbacks.best.filename=mine": "callbacks.best.filename: mine; .* wants best",
    "+callbacks.last.save_top_k=0": "callbacks.last.save_top_k: 0; .* wants 1",
    "+trainer.fast_dev_run=true": "trainer.fast_dev_run: True; .* wants False; .*debug=fast",
    "+trainer.val_check_interval=0.5": "trainer.val_check_interval: 0.5; .* wants 1.0",
    "+trainer.check_val_every_n_epoch=9": "trainer.check_val_every_n_epoch: 9, .*max_epochs=4",
    "trainer.max_epochs=null": "trainer.max_epochs: null; ",
    "trainer.default_root_dir=${paths.run}": "trainer.default_root_dir: is the run's own",
    "trainer.strategy=ddp_spawn": "trainer.strategy: ddp_spawn .* give ddp",
    "callbacks.best.dirpath=elsewhere": "callbacks.best.dirpath: elsewhere; .* wants runs/small",
    "+trainer.val_check_interval=1": "trainer.val_check_interval: 1; .* wants 1.0; .*limit_train",
    "+trainer.check_val_every_n_epoch=0": "trainer.check_val_every_n_epoch: 0; ",
    "+trainer.check_val_every_n_epoch=often": "trainer.check_val_every_n_epoch: 'often'; ",
    "~callbacks.best": "callbacks.best: a training needs it",
    "~logger": "logger: is needed; ",
    "~model.sight": "model.sight: is needed; ",
    "~model/sight": "model/sight: is needed; ",
    "~data.val_clips": "data.val_clips: is needed; ",
    "~trainer.max_epochs": "trainer.max_epochs: is needed; ",
    "group=": "group: '' is no folder",
    "+max_epochs=3": "max_epochs: nothing",
    "+sim.fogg=1": "sim.fogg: nothing",
    "++trainer.max_epoch=3": "trainer.max_epoch: .*'max_epochs'",
    # Nothing but classes may be added to groups of classes.
    "+loss.terms.mine=3": "loss.terms.mine: nothing .* there are cross_entropy, lovasz",
    "+loss.terms.mine.weight=1": "loss.terms.mine: nothing .* cross_entropy, lovasz",
    "+loss.terms.lovasz.wait=1": "loss.terms.lovasz.wait: nothing .* weight",
    "+loss.term.mine.weight=1": "loss.term: nothing .*'terms'",
    "+suite.metric.mine.rays=1": "suite.metric: nothing .*'metrics'",
}


@pytest.mark.parametrize("typed", REFUSED)
def test_a_setting_that_cannot_be_is_refused_by_its_key(typed):
    with pytest.raises(UserError, match=f"^{REFUSED[typed]}"):
        sound_config(*typed.split(" "))


WHOLE = "# @package _global_\ndefaults: [skyocc, _self_]\nname: mine\n"


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    """Writes an experiment of one's own and checks its configuration."""
    folder = tmp_path_factory.mktemp("conf")
    (folder / "experiment").mkdir()

    def checked(text, *overrides):
        (folder / "experiment/mine.yaml").write_text(text)
        return sound_config("+experiment=mine", *overrides, folder=folder)

    return checked


@pytest.mark.parametrize(
    "text",
    [
        "size: { layers: 3 }\noptimizer: { lr: 1 }\n",
        "trainer: { deterministic: true, devices: auto }\n",  # arguments of the class
        "callbacks: { mine: { _target_: lightning.pytorch.callbacks.Timer } }\n",
        "model: { decoder: { _target_: src.mine.Decoder, width: wide } }\n",  # of another class
        "data: { test_clips: [park/clip00], frames: 2 }\nthreads: 1\n",
    ],
)
def test_an_experiment_of_ones_own_may_set_what_there_is(experiment, text):
    assert experiment(WHOLE + text).name == "mine"


MINE = "{ _target_: src.models.losses.lovasz, _partial_: true }"
OWN_TERM = f"loss: {{ terms: {{ mine: {MINE} }} }}\n"
OWN_DECODER = "model.decoder._target_=mine.Decoder"
RAYS = "+suite.metrics.mine={_target_: src.metrics.RayIoU}"


@pytest.mark.parametrize(
    "overrides",
    [
        (f"+loss.terms.mine={MINE}", "+loss.terms.mine.weight=1"),
        ("+loss.terms.mine._target_=src.models.losses.lovasz", "+loss.terms.mine.weight=1"),
        (RAYS, "+suite.metrics.mine.rays=[9,5]"),
        ("+callbacks.mine={_target_: lightning.pytorch.callbacks.Timer}",),
        ("++threads=1",),  # there already, and null
        ("+trainer.val_check_interval=1.0", "trainer.num_sanity_val_steps=-1"),
        ("~callbacks.preview", "~suite.metrics.rays", "+debug=fast"),
        ("model.sight.class_weights=[1,1,1,4,2,3,6,3,0.5]",),
        # A class of one's own takes what it takes.
        (OWN_DECODER, "model.decoder.dim=32", "~model.decoder.num_blocks"),
        ("model.encoder._target_=mine.Encoder", "model.encoder.num_heads=[2,4]"),
    ],
)
def test_what_there_is_may_be_set_added_and_removed_on_the_command_line(overrides):
    for n in range(len(overrides)):
        assert sound_config("scale=tiny", *overrides[: n + 1])


def test_a_debug_run_sets_what_there_is(experiment):
    """And a term of an experiment of one's own may be given its weight."""
    chosen = "+debug=fast", "+split=towns"
    cfg = experiment(WHOLE + OWN_TERM, *chosen, "+loss.terms.mine.weight=1")
    assert (cfg.trainer.limit_test_batches, cfg.loss.terms.mine.weight) == (1, 1)
    with pytest.raises(UserError, match=r"^loss\.terms\.mine\.wight: nothing"):
        experiment(WHOLE + OWN_TERM, "+loss.terms.mine.wight=1")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("size: { layer: 3 }", "size.layer: .*'layers'"),
        ("optimiser: { lr: 1.0 }", "optimiser: .*'optimizer'"),
        ("optimizer: { lr: fast }", "optimizer.lr: 'fast' .*number"),
        ("trainer: { max_epoch: 4 }", "trainer.max_epoch: .*'max_epochs'"),
        ("callbacks: { mine: 3 }", "callbacks.mine: "),
        ("data: { frames: [1, 2] }", r"data.frames: \[1, 2\] .*integer"),
    ],
)
def test_a_mistake_in_an_experiment_is_named_with_the_files_that_may_have_it(
    experiment, text, message
):
    with pytest.raises(UserError, match=f"^experiment=mine, recipe=strong, scale=tiny: {message}"):
        experiment(WHOLE + text, "scale=tiny")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("defaults: [skyocc]\n", r"^experiment=mine: .*mine\.yaml.*@package _global_"),
        (WHOLE + "size: { layers: 3\n", r"mine\.yaml, line \d: .*YAML \("),
        (WHOLE.replace("skyocc", "override /loss/lovasz: on"), "quotes, .* /loss/lovasz"),
    ],
)
def test_an_experiment_that_cannot_be_read_is_one_line(experiment, text, message):
    with pytest.raises(Exception) as info:  # noqa: PT011
        experiment(text)
    assert re.search(message, one_line(info.value))


def test_a_path_anywhere_may_begin_at_home():
    cfg = compose_config(
        "paths.data=/data", 'ckpt_path="~/a.ckpt"', 'model.backbone.weights="~/b.ckpt"'
    )
    with open_dict(cfg):
        cfg.task = {"out": "~", "runs": ["~/a", "b~"]}
    expand_home(cfg)
    home = str(Path.home())
    assert (cfg.ckpt_path, cfg.model.backbone.weights) == (f"{home}/a.ckpt", f"{home}/b.ckpt")
    assert (cfg.task.out, list(cfg.task.runs)) == (home, [f"{home}/a", "b~"])
    assert cfg.paths.data == "/data"

"""Hydra's launchers: the cluster's configuration composes, and each job is a process of its own."""

import pytest
from hydra import compose, initialize_config_dir

from src.data.manifest import MANIFEST
from tests.sessions import python
from tests.synthetic import CONF


def test_the_slurm_configuration_composes():
    overrides = ["hydra/launcher=slurm", "hydra.launcher.partition=cpu"]
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("config", overrides, return_hydra_config=True)
    launcher = cfg.hydra.launcher
    assert launcher._target_.endswith("SlurmLauncher")
    assert (launcher.partition, launcher.cpus_per_task, launcher.nodes) == ("cpu", 8, 1)


@pytest.mark.slow
@pytest.mark.parametrize("launcher", ["joblib", "submitit_local"])
def test_shards_spread_by_a_launcher_make_one_dataset(launcher, tmp_path):
    overrides = [
        *("-m", "task=generate", "scale=tiny", f"hydra/launcher={launcher}", "sim.shards=2"),
        *("sim.shard=0,1", "sim.clips_per_town=1", "sim.capture_hz=2.5", "data.history_step_s=0.4"),
        *("data.test_clips=[]", f"paths.data={tmp_path}/data", f"paths.runs={tmp_path}/runs"),
    ]
    python("run.py", *overrides)
    (root,) = (tmp_path / "data").glob("tiny-*")
    assert (root / MANIFEST).is_file()
    assert len(list(root.glob("*/clip00"))) == 2
    assert not list((tmp_path / "data").glob(".*"))

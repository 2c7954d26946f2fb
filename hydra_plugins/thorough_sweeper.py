"""The sweeper of ``run.py -m``; Hydra takes plugins from the package ``hydra_plugins`` alone."""

import os
from typing import Any

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.utils import JobReturn
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig


class ThoroughSweeper(BasicSweeper):
    """Hydra's basic sweeper, which checks all jobs first, lets no failure stop the others, and
    ends with a summary. Under any launcher: whatever process a job runs in returns its outcome.
    """

    def setup(
        self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig
    ) -> None:
        # Only here: Hydra imports its plugins whatever it is asked for.
        from src.sweep import do_job

        super().setup(hydra_context=hydra_context, task_function=do_job, config=config)

    def sweep(self, arguments: list[str]) -> Any:
        """Raises `UserError` before anything is made, or after everything was tried."""
        from src.sweep import JOBS, launcher_failure, require_sound_jobs, summarize

        loader = self.hydra_context.config_loader
        overrides = [*self._parse_config(), *arguments]
        overrides = OverridesParser.create(loader).parse_overrides(overrides)
        batches = self.split_arguments(overrides, self.max_batch_size)
        jobs = [job for batch in batches for job in batch]
        require_sound_jobs([loader.load_sweep_config(self.config, job) for job in jobs])
        os.environ[JOBS] = str(len(jobs))
        returns: list[JobReturn] = []
        try:
            for batch in batches:
                returns += self.launcher.launch(batch, initial_job_idx=len(returns))
        except Exception as error:
            raise launcher_failure(error) from error
        summarize(jobs, [job.return_value for job in returns])
        return returns

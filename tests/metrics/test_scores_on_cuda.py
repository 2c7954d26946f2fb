"""Scoring on a simulated GPU: nothing is left behind on the CPU, and no count is another one."""

import torch

from src.metrics import KARMeanIoU, OccupancyScores
from src.metrics.suite import ScoreSuite
from tests.metrics.inputs import SUITE, one_hot, truth_of
from tests.simulated_cuda import CUDA, simulated_cuda


def test_scores_count_on_the_device(grid, random_batch):
    preds, target, velocity = random_batch(0)
    for metric in (KARMeanIoU(grid), OccupancyScores(grid)):
        expected = metric(preds, target, velocity)
        with simulated_cuda():
            metric.reset()
            metric.to(CUDA)
            metric.update(preds.to(CUDA), target.to(CUDA), velocity.to(CUDA))
            found = metric.compute()
        pairs = found.items() if isinstance(found, dict) else [(None, found)]
        for name, value in pairs:
            other = expected if name is None else expected[name]
            torch.testing.assert_close(value.inner, other, rtol=0, atol=0, equal_nan=True)


def test_the_whole_suite_counts_on_the_device(grid, random_batch):
    preds, target, velocity = random_batch(0)
    logits = one_hot(preds)
    truth = truth_of(target, velocity, ["a"] * len(target))
    suites = [ScoreSuite(grid, ["a"], SUITE) for _ in range(2)]
    suites[0].update(logits, truth)
    with simulated_cuda():
        suites[1].to(CUDA)
        there = {k: v.to(CUDA) if isinstance(v, torch.Tensor) else v for k, v in truth.items()}
        suites[1].update(logits.to(CUDA), there)
        tables = suites[1].tables()
    for name, expected in suites[0].tables().items():
        for key, table in expected.items():
            assert tables[name][key].inner.equal(table), f"{name}/{key}"

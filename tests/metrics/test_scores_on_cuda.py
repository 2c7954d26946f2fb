"""Scoring on a simulated GPU: nothing is left behind on the CPU, and no count is another one."""

import torch

from src.metrics.suite import ScoreSuite
from tests.metrics.inputs import SUITE, assert_same, one_hot, truth_of
from tests.simulated_cuda import CUDA, simulated_cuda


def test_the_whole_suite_counts_and_scores_on_the_device(grid, random_batch):
    preds, target, velocity = random_batch(0)
    logits, truth = one_hot(preds), truth_of(target, velocity, ["a"] * len(target))
    on_cpu, on_cuda = (ScoreSuite(grid, ["a"], SUITE) for _ in range(2))
    on_cpu.update(logits, truth)

    with simulated_cuda():
        on_cuda.to(CUDA)
        moved = {k: v.to(CUDA) if isinstance(v, torch.Tensor) else v for k, v in truth.items()}
        on_cuda.update(logits.to(CUDA), moved)
        tables = on_cuda.counts()
        scores = on_cuda.by_clip["occupancy"].compute()

    for name, expected in on_cpu.counts().items():
        assert_same({key: table.inner for key, table in tables[name].items()}, expected)
    expected = on_cpu.by_clip["occupancy"].compute()
    assert_same({name: score.inner for name, score in scores.items()}, expected)

"""Memory that is freed is kept for the next tensor."""

import subprocess
import sys

PROGRAM = """
import resource
import torch
from src.heap import keep_freed_memory
{call}
for _ in range(2):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        torch.ones(10_000_000)  # 40 MB, or 10,000 pages
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def page_faults(call: str) -> int:
    """Returns how many pages a process takes from the kernel for 20 tensors of 40 MB, one after the
    other, when it has had 20 before."""
    program = [sys.executable, "-c", PROGRAM.format(call=call)]
    done = subprocess.run(program, capture_output=True, text=True, check=True)
    return int(done.stdout)


def test_pages_of_a_freed_tensor_are_not_taken_again():
    assert page_faults("keep_freed_memory()") < page_faults("") / 4

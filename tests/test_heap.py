"""Memory that is freed is kept for the next tensor."""

from tests.sessions import python

PROGRAM = """
import resource
import torch
from src.heap import keep_freed_memory

def page_faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        torch.ones(10_000_000)  # 40 MB, or 10,000 pages
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

print(page_faults())
keep_freed_memory()
page_faults()
print(page_faults())
"""


def test_pages_of_a_freed_tensor_are_not_taken_again():
    given_back, kept = map(int, python("-c", PROGRAM).stdout.split())
    assert kept < given_back / 4

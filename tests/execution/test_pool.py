"""A pool of processes ends at once, whatever its workers do."""

import subprocess
import sys

import pytest

from trackbench.execution.engines import cpu_count

SENDING = """
from trackbench.execution.process_pool import pool

if __name__ == "__main__":
    for _ in range(4):
        try:
            with pool(2) as workers:
                sent = [workers.submit(bytes, 50_000_000) for _ in range(8)]
                sent[0].result()
                raise KeyboardInterrupt
        except KeyboardInterrupt:
            print("ended")
"""


@pytest.mark.skipif(cpu_count() < 2, reason="needs worker processes")
def test_an_interrupt_ends_workers_that_send_a_large_result() -> None:
    command = [sys.executable, "-c", SENDING]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "ended\n" * 4

"""Record which tests are slow, from the durations that pytest reports.

``.venv/bin/pytest -n 2 --dist loadfile --durations=0 | .venv/bin/python -m tests.slow``

A test stands in ``tests/slow.txt`` if all its cases, with what they set up, take more than 0.2 s.
`make test-fast` leaves these tests out.
"""

import re
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

LIST = Path(__file__).with_name("slow.txt")
LIMIT = 0.2  # s
_DURATION = re.compile(r"([\d.]+)s (?:call|setup|teardown) +([^\s\[]+::\w+)")


def slow_tests(report: Iterable[str]) -> list[str]:
    """Return the tests above the limit, as ``file::test``, from the lines of pytest's report."""
    seconds: Counter[str] = Counter()
    for line in report:
        if match := _DURATION.match(line):
            seconds[match[2]] += float(match[1])
    return sorted(test for test, taken in seconds.items() if taken > LIMIT)


if __name__ == "__main__":
    LIST.write_text("\n".join(slow_tests(sys.stdin)) + "\n", encoding="utf-8")

"""A second implementation of the papers' filters: one run at a time, from their equations.

Only `test_reference.py` imports trackbench. A filter is a generator: from one run's measurements it
yields the mean and covariance of every step. Random numbers come from `Draws`, in the order of use.
"""


class Draws:
    """What one run of a vectorised filter has drawn, handed out again."""

    def __init__(self, drawn):
        self._waiting = iter(drawn)

    def take(self, kind):
        """The next variates, which must be of this kind: N numbers, or rows of N."""
        found, values = next(self._waiting)
        assert found == kind, f"{found} was drawn where the algorithm draws {kind}"
        return values.tolist()

    def used_up(self):
        return next(self._waiting, None) is None

"""Random numbers that filters get in the checks: one fixed seed for every check."""

from numpy.random import SFC64, Generator


def new_rng() -> Generator:
    """Return a new stream of random numbers, with the same seed for every check."""
    return Generator(SFC64(20260101))


def state_words(rng: Generator) -> list[int]:
    """Return the generator's state, which changes with every number that is drawn."""
    return rng.bit_generator.state["state"]["state"].tolist()

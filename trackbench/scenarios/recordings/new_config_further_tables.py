"""Tables beside that of the measurements, for which a new config has keys."""

from dataclasses import dataclass, field

from trackbench.scenarios.recordings.guess_record import Guess
from trackbench.scenarios.recordings.guess_truth import TruthGuess
from trackbench.scenarios.recordings.label_spelling import plain_label


@dataclass(frozen=True)
class FurtherTables:
    """Tables beside that of the measurements, and keys of the target that the user gave."""

    truth: TruthGuess | None = None
    """guess at the table of the true path"""
    truth_path: str = ""
    """its path from the config, as YAML"""
    odometry: Guess | None = None
    """guess at the table of a robot's inputs"""
    odometry_path: str = ""
    """its path from the config, as YAML"""
    places: dict[str, tuple[float, float]] = field(default_factory=dict)
    """places of landmarks, m, by their plain labels"""
    source_of_places: str = ""
    """name of their file"""
    keys: dict[str, str] = field(default_factory=dict)
    """keys of the target on its inputs, such as input_gap, as YAML"""

    def place_of(self, name: str) -> tuple[float, float] | None:
        """Return the place of a landmark, that of the only one if it has no name; None if unknown."""
        if not name and len(self.places) == 1:
            return next(iter(self.places.values()))
        return self.places.get(plain_label(name))

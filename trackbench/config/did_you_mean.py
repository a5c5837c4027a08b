"""Suggest the word that was meant, or list the known words."""

from collections.abc import Sequence
from difflib import get_close_matches

from trackbench.errors import first_names

_MOST_KNOWN = 40  # words in a message
MERGE_KEY = "<<"
"""Key by which YAML 1.1 merges mappings; configs have no such key."""
NO_MERGING = "keys are not merged by <<: write them out, or `use: FILE` for those of a file"


def unknown(word: str, known: list[str]) -> str:
    """Suggest ``did you mean ...?``, or list the first known words."""
    if word == MERGE_KEY:
        return NO_MERGING
    near = nearest(word, known)
    if near:
        return f"did you mean {near}?"
    # A word with a comma, as a label may have, is quoted.
    words = [repr(known_word) if "," in known_word else known_word for known_word in known]
    return f"known: {first_names(words, _MOST_KNOWN)}"


def nearest(word: str, known: Sequence[str]) -> str:
    """Return the known word that was probably meant; an empty text if none is near."""
    lower = word.lower().replace(" ", "-")
    # Usual words for keys and kinds that have another name here.
    meant = _MEANT.get(lower, "")
    if meant in known:
        return meant
    # The same letters in another order (efk is ekf, not epf), then beginnings, then similar words.
    for other in known:
        if sorted(other.lower()) == sorted(lower):
            return other
    if len(lower) > 2:
        longer = [other for other in known if other.lower().startswith(lower)]
        if longer:
            # A metric of the position is meant most often; else the shortest word.
            return min(longer, key=lambda other: ("position" not in other, len(other)))
    near = get_close_matches(word, known, 1, 0.5) or get_close_matches(lower, known, 1, 0.5)
    if not near:
        return ""
    return near[0]


_MEANT = {
    # keys
    "dt": "T",
    "interval": "T",
    "period": "T",
    "steps": "last",
    "duration": "last",
    "n_runs": "runs",
    "monte_carlo_runs": "runs",
    "particles": "N",
    "n_particles": "N",
    "measurement": "sensor",
    # metrics
    "pos_rmse": "rmse_position",
    "position_rmse": "rmse_position",
    "rmse": "rmse_position",
    "position": "rmse_position",
    "position_error": "rmse_position",
    "velocity": "rmse_velocity",
    "nees": "anees",
    "nis": "anis",
    "omega": "turn_rate_deg_s",
    # filters
    "kalman": "kf",
    "kalman-filter": "kf",
    "particle-filter": "pf",
    "particle": "pf",
    "extended-kalman": "ekf",
    "unscented": "ukf",
    # sensors and motions
    "radar": "range-azimuth",
    "gps": "position",
    "constant-velocity": "cv",
    "constant-acceleration": "ca",
    "constant-turn": "ct",
    "coordinated-turn": "ct",
    # figures
    "line": "rmse-vs-time",
    "rmse_vs_time": "rmse-vs-time",
}
"""Words that users write, and the key or kind that is meant, if it is known at the place."""

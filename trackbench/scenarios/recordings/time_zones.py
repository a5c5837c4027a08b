"""Time zones: names of UTC, and offsets from it, of the key `zone`."""

import re
from datetime import datetime
from difflib import get_close_matches
from zoneinfo import ZoneInfo, available_timezones

_NAMES_OF_UTC = ("UTC", "Z", "ZULU", "GMT", "ETC/UTC")
"""Names that the key ``zone`` may have for UTC, in upper case."""
_ZONE = re.compile(r"(?:UTC)?([+-])(\d{1,2})(?::?([0-5]\d))?", re.IGNORECASE)
"""Offset from UTC in the key ``zone``."""
_MOST_OFFSET = 14 * 3600.0
"""Largest offset of a zone from UTC, s."""
_YEAR_OF_OFFSETS = 2024
"""Year of the offsets that a message shows."""


def is_utc(zone: str) -> bool:
    """Test whether a config's key ``zone`` is a name of UTC, in any case."""
    return zone.upper() in _NAMES_OF_UTC


def offset_of_zone(zone: str) -> float | None:
    """Return the offset of a config's key ``zone`` from UTC, s; None if it is no offset.

    A zone is UTC, Z, +02:00, +0200, +02 or UTC+2.
    """
    if is_utc(zone):
        return 0.0
    match = _ZONE.fullmatch(zone)
    if match is None:
        return None
    sign, hours, minutes = match.groups(default="0")
    seconds = 3600.0 * int(hours) + 60.0 * int(minutes)
    if seconds > _MOST_OFFSET:
        return None
    return -seconds if sign == "-" else seconds


def mistake_in_zone(zone: str) -> str:
    """Return the message on a config's key ``zone`` that is no offset from UTC.

    If it is nearly the name of a known zone, such as Europe/Berlin, the message has the offsets of this
    zone.
    """
    message = f"{zone!r} is neither UTC nor an offset from it, such as +02:00"
    # Names of zones by their small letters, with and without the continent.
    names = {}
    for name in sorted(available_timezones()):
        names[name.lower()] = name
        names.setdefault(name.rpartition("/")[2].lower(), name)
    near = get_close_matches(zone.lower().replace(" ", "_"), names, n=1, cutoff=0.7)
    if not near:
        return message
    name = names[near[0]]
    # Its offsets in winter and in summer.
    offsets = []
    for month in (1, 7):
        offset = datetime(_YEAR_OF_OFFSETS, month, 1, tzinfo=ZoneInfo(name)).strftime("%z")
        offsets.append(f"{offset[:3]}:{offset[3:5]}")
    if offsets[0] == offsets[1]:
        return f"{message}; write {offsets[0]}, the offset of {name}"
    return (
        f"{message}; {name} is {offsets[0]} in January and {offsets[1]} in July, so write the one that "
        "the dates have"
    )

"""Hemispheres of latitudes and longitudes: the words for north, south, east and west."""

HEMISPHERES = {
    "latitude": (
        "north_south",
        ("n", "north", "northern", "nord", "norte", "noord"),
        ("s", "south", "southern", "sud", "sur", "sul", "süd", "sued", "zuid"),
    ),
    "longitude": (
        "east_west",
        ("e", "east", "eastern", "est", "ost", "este", "leste", "oost"),
        ("w", "west", "western", "ouest", "ovest", "oeste"),
    ),
}
"""Key of the column of a coordinate's hemisphere, and its words for positive and negative ones."""

"""Where and when blocks are computed, and the ones that are kept."""

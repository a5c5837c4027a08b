"""Starts: what every filter is given as the distribution of the first state."""

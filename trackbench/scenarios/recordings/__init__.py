"""Recorded data: tables of one's own, from any clock and in any unit, as arrays by step and run."""

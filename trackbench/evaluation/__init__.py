"""One Monte Carlo block (simulate, filter, measure) and the statistics over blocks."""

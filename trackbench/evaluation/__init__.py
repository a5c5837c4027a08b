"""Floor 3: one Monte Carlo block (simulate, filter, measure) and the statistics over blocks."""

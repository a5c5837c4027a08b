"""Floor 0: arrays in, arrays out. Component axes first, batch axes last; numpy and scipy only."""

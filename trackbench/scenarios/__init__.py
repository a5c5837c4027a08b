"""Floor 2: truth, sensor and prior. Never imports filters."""

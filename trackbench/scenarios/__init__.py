"""Truth, sensor and prior. Never imports filters."""

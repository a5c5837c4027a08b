"""Floor 1: motion and sensor models, and the Gaussian steps that need nothing but a model."""

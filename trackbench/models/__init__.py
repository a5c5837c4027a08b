"""Motion and sensor models, priors, and Gaussian filter steps on any model."""

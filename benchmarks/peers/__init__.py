"""The other implementations, each as its own documentation shows; one file per package."""

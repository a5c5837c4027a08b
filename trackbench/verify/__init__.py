"""Check that a stored results folder is reproduced, byte for byte."""

"""A results folder's files: written, packed, locked, read."""

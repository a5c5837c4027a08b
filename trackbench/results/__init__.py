"""A results folder's files: their names, writing, locking and reading."""

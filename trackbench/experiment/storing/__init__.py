"""The files of a results folder, each written whole or not at all."""

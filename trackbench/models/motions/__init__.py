"""Motions, one file each or a few alike: what `kind` of motion a target or a filter may have."""

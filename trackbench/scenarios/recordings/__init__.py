"""Recorded data: tables of one's own, from any clock and in any unit, as arrays by step and run.

Names of files begin or end with their use: ``guess_*`` for the guess at a table by
`trackbench new experiment --from`, ``new_config_*`` for the config that is written from it,
``parse_*`` for the cells of a table, and ``*_check`` for notes on likely mistakes in a run.
"""

"""Audit of other packages' filters by the contract: `make audit`, docs/findings/audit.md."""

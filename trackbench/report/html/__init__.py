"""The report and the index as pages."""

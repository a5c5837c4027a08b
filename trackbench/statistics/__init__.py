"""Numbers with their errors, intervals, comparisons and the rules of significance."""

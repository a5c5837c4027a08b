"""The report and the page of a suite, their templates, and pictures for pages."""

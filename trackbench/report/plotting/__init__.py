"""Drawing with matplotlib: style, page formats, tick labels, files."""

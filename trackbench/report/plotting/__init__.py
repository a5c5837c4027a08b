"""Drawing with matplotlib: style, colors, fonts, panels, axes, formats of pages and files."""

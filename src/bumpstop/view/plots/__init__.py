"""Plots of the explorer, drawn as SVG: text and lines that a browser shows in a millisecond."""

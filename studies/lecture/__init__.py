"""A lecture on cloth simulation: one page a slide, each with code, a figure and a check."""

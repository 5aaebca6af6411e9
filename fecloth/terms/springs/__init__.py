"""Springs along edges, and tethers."""

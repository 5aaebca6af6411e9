"""The compiled loops that all terms share, with what they need."""

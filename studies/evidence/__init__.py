"""Evidence for the makers: that the code is right, and how fast it is."""
